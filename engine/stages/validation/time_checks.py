"""Whether the times of a plan keep windows and calendars, by what the checker saw each step do."""

from collections.abc import Iterator, Mapping, Sequence

from cellwright.engine.model.window_breaches import PlanEvents, occurrences_of, off_hours
from cellwright.engine.stages.validation.step_changes import State
from cellwright.engine.stages.validation.step_interference import ExecutedStep
from cellwright.kb.model.plan_model import Plan, StepId
from cellwright.kb.model.planning_problem import Problem


def broken_times(
    problem: Problem,
    plan: Plan,
    starts: Mapping[StepId, int],
    executed: Sequence[ExecutedStep],
    initial: State,
) -> Iterator[tuple[str, str]]:
    """Each window that must be kept and is broken, with its amount, and each step that its calendar
    does not allow at its time; each with where the file says so.
    """
    changes = [(each.change.adds, each.change.ends, each.change.events) for each in executed]
    said = occurrences_of([step.operator for step in plan.steps], changes, initial)
    hard = [window for window in problem.all_windows if window.is_hard]
    unit = problem.domain.time_unit
    for breach in dict.fromkeys(PlanEvents(plan, starts, said).breaches(hard)):
        yield breach.text(unit), f"the window is at {breach.window.where}"
    for outside in off_hours(plan, starts, problem.all_calendars):
        yield outside.text(unit), f"the calendar is at {outside.calendar.where}"
