"""Plans that move, of inspections too: first the poses of the measurements, then the order, the plan, and the motions."""

from collections.abc import Callable
from dataclasses import dataclass

from cellwright.engine.model.measurements import asked_for, chooses_tools, is_shared
from cellwright.engine.pipelines.moves.planning import Moving, plan_moving
from cellwright.engine.pipelines.moves.walking import Ways
from cellwright.engine.pipelines.objective import Run
from cellwright.engine.pipelines.poses import Knowledge, known_poses, with_stations
from cellwright.engine.pipelines.poses.keeping import kept_poses
from cellwright.engine.ports import GeometryBackend
from cellwright.kb.model.cell import Cell
from cellwright.kb.model.problem import Problem


@dataclass(frozen=True, slots=True, eq=False)
class MovingInspection:
    """A plan that moves, and what is known of the poses of its measurements; None if it has no measurements."""

    moving: Moving
    knowledge: Knowledge | None = None


def plan_with_poses(
    problem: Problem,
    cell: Cell,
    backend: GeometryBackend,
    planned: Callable[[Problem], Run],
    seed: int = 0,
    store: str = "",
) -> MovingInspection:
    """A plan in which every step moves. Poses come from the store, if one is given, and are kept there. Raises `InvalidInput`.

    Goals about measurements that no station reaches are given up. Where several arms share measurements, the sequence finds out who
    reaches them, and the walk through the plan finds the poses.
    """
    if not chooses_tools(problem.domain) or is_shared(problem):
        return MovingInspection(plan_moving(problem, cell, backend, planned, seed))
    knowledge = _of_wanted(problem, cell, backend, store)
    ways = _ways(problem, knowledge)
    told = with_stations(problem, knowledge)
    moving = plan_moving(told, cell, backend, planned, seed, ways, knowledge.unreached())
    return MovingInspection(moving, knowledge)


def known_ways(problem: Problem, cell: Cell, backend: GeometryBackend, store: str) -> Ways:
    """The straight ways into the places of measurements that a store has, or that are found now."""
    if not chooses_tools(problem.domain) or is_shared(problem):
        return {}
    return _ways(problem, _of_wanted(problem, cell, backend, store))


def _of_wanted(problem: Problem, cell: Cell, backend: GeometryBackend, store: str) -> Knowledge:
    """The poses of the measurements that are asked for: a few of a large part take no longer than those few."""
    only = asked_for(problem)
    if store:
        return kept_poses(store, problem, cell, backend, only)
    return known_poses(problem, cell, backend, only=only)


def _ways(problem: Problem, knowledge: Knowledge) -> Ways:
    words = problem.domain.conventions
    return {
        (words.place(name), station): each.straight
        for (name, _, station), each in knowledge.poses.items()
        if each.reached
    }
