"""PDDL tasks with times: read, planned, and their plans checked."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cellwright.engine.formats.interop.pddl import durative
from cellwright.engine.formats.interop.pddl.durative.plans import (
    read_timed_plan,
    timed_words,
    write_timed_plan,
)
from cellwright.engine.formats.report import rich_parts
from cellwright.engine.formats.report.plans import timed_plan_report
from cellwright.engine.model.temporal import NoPlanInTime, PlannedInTime
from cellwright.engine.pipelines.planning.temporal_plans import (
    TimeEffort,
    check_timed_plan,
    plan_with_times,
)
from cellwright.engine.stages.planning import expansions_within
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.model.durative import TimedPlan
from cellwright.library_base import Answer, Name, limit_seconds

if TYPE_CHECKING:
    from rich.console import RenderableType

    from cellwright.kb.terms import Function

TimedTask = durative.TemporalTask
# the part of a time limit that the search may use; the rest is for the checker
SEARCH_SHARE = 0.93


def read_timed_pddl(domain: Name, problem: Name) -> TimedTask:
    """A PDDL task with durative actions or timed literals.

    Raises `InvalidInput` for what is not supported, with its place.
    """
    return durative.read_temporal(Path(domain), Path(problem))


@dataclass(frozen=True, repr=False)
class TimedPlanned(Answer):
    """The result of planning a task with times: steps with their starts and durations, or why
    there are none.
    """

    task: TimedTask
    outcome: PlannedInTime | NoPlanInTime

    @property
    def plan(self) -> TimedPlan | None:
        """The plan, with exact times; None if there is none."""
        return self.outcome.plan if isinstance(self.outcome, PlannedInTime) else None

    @property
    def status(self) -> str:
        """optimal, found, infeasible (that is proved), gave up or stopped."""
        return timed_plan_report.status(self.outcome)

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]:
        """What of the task is not followed."""
        return self.task.warnings

    def data(self) -> Mapping[str, Any]:
        """The steps, the makespan and its lower bound over all plans, or the reason."""
        return timed_plan_report.document(self.outcome, self._name, stats=False)

    def ipc(self) -> str:
        """The plan as planning competitions write it. Raises `InvalidInput` without one."""
        return write_timed_plan(self.task, self.found().plan)

    def found(self) -> PlannedInTime:
        """The outcome with its plan. Raises `InvalidInput` without one."""
        if isinstance(self.outcome, PlannedInTime):
            return self.outcome
        missing = Diagnostic(Source("plan"), "K404", "there is no plan", self.outcome.reason)
        raise InvalidInput([missing])

    def _name(self, action: "Function") -> str:
        return f"({' '.join(timed_words(self.task, action))})"

    def _renderable(self) -> "RenderableType":
        return timed_plan_report.text(self.outcome, self._name, stats=False)


def plan_timed(
    task: TimedTask,
    *,
    anytime: bool = False,
    seconds: float | None = None,
    expansions: int | None = None,
    seed: int = 0,
) -> TimedPlanned:
    """A plan with a small makespan, accepted by the checker of time.

    With `anytime` it is improved until `seconds` are over. That no plan exists is said only where
    it is proved. Raises `InvalidInput`, `TimeoutError`.
    """
    with limit_seconds(None if seconds is None else SEARCH_SHARE * seconds) as over:
        most = expansions_within(expansions, seconds)
        effort = TimeEffort(over, most, thorough=anytime, seed=seed)
        return TimedPlanned(task, plan_with_times(task.problem, effort))


@dataclass(frozen=True, repr=False)
class TimedVerdict(Answer):
    """What the checker of time says of a plan. It counts as true if the plan is right."""

    plan: TimedPlan
    breaches: tuple[Diagnostic, ...]

    def __bool__(self) -> bool:
        return not self.breaches

    @property
    def status(self) -> str:
        """valid or invalid."""
        return "invalid" if self.breaches else "valid"

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]:
        """Every broken condition, with its time and by how much it is broken."""
        return self.breaches

    def data(self) -> Mapping[str, Any]:
        """How many steps the plan has, and its makespan."""
        return timed_plan_report.verdict(self.plan)[1]

    def _renderable(self) -> "RenderableType":
        if self.breaches:
            return rich_parts.Text("\n".join(map(str, self.breaches)))
        return rich_parts.Text(timed_plan_report.verdict(self.plan)[0])


def validate_timed(task: TimedTask, plan: "TimedPlan | TimedPlanned | Name") -> TimedVerdict:
    """Check a plan, or a plan file of any planner, by the text of PDDL 2.1.

    Raises `InvalidInput` for a file that is no plan of the task.
    """
    name = "plan"
    if isinstance(plan, TimedPlanned):
        plan = plan.found().plan
    elif not isinstance(plan, TimedPlan):
        name = str(plan)
        plan = read_timed_plan(task, Path(plan))
    return TimedVerdict(plan, tuple(check_timed_plan(task.problem, plan, name)))
