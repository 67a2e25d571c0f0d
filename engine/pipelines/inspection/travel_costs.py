"""Costs of travel between measurements: straight lines, or times by the domain's travel.

Straight ways are put in order by their lengths in micrometres, which are finer than whole units of
time. A table is put in order by its times.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from itertools import pairwise

import numpy as np

from cellwright.engine.model.tour_problem import Metric, TourProblem, Visit
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.loader.problem_amounts import amounts_of
from cellwright.kb.model.domain_model import Kind
from cellwright.kb.model.operator_amounts import Amounts, Facts, NoAmount, travels_itself
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Function, Term

STRAIGHT_UNIT = "µm"  # the unit of straight ways
MAX_DENSE_VISITS = 1000  # costs between more visits are computed when they are needed
Changes = Mapping[tuple[str, str], int]


def has_table(problem: Problem, facts: Facts) -> bool:
    """Whether travel times are put in order: facts give some, or durations ask for them and
    nothing else gives any.
    """
    domain, travel = problem.domain, problem.domain.conventions.travel
    declared = domain.predicates.get(travel)
    if declared is None or declared.kind is not Kind.STATIC or len(declared.arguments) != 3:
        return False
    return any(True for _ in facts(travel, 3)) or (domain.motion is None and travels_itself(domain))


def open_tour(
    problem: Problem,
    name: str,
    visits: tuple[Visit, ...],
    changes: Changes,
    start: int | None = None,
    *,
    facts: Facts,
    in_time: bool = False,
) -> TourProblem:
    """An open tour of measurements; `facts` gives the static facts. Raises `InvalidInput`.

    Straight ways and changes of tools are in micrometres, unless they must be `in_time`. Those of a
    table, and ways in time, are in the domain's unit of time.
    """
    if not has_table(problem, facts):
        if not in_time:
            return straight_tour(name, visits, changes, start)
        changes = _in_time(problem, changes)
    amounts, places = (
        amounts_of(problem, facts),
        _visited_places(problem, [visit.name for visit in visits]),
    )
    times = np.array(
        [[_travel_time(problem, amounts, a, b) for b in places] for a in places], np.int64
    )
    ways = times.reshape(len(visits), len(visits))
    return TourProblem(
        name,
        visits,
        ways,
        closed=False,
        start=start,
        changes=changes,
        unit=problem.domain.time_unit,
    )


def _in_time(problem: Problem, changes: Changes) -> Changes:
    """How long changes of tools take, if their ways are driven at the speed of the declared
    travel.
    """
    motion = problem.domain.motion
    if motion is None:
        message = "windows and durations need travel times, and the domain declares none"
        hint = "declare `motion:` with a speed, or a table travel(place, place, time)"
        raise InvalidInput([Diagnostic(Source(problem.path), "K405", message, hint)])
    return {pair: math.ceil(distance / motion.speed) for pair, distance in changes.items()}


def straight_tour(
    name: str, visits: tuple[Visit, ...], changes: Changes, start: int | None = None
) -> TourProblem:
    """An open tour of visits with known positions in metres.

    Travel costs are straight distances in micrometres.
    """
    lines = Metric(
        "micrometres", np.array([visit.position for visit in visits], float).reshape(-1, 3)
    )
    ways = lines if len(visits) > MAX_DENSE_VISITS else lines.matrix()
    return TourProblem(
        name, visits, ways, closed=False, start=start, changes=changes, unit=STRAIGHT_UNIT
    )


def time_between(problem: Problem, tour: TourProblem, order: Sequence[int]) -> int | None:
    """The declared travel time of all ways of an order between measurements by the same tool; None
    if there is none.

    It is in the domain's unit of time. Raises `InvalidInput` if a time cannot be told.
    """
    amounts = amounts_of(problem)
    if problem.domain.motion is None and not has_table(problem, amounts.facts):
        return None
    ends = [*order, *order[:1]] if tour.closed and len(order) > 1 else order
    legs = ((tour.visits[a], tour.visits[b]) for a, b in pairwise(ends))
    return sum(
        _travel_time(problem, amounts, *_visited_places(problem, (a.name, b.name)))
        for a, b in legs
        if a.tool == b.tool
    )


def _visited_places(problem: Problem, names: Collection[str]) -> list[Term]:
    return [Function(problem.domain.conventions.meas, (Function(name),)) for name in names]


def _travel_time(problem: Problem, amounts: Amounts, start_place: Term, end_place: Term) -> int:
    try:
        return amounts.travel_time(start_place, end_place)
    except NoAmount as error:
        where = problem.where if problem.where.path else Source(problem.path)
        raise InvalidInput([Diagnostic(where, "K115", str(error), error.hint)]) from None
