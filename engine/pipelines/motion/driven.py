"""Tours whose costs are the times of free paths: what `sequence --cost motion` counts.

Each visit keeps the configuration that the tour by joint times gives it. The arm goes straight out of a visit, on a free path
to the next one, and straight in. A roadmap tells the times to the nearest visits; to all others the least time counts, which no
path beats, until the tour takes such a way: then it is planned, and the tour is looked for again.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cellwright.engine.model.geometry import Floats, Longs
from cellwright.engine.model.tour import Tour, TourProblem, Visit
from cellwright.engine.pipelines.inspection import Partition
from cellwright.engine.pipelines.inspection.poses import HOME, PosedTour, posed_tours
from cellwright.engine.pipelines.motion.stations import Stations, stations
from cellwright.engine.ports import GeometryBackend
from cellwright.engine.stages.geometry.reach.reach import Reachability
from cellwright.engine.stages.geometry.world.model import World
from cellwright.engine.stages.motion.roadmap import Travels, mapped, neighbours, travels
from cellwright.engine.stages.sequencing import Limits as Effort
from cellwright.engine.stages.sequencing import sequence
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.model.cell import Cell
from cellwright.kb.model.problem import Problem

NEAR = 20  # visits whose travel times are known before the tour is looked for
ROUNDS = 20
MICROSECONDS = 1e6
NEVER_S = 1e6  # where no path is known


@dataclass(frozen=True, slots=True, eq=False)
class DrivenTour:
    """A tour of one tool: its visits in order, the time of each move from there on (s), and how far the whole may be too long.

    `moves_s` (n,) include the straight lines out and in. `bound_s` is what the moves take at the least. `planned` ways had to be
    planned one by one; `unreached` visits have no straight line out of them, and are left out.
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
) -> tuple[tuple[DrivenTour, ...], Partition]:
    """For each tool and arm a closed tour by the times of free paths. Raises `InvalidInput`."""
    tours, parts = posed_tours(problem, cell, backend, effort)
    world = World.of(cell)
    reach = Reachability(world, backend)
    return tuple(_driven(problem, world, reach, each, effort) for each in tours), parts


def _driven(
    problem: Problem, world: World, reach: Reachability, posed: PosedTour, effort: Effort
) -> DrivenTour:
    names = [posed.problem.visits[visit].name for visit in posed.tour.order]
    place = problem.domain.conventions.place
    places = {name: None if name == HOME else world.cell.places[place(name)] for name in names}
    found = stations(world, reach, posed.arm, places, list(posed.configurations))
    return DrivenTour(posed, *_toured(found, effort), dict(found.unreached))


def _toured(at: Stations, effort: Effort) -> tuple[tuple[str, ...], tuple[float, ...], float, int]:
    """The visits in order, the times of the moves, what they take at the least, and how many ways were planned."""
    ground, nodes, own, limits = at.ground, at.nodes, at.hand.own, at.limits
    names, outs, count = at.names, at.outs_s, len(at.nodes)
    roadmap = mapped(ground, nodes, neighbours(nodes[:, own], limits, NEAR))
    found, roadmap = travels(ground, roadmap, roadmap.edges, limits, own)
    least = at.least()
    costs, planned = least.copy(), found.planned
    _enter(costs, found)
    known = {tuple(pair) for pair in found.pairs.tolist()}
    order = tuple(range(count))
    for _ in range(ROUNDS):
        order = _order(costs + outs[:, None] + outs[None], names, effort)
        ring = np.sort(np.stack([order, np.roll(order, -1)], axis=1), axis=1)
        new = np.array([pair for pair in ring.tolist() if tuple(pair) not in known], dtype=np.int64)
        if not len(new) or count < 3:
            break
        roadmap = replace(
            roadmap,
            edges=np.concatenate([roadmap.edges, new]),
            free=np.concatenate([roadmap.free, mapped(ground, roadmap.nodes, new).free]),
        )
        found, roadmap = travels(ground, roadmap, new, limits, own)
        planned += found.planned
        _enter(costs, found)
        known |= {tuple(pair) for pair in new.tolist()}
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


def _enter(costs: Floats, found: Travels) -> None:
    a, b = found.pairs[:, 0], found.pairs[:, 1]
    costs[a, b] = costs[b, a] = np.where(np.isfinite(found.time_s), found.time_s, NEVER_S)


def _order(costs: Floats, names: Sequence[str], effort: Effort) -> tuple[int, ...]:
    """The order of the visits, from the first one."""
    travel: Longs = np.rint(costs * MICROSECONDS).astype(np.int64)
    np.fill_diagonal(travel, 0)
    asked = TourProblem("motion", tuple(Visit(name) for name in names), travel, start=0, unit="µs")
    answer = sequence(asked, effort)
    assert isinstance(answer, Tour)
    return answer.order
