"""The tour through what is left of a kept sequence, from the last visit that is done."""

from collections.abc import Mapping
from dataclasses import replace

from cellwright.engine.model.tour import TourProblem, Visit, times_of
from cellwright.engine.pipelines.inspection.demands import Demands, later, of_facts, with_demands
from cellwright.engine.pipelines.inspection.stations import stations_of
from cellwright.engine.pipelines.inspection.ways import ordered
from cellwright.kb.diagnostics import Source
from cellwright.kb.loader.amounts import amounts_of
from cellwright.kb.model.problem import Problem
from cellwright.kb.store.sequences import PlannedVisit, SequencePlan

Visits = tuple[PlannedVisit, ...]


def tour_of_rest(
    plan: SequencePlan, rest: Visits, phases: Mapping[str, int], inspection: Problem
) -> tuple[TourProblem, int]:
    """The tour problem of the rest, and 1 if it starts with the last visit done, else 0. Raises `InvalidInput`.

    Windows count from the start of the whole tour. What is done counts as having begun when the tour says.
    """
    before = plan.done[-1:]
    first = min(phases.values(), default=0)
    facts = amounts_of(inspection).facts
    demands = of_facts(facts, inspection.domain.conventions, Source(inspection.path))
    stations, shifts = stations_of(facts, inspection.domain.conventions)
    visits = tuple(
        Visit(
            each.name,
            each.position or None,
            each.tool,
            phase=first if number < len(before) else phases.get(each.name, 0),
            station=stations.get(each.name, ""),
        )
        for number, each in enumerate((*before, *rest))
    )
    made = _ordered(plan, visits, inspection, demands, 0 if before else None)
    if before:
        over = _begun(plan, inspection, demands) if demands.windows else 0
        demands = later(demands, over, {before[0].name})
    return with_demands(replace(made, shifts=shifts), demands), len(before)


def _ordered(
    plan: SequencePlan,
    visits: tuple[Visit, ...],
    inspection: Problem,
    demands: Demands,
    start: int | None = None,
) -> TourProblem:
    changes = {(a, b): cost for a, b, cost in plan.changes}
    facts = amounts_of(inspection).facts
    return ordered(inspection, plan.problem, visits, changes, start, facts=facts, in_time=demands.need_times)


def _begun(plan: SequencePlan, inspection: Problem, demands: Demands) -> int:
    """When the last visit done has begun, as the tour through all that is done has it, after the start of that tour."""
    visits = tuple(Visit(each.name, each.position or None, each.tool) for each in plan.done)
    tour = with_demands(_ordered(plan, visits, inspection, demands), replace(demands, before=()))
    return times_of(tour, tuple(range(len(visits))))[-1][1]
