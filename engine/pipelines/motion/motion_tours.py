"""Tours of measurements by inverse kinematics, with the times of collision-free paths as costs.

The cost of a move is the time of its slowest joint. A joint of unknown speed is assumed to move at
1 rad/s. Collisions at the places are checked here. Collisions on the way between them are not.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs
from cellwright.engine.model.tour_problem import PoseProblem, Tour, TourProblem, Visit
from cellwright.engine.pipelines.inspection.tool_tours import ToolPartition, partition_by_tool
from cellwright.engine.pipelines.motion.travel_times import TravelStations, travel_stations
from cellwright.engine.ports import GeometryBackend
from cellwright.engine.stages.geometry.reach.place_reachability import (
    PlaceReachability,
    UnreachedPlace,
)
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.engine.stages.motion.roadmap import (
    TravelTimes,
    map_nodes,
    nearest_node_pairs,
    travel_times,
)
from cellwright.engine.stages.sequencing import TourLimits, sequence_tour
from cellwright.engine.stages.sequencing import TourLimits as Effort
from cellwright.engine.stages.sequencing.pose_tours import with_poses
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.model.cell_model import Cell, Place
from cellwright.kb.model.planning_problem import Problem

HOME_VISIT = "home"
REST_SPEED = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class PosedTour:
    """A closed tour of one tool that starts at the arm's home."""

    tool: str
    arm: str
    problem: PoseProblem
    tour: Tour

    @property
    def configurations(self) -> Floats:
        """The joint values (n, k) in the order of the tour: n visits, k joints."""
        chosen = zip(self.tour.order, self.tour.poses, strict=True)
        return np.array([self.problem.poses[visit][pose] for visit, pose in chosen])


def posed_tours(
    problem: Problem, cell: Cell, backend: GeometryBackend, limits: TourLimits = TourLimits()
) -> tuple[tuple[PosedTour, ...], ToolPartition]:
    """For each tool and arm a tour of all measurements that the arm reaches, and the partition of
    the measurements.

    A measurement that the arm does not reach is listed as impossible, with the reason. Raises
    `InvalidInput`.
    """
    named = {name: problem.domain.conventions.place(name) for name in problem.objects}
    places = {name: cell.places[place] for name, place in named.items() if place in cell.places}
    parts = partition_by_tool(problem, places)
    world = GeometricWorld.of(cell)
    ask = PlaceReachability(world, backend)
    tours: list[PosedTour] = []
    groups: dict[str, tuple[str, ...]] = {}
    impossible = dict(parts.impossible)
    for tool, names in parts.groups.items():
        reached, unreached = _reached_configurations(ask, {name: places[name] for name in names})
        impossible |= unreached
        groups |= {tool: tuple(reached)} if reached else {}
        for arm in sorted({places[name].arm for name in reached}):
            own = {name: q for name, q in reached.items() if places[name].arm == arm}
            tours.append(_posed_tour(world, tool, arm, own, ask, places, limits))
    return tuple(tours), replace(parts, groups=groups, impossible=impossible)


def _reached_configurations(
    ask: PlaceReachability, places: Mapping[str, Place]
) -> tuple[dict[str, Floats], dict[str, str]]:
    answers = {name: ask.at(place) for name, place in places.items()}
    return (
        {
            name: answer.q
            for name, answer in answers.items()
            if not isinstance(answer, UnreachedPlace)
        },
        {
            name: answer.reason
            for name, answer in answers.items()
            if isinstance(answer, UnreachedPlace)
        },
    )


def _posed_tour(
    world: GeometricWorld,
    tool: str,
    arm: str,
    reached: Mapping[str, Floats],
    ask: PlaceReachability,
    places: Mapping[str, Place],
    limits: TourLimits,
) -> PosedTour:
    joints = world.cell.arms[arm].arm.joints
    where = {name: ask.target(places[name]).reshape(-1, 4, 4)[0, :3, 3] for name in reached}
    visits = tuple(
        Visit(name, (float(p[0]), float(p[1]), float(p[2])), tool) for name, p in where.items()
    )
    problem = PoseProblem(
        tool,
        (Visit(HOME_VISIT, None, tool), *visits),
        (world.configurations[arm][None, :], *reached.values()),
        np.array([joint.speed or REST_SPEED for joint in joints]),
    )
    return PosedTour(tool, arm, problem, with_poses(problem, limits))


NEAREST_VISITS = 20  # visits whose travel times are known before the tour is looked for
MAX_TOUR_ROUNDS = 20
TOUR_COSTS_PER_S = 1e6
NEVER_S = 1e6  # where no path is known


