"""Which windows and calendars a plan with times breaks, and what becomes of such a plan.

A plan that breaks a hard window is not given out. One that breaks a window with a price is, with
what that costs.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from cellwright.engine.model.outcome import GaveUp, Infeasible
from cellwright.engine.model.shop_scheduling import Timetable
from cellwright.engine.model.window_breaches import (
    Joining,
    Occurrence,
    OffHours,
    PlanEvents,
    WindowBreach,
    WindowSpan,
    occurrences_of,
    off_hours,
)
from cellwright.engine.pipelines.planning.window_proofs import find_impossible_window
from cellwright.engine.stages.lifted.cell_domain import CellDomain, Situation
from cellwright.engine.stages.lifted.lifted_execution import changes_of
from cellwright.engine.stages.scheduling.window_lags import StepLag, lags_in_order
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.kb.model.plan_model import Plan, StepId
from cellwright.kb.model.planning_problem import Problem

MAX_NAMED_BREACHES = 3  # in the reason why there is no plan


def is_bound_in_time(problem: Problem) -> bool:
    """Whether a problem has windows between events, or calendars."""
    return bool(problem.all_windows or problem.all_calendars)


def occurrences_in(
    problem: Problem, plan: Plan, known: Semantics, every: bool = False
) -> list[Occurrence]:
    """What the steps of a plan that is right do, in its order."""
    start = Situation.of(CellDomain(problem), known.initial())
    changes = changes_of(start, plan.steps)
    return occurrences_of(
        [step.operator for step in plan.steps],
        [(change.adds, change.ends, change.events) for change in changes],
        start.state,
        every,
    )


def joins_the_same(problem: Problem, plan: Plan, known: Semantics | None = None) -> bool:
    """Whether the windows join the same steps in every order of the steps of a plan."""
    if not problem.all_windows:
        return True
    joining = Joining(occurrences_in(problem, plan, known or Semantics(problem), every=True))
    return all(joining.is_fixed(window) for window in problem.all_windows)


def lags_of_plan(problem: Problem, plan: Plan, known: Semantics | None = None) -> list[StepLag]:
    """The windows as times between the steps of a plan, by their places, if they keep its order."""
    if not problem.all_windows:
        return []
    occurrences = occurrences_in(problem, plan, known or Semantics(problem))
    return lags_in_order(problem.all_windows, occurrences, [s.duration for s in plan.steps])


def find_breaches(
    problem: Problem, plan: Plan, starts: Mapping[StepId, int], known: Semantics
) -> tuple[WindowBreach, ...]:
    """The windows that a plan which is right breaks when its steps start at these times."""
    breaches = (span.breach() for span in find_spans(problem, plan, starts, known))
    return tuple(breach for breach in breaches if breach is not None)


def find_spans(
    problem: Problem, plan: Plan, starts: Mapping[StepId, int], known: Semantics
) -> tuple[WindowSpan, ...]:
    """The windows in a plan that is right, when its steps start at these times."""
    if not problem.all_windows:
        return ()
    events = PlanEvents(plan, starts, occurrences_in(problem, plan, known))
    return tuple(dict.fromkeys(events.spans(problem.all_windows)))


def judge_times(
    problem: Problem, timetable: Timetable, known: Semantics | None = None
) -> Timetable:
    """The timetable with the windows that it breaks and the steps outside their calendars.

    Then nothing is proved of it.
    """
    if not is_bound_in_time(problem):
        return timetable
    known = known or Semantics(problem)
    spans = find_spans(problem, timetable.plan, timetable.starts, known)
    breaches = (span.breach() for span in spans)
    broken = tuple(breach for breach in breaches if breach is not None)
    outside = tuple(off_hours(timetable.plan, timetable.starts, problem.all_calendars))
    judged = replace(timetable, breaches=broken, outside=outside, spans=spans)
    if judged.keeps_hours:
        return judged
    return replace(judged, schedule=replace(judged.schedule, proved=False))


def why_not_given(problem: Problem, timetable: Timetable) -> Infeasible | GaveUp:
    """Why a plan is not given out that breaks a window that must be kept, or a calendar."""
    unit = problem.domain.time_unit
    hard = [breach for breach in timetable.breaches if breach.window.is_hard]
    impossible = find_impossible_window(problem, hard, timetable.floor)
    if impossible is not None and impossible.is_needed:
        return Infeasible(f"no plan keeps this window: {impossible.text(unit)}")
    if impossible is not None:
        return GaveUp(f"no plan with both events keeps this window: {impossible.text(unit)}")
    return GaveUp(
        f"no plan was found that keeps all times: {_name_breaches(hard, timetable.outside, unit)}"
    )


def with_prices(problem: Problem) -> Problem:
    """The problem in which every window may be broken; those that may not be have a price that is
    more than that of all others.
    """
    dear = 1 + 10 * max((window.price or 0 for window in problem.all_windows), default=0)
    windows = tuple(
        replace(window, price=dear) if window.is_hard else window for window in problem.all_windows
    )
    return replace(problem, domain=replace(problem.domain, windows=()), windows=windows)


def _name_breaches(hard: Sequence[WindowBreach], outside: Sequence[OffHours], unit: str) -> str:
    said = [each.text(unit) for each in hard] + [each.text(unit) for each in outside]
    more = len(said) - MAX_NAMED_BREACHES
    named = "; ".join(said[:MAX_NAMED_BREACHES])
    return f"the best one has {named}" + (f"; and {more} more" if more > 0 else "")
