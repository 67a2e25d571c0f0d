"""From a problem in time to a checked plan: grounding, search, and the checker's verdict."""

from collections.abc import Callable
from dataclasses import dataclass

from cellwright.engine.kernels.cancellation import Interrupted, never
from cellwright.engine.model.temporal import NoPlanInTime, PlannedInTime
from cellwright.engine.pipelines.planning.plan_gate import InternalError
from cellwright.engine.stages.instants import Breach, breaches
from cellwright.engine.stages.temporal.grounding import ground_times
from cellwright.engine.stages.temporal.portfolio import plan_over_time
from cellwright.kb.diagnostics import Diagnostic, Source
from cellwright.kb.model.durative import TemporalProblem, TimedPlan

MAX_EXPANSIONS = 1_000_000


@dataclass(frozen=True, slots=True)
class TimeEffort:
    """When the search in time ends, and with what it begins."""

    interrupted: Interrupted = never
    expansions: int = MAX_EXPANSIONS
    thorough: bool = False
    seed: int = 0
    improved: Callable[[TimedPlan], None] = lambda _: None


def plan_with_times(
    problem: TemporalProblem, effort: TimeEffort = TimeEffort()
) -> PlannedInTime | NoPlanInTime:
    """A plan with a small makespan, which the checker accepts. Raises `InvalidInput` for what is
    not supported.

    That no plan exists is said only where it is proved; the end of the time or of the effort is
    told as that.
    """
    task = ground_times(problem)
    outcome = plan_over_time(
        task, effort.interrupted, effort.seed, effort.thorough, effort.improved, effort.expansions
    )
    if outcome.proved_none:
        return NoPlanInTime("the goal cannot be reached, whatever the times", True)
    if outcome.plan is None:
        stopped = effort.interrupted()
        limit = "time" if stopped else "expansions"
        return NoPlanInTime(
            f"no plan within the limit of {limit}; that says nothing about whether one exists",
            False,
            limit,
        )
    if wrong := breaches(problem, outcome.plan):
        raise InternalError(timed_findings(wrong, "plan"))
    return PlannedInTime(outcome.plan, outcome.bound, outcome.counts)


def check_timed_plan(problem: TemporalProblem, plan: TimedPlan, name: str) -> list[Diagnostic]:
    """What the checker of time finds in a plan, as diagnostics of the file `name`."""
    return timed_findings(breaches(problem, plan), name)


def timed_findings(wrong: list[Breach], name: str) -> list[Diagnostic]:
    """Breaches as diagnostics."""
    return [Diagnostic(Source(name), breach.code, breach.message) for breach in wrong]