@dataclass(frozen=True, slots=True, eq=False)
class DrivenTour:
    """A tour of one tool: its visits in order, the time of each move from there on (s), and how far
    the whole may be too long.

    `moves_s` (n,) include the straight lines out and in. `bound_s` is what the moves take at the
    least. `planned` ways had to be planned one by one; `unreached` visits have no straight line out
    of them, and are left out.
    """

    posed: PosedTour
    visits: tuple[str, ...]
    moves_s: tuple[float, ...]
    bound_s: float
    planned: int
    unreached: dict[str, str]

    @property
    def time_s(self) -> float:
        """Of the whole closed tour, without the measurements."""
        return sum(self.moves_s)


def driven_tours(
    problem: Problem, cell: Cell, backend: GeometryBackend, effort: Effort = Effort()
) -> tuple[tuple[DrivenTour, ...], ToolPartition]:
    """For each tool and arm a closed tour by the times of free paths. Raises `InvalidInput`."""
    tours, parts = posed_tours(problem, cell, backend, effort)
    world = GeometricWorld.of(cell)
    reach = PlaceReachability(world, backend)
    return tuple(_drive_tour(problem, world, reach, tour, effort) for tour in tours), parts


def _drive_tour(
    problem: Problem,
    world: GeometricWorld,
    reach: PlaceReachability,
    posed: PosedTour,
    effort: Effort,
) -> DrivenTour:
    names = [posed.problem.visits[visit].name for visit in posed.tour.order]
    place = problem.domain.conventions.place
    places = {
        name: None if name == HOME_VISIT else world.cell.places[place(name)] for name in names
    }
    travel_ends = travel_stations(world, reach, posed.arm, places, list(posed.configurations))
    return DrivenTour(posed, *_order_visits(travel_ends, effort), dict(travel_ends.unreached))


def _order_visits(
    at: TravelStations, effort: Effort
) -> tuple[tuple[str, ...], tuple[float, ...], float, int]:
    """The visits in order, the times of the moves, what they take at the least, and how many
    ways were planned.
    """
    ground, nodes, own, limits = at.ground, at.nodes, at.hand.own, at.limits
    names, outs, count = at.names, at.outs_s, len(at.nodes)
    roadmap = map_nodes(ground, nodes, nearest_node_pairs(nodes[:, own], limits, NEAREST_VISITS))
    travelled, roadmap = travel_times(ground, roadmap, roadmap.edges, limits, own)
    least = at.least()
    costs, planned = least.copy(), travelled.planned
    _enter_costs(costs, travelled)
    known_pairs = {tuple(pair) for pair in travelled.pairs.tolist()}
    order = tuple(range(count))
    for _ in range(MAX_TOUR_ROUNDS):
        order = _best_order(costs + outs[:, None] + outs[None], names, effort)
        ring = np.sort(np.stack([order, np.roll(order, -1)], axis=1), axis=1)
        new = np.array(
            [pair for pair in ring.tolist() if tuple(pair) not in known_pairs], dtype=np.int64
        )
        if not len(new) or count < 3:
            break
        roadmap = replace(
            roadmap,
            edges=np.concatenate([roadmap.edges, new]),
            free=np.concatenate([roadmap.free, map_nodes(ground, roadmap.nodes, new).free]),
        )
        travelled, roadmap = travel_times(ground, roadmap, new, limits, own)
        planned += travelled.planned
        _enter_costs(costs, travelled)
        known_pairs |= {tuple(pair) for pair in new.tolist()}
    after = np.roll(order, -1)
    if not (costs[order, after] < NEVER_S).all():
        n = int(np.argmax(costs[order, after]))
        message = f"no path was found from {names[order[n]]} to {names[after[n]]}"
        hint = "`cellwright motion plan` between the two shows what is in the way"
        raise InvalidInput([Diagnostic(Source("--cost motion"), "K705", message, hint)])
    extra = outs[list(order)] + outs[after]
    moves = costs[order, after] + extra
    bound = float((least[order, after] + extra).sum())
    return tuple(names[n] for n in order), tuple(map(float, moves)), bound, planned


def _enter_costs(costs: Floats, travelled: TravelTimes) -> None:
    a, b = travelled.pairs[:, 0], travelled.pairs[:, 1]
    costs[a, b] = costs[b, a] = np.where(np.isfinite(travelled.time_s), travelled.time_s, NEVER_S)


def _best_order(costs: Floats, names: Sequence[str], effort: Effort) -> tuple[int, ...]:
    """The order of the visits, from the first one."""
    travel: Longs = np.rint(costs * TOUR_COSTS_PER_S).astype(np.int64)
    np.fill_diagonal(travel, 0)
    asked = TourProblem("motion", tuple(Visit(name) for name in names), travel, start=0, unit="µs")
    answer = sequence_tour(asked, effort)
    assert isinstance(answer, Tour)
    return answer.order
