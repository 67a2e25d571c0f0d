"""Windows that a plan misses are met, if possible, by a tour that counts with the times of plans.

A tour knows ways, durations that facts give, and what a change of tools costs. A plan has steps between them. So what a plan
takes from the begin of one measurement to that of the next is given back to the tour, which is then put in order again.
"""

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from statistics import median_low

from cellwright.engine.model.outcome import Found, Outcome
from cellwright.engine.model.tour import Tour, TourProblem
from cellwright.engine.model.windows import visits_of
from cellwright.engine.pipelines.gate import PlanGate
from cellwright.engine.pipelines.parts.itinerary import PROOF, Itinerary
from cellwright.engine.pipelines.timetable.kept import kept
from cellwright.engine.pipelines.timetable.wishes import wishes_for
from cellwright.engine.stages.scheduling.work import Wishes
from cellwright.engine.stages.sequencing import Limits, sequence
from cellwright.kb.model.plan import Plan
from cellwright.kb.model.problem import Problem

ROUNDS = 4  # tours that are tried after the first
Planned = Callable[[Itinerary], Outcome | None]


@dataclass(frozen=True)
class _Try:
    """A plan along a tour, how many windows it misses, and when its measurements begin if nobody waits."""

    way: Itinerary
    outcome: Found
    missed: int
    begins: Sequence[int]


def punctual(
    problem: Problem, way: Itinerary, outcome: Outcome, planned: Planned, limits: Limits
) -> tuple[Outcome, Itinerary]:
    """The plan along a tour, or along another one if that misses fewer windows. `planned` makes the plan along a tour."""
    if not isinstance(outcome, Found) or not way.problem.timed:
        return outcome, way
    best = now = _tried(problem, way, outcome)
    limits, orders = replace(limits, proof=PROOF), {way.tour.order}
    for _ in range(ROUNDS):
        if not best.missed or limits.interrupted():
            break
        asked = as_planned(now.way, now.begins)
        tour = sequence(asked, limits)
        if not isinstance(tour, Tour):
            best = replace(best, way=replace(best.way, unkept=tour.reason))
            break
        if tour.order in orders:
            break
        orders.add(tour.order)
        other = _along(now.way, asked, tour)
        found = planned(other)
        if not isinstance(found, Found):
            break
        now = _tried(problem, other, found)
        best = min(best, now, key=lambda each: each.missed)
    return best.outcome, best.way


def as_planned(way: Itinerary, begins: Sequence[int]) -> TourProblem:
    """The tour with the durations and changes of tools that a plan along it has; `begins` are those of its visits in order."""
    problem, order = way.problem, way.tour.order
    plain = replace(problem, changes={}).lengths(order)
    spans = [then - now - lasts for (now, then), lasts in zip(pairwise(begins), plain, strict=True)]
    tools = [problem.visits[each].tool for each in order]
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


def _along(way: Itinerary, asked: TourProblem, tour: Tour) -> Itinerary:
    visits = tuple((asked.visits[n].name, asked.visits[n].tool) for n in tour.order)
    return replace(way, visits=visits, problem=asked, tour=tour, unkept="")


def _tried(problem: Problem, way: Itinerary, outcome: Found) -> _Try:
    plan, wishes = outcome.plan, wishes_for(PlanGate().semantics(problem), outcome.plan)
    late = len(kept(problem, plan, wishes).missed)
    return _Try(way, outcome, late, _begins(problem, plan, way, replace(wishes, windows={})))


def _begins(problem: Problem, plan: Plan, way: Itinerary, wishes: Wishes) -> list[int]:
    """When the visits of a tour begin in its plan, in the order of the tour."""
    starts = kept(problem, plan, wishes).starts
    begins = {name: starts[step] for step, name in visits_of(problem, plan).items()}
    return [begins[name] for name, _ in way.visits]
