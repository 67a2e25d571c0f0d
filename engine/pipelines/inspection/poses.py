"""Tours of measurements whose places a cell describes, one tool at a time, with configurations by inverse kinematics.

The cost of a move is the time of its slowest joint. A joint of unknown speed is assumed to move at 1 rad/s. Collisions at
the places are checked here. Collisions on the way between them are not.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.tour import PoseProblem, Tour, Visit
from cellwright.engine.pipelines.inspection import Partition, partition
from cellwright.engine.ports import GeometryBackend
from cellwright.engine.stages.geometry.reach.reach import Reachability, Unreached
from cellwright.engine.stages.geometry.world.model import World
from cellwright.engine.stages.sequencing import Limits
from cellwright.engine.stages.sequencing.poses import with_poses
from cellwright.kb.model.cell import Cell, Place
from cellwright.kb.model.problem import Problem

HOME = "home"
SPEED = 1.0


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
    problem: Problem, cell: Cell, backend: GeometryBackend, limits: Limits = Limits()
) -> tuple[tuple[PosedTour, ...], Partition]:
    """For each tool and arm a tour of all measurements that the arm reaches, and the partition of the measurements.

    A measurement that the arm does not reach is listed as impossible, with the reason. Raises `InvalidInput`.
    """
    named = {name: problem.domain.conventions.place(name) for name in problem.objects}
    places = {name: cell.places[place] for name, place in named.items() if place in cell.places}
    parts = partition(problem, places)
    world = World.of(cell)
    ask = Reachability(world, backend)
    tours: list[PosedTour] = []
    groups: dict[str, tuple[str, ...]] = {}
    impossible = dict(parts.impossible)
    for tool, names in parts.groups.items():
        reached, unreached = _reached(ask, {name: places[name] for name in names})
        impossible |= unreached
        groups |= {tool: tuple(reached)} if reached else {}
        for arm in sorted({places[name].arm for name in reached}):
            own = {name: q for name, q in reached.items() if places[name].arm == arm}
            tours.append(_tour(world, tool, arm, own, ask, places, limits))
    return tuple(tours), replace(parts, groups=groups, impossible=impossible)


def _reached(ask: Reachability, places: Mapping[str, Place]) -> tuple[dict[str, Floats], dict[str, str]]:
    answers = {name: ask.at(place) for name, place in places.items()}
    return (
        {name: answer.q for name, answer in answers.items() if not isinstance(answer, Unreached)},
        {name: answer.reason for name, answer in answers.items() if isinstance(answer, Unreached)},
    )


def _tour(
    world: World,
    tool: str,
    arm: str,
    reached: Mapping[str, Floats],
    ask: Reachability,
    places: Mapping[str, Place],
    limits: Limits,
) -> PosedTour:
    joints = world.cell.arms[arm].arm.joints
    where = {name: ask.target(places[name]).reshape(-1, 4, 4)[0, :3, 3] for name in reached}
    visits = tuple(Visit(name, (float(p[0]), float(p[1]), float(p[2])), tool) for name, p in where.items())
    problem = PoseProblem(
        tool,
        (Visit(HOME, None, tool), *visits),
        (world.configurations[arm][None, :], *reached.values()),
        np.array([joint.speed or SPEED for joint in joints]),
    )
    return PosedTour(tool, arm, problem, with_poses(problem, limits))
