"""Finds a tour whose plan misses fewer time windows, by counting with the times of real plans.

A tour knows ways, durations that facts give, and what a change of tools costs. A plan has steps
between them. So what a plan takes from the begin of one measurement to that of the next is given
back to the tour, which is then put in order again.
"""

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from statistics import median_low

from cellwright.engine.model.outcome import Found, Outcome
from cellwright.engine.model.time_limits import measured_steps
from cellwright.engine.model.tour_problem import Tour, TourProblem
from cellwright.engine.pipelines.planning.decomposition.measurement_order import (
    SEQUENCE_PROOF,
    Itinerary,
)
from cellwright.engine.pipelines.planning.dwell_limits import wishes_for
from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.pipelines.planning.timetable.kept_order import order_keeping_timetable
from cellwright.engine.stages.scheduling.shop_translation import Wishes
from cellwright.engine.stages.sequencing import TourLimits, sequence_tour
from cellwright.kb.model.plan_model import Plan
from cellwright.kb.model.planning_problem import Problem

MAX_RETRIED_TOURS = 4  # tours that are tried after the first
Planned = Callable[[Itinerary], Outcome | None]


@dataclass(frozen=True)
class _TourTry:
    """A plan along a tour, how many windows it misses, and when its measurements begin if
    nobody waits.
    """

    way: Itinerary
    outcome: Found
    missed: int
    begins: Sequence[int]


def meet_windows(
    problem: Problem, route: Itinerary, outcome: Outcome, planned: Planned, limits: TourLimits
) -> tuple[Outcome, Itinerary]:
    """The plan along a tour, or along another one if that misses fewer windows.

    `planned` makes the plan along a tour.
    """
    if not isinstance(outcome, Found) or not route.problem.timed:
        return outcome, route
    best = now = _try_tour(problem, route, outcome)
    limits, orders = replace(limits, proof=SEQUENCE_PROOF), {route.tour.order}
    for _ in range(MAX_RETRIED_TOURS):
        if not best.missed or limits.interrupted():
            break
        asked = as_planned(now.way, now.begins)
        tour = sequence_tour(asked, limits)
        if not isinstance(tour, Tour):
            best = replace(best, way=replace(best.way, unkept=tour.reason))
            break
        if tour.order in orders:
            break
        orders.add(tour.order)
        other_route = _itinerary_along(now.way, asked, tour)
        other_outcome = planned(other_route)
        if not isinstance(other_outcome, Found):
            break
        now = _try_tour(problem, other_route, other_outcome)
        best = min(best, now, key=lambda attempt: attempt.missed)
    return best.outcome, best.way


def as_planned(route: Itinerary, begins: Sequence[int]) -> TourProblem:
    """The tour with the durations and changes of tools that a plan along it has; `begins` are
    those of its visits in order.
    """
    problem, order = route.problem, route.tour.order
    plain = replace(problem, changes={}).lengths(order)
    spans = [then - now - lasts for (now, then), lasts in zip(pairwise(begins), plain, strict=True)]
    tools = [problem.visits[visit_number].tool for visit_number in order]
    alike = {n for n in range(len(spans)) if tools[n] == tools[n + 1]}
    usual = defaultdict[str, list[int]](list)
    for n in alike:
        usual[tools[n]].append(spans[n])
    lasts = {
        at: max(0, spans[n] if n in alike else median_low(usual[tools[n]] or [0]))
        for n, at in enumerate(order)
    }
    changes = dict(problem.changes)
    for n in set(range(len(spans))) - alike:
        changes[tools[n], tools[n + 1]] = max(0, spans[n] - lasts[order[n]])
    visits = tuple(replace(visit, duration=lasts[at]) for at, visit in enumerate(problem.visits))
    return replace(problem, visits=visits, changes=changes)


def _itinerary_along(route: Itinerary, asked: TourProblem, tour: Tour) -> Itinerary:
    visits = tuple((asked.visits[n].name, asked.visits[n].tool) for n in tour.order)
    return replace(route, visits=visits, problem=asked, tour=tour, unkept="")


def _try_tour(problem: Problem, route: Itinerary, outcome: Found) -> _TourTry:
    plan, wishes = outcome.plan, wishes_for(PlanGate().semantics(problem), outcome.plan)
    late = len(order_keeping_timetable(problem, plan, wishes).missed)
    return _TourTry(
        route, outcome, late, _visit_begins(problem, plan, route, replace(wishes, windows={}))
    )


def _visit_begins(problem: Problem, plan: Plan, route: Itinerary, wishes: Wishes) -> list[int]:
    """When the visits of a tour begin in its plan, in the order of the tour."""
    starts = order_keeping_timetable(problem, plan, wishes).starts
    begins = {name: starts[step] for step, name in measured_steps(problem, plan).items()}
    return [begins[name] for name, _ in route.visits]
