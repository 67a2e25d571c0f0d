"""Answers `plan --pddl` for a PDDL task with durative actions or timed literals."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from cellwright.engine.faces.cli.output.answer_output import AnswerForm, VerbAnswer, give_answer
from cellwright.engine.faces.cli.output.plan_forms import PlanForm
from cellwright.engine.faces.cli.process.exit_codes import GAVE_UP, INFEASIBLE, INTERRUPTED, LIMIT
from cellwright.engine.faces.cli.wrong_options import refuse_idle

if TYPE_CHECKING:
    from cellwright.engine.faces.cli.process.search_interruption import SearchInterruption
    from cellwright.engine.pipelines.planning.temporal_plans import TimeEffort
    from cellwright.kb.terms import Function

CODES = {"optimal": 0, "found": 0, "infeasible": INFEASIBLE, "gave up": GAVE_UP, "stopped": LIMIT}
# of a time limit is for the search; the rest is for the checker and for what is printed
SHARE = 0.93


@dataclass(frozen=True, slots=True)
class TimedRequest:
    """The files of a task with times, and the limits of the search (seconds, expansions)."""

    domain: Path
    problem: Path
    seconds: float | None
    expansions: int | None
    anytime: bool
    seed: int


def give_timed(
    wanted: TimedRequest,
    idle: Mapping[str, object],
    form: PlanForm,
    stats: bool,
    output: Path | None,
) -> None:
    """Plan a PDDL task with times, print the plan and exit; return where the task has no times.

    Options of `idle` are refused.
    """
    if not _is_timed(wanted):
        return
    pictures = {f"--format {form}": form in (PlanForm.DOT, PlanForm.SVG)}
    refuse_idle({**idle, **pictures}, "on a PDDL task with times: its plans have a small makespan")
    kind = AnswerForm.JSON if form is PlanForm.JSON else AnswerForm.TEXT
    give_answer(lambda: _answer(wanted, form, stats), kind, output)


def _is_timed(wanted: TimedRequest) -> bool:
    """Whether the task has times.

    Files that cannot be read are left to the reader of tasks without times, which tells that.
    """
    from cellwright.engine.formats.interop.pddl import durative
    from cellwright.kb.diagnostics import InvalidInput

    try:
        return durative.has_times(wanted.domain, wanted.problem)
    except InvalidInput:
        return False


def _answer(wanted: TimedRequest, form: PlanForm, stats: bool) -> VerbAnswer:
    from cellwright.engine.faces.cli.process.search_interruption import SearchInterruption
    from cellwright.engine.formats.interop.pddl import durative
    from cellwright.engine.formats.interop.pddl.durative.plans import timed_words, write_timed_plan
    from cellwright.engine.formats.report.plans import timed_plan_report
    from cellwright.engine.model.temporal import NoPlanInTime
    from cellwright.engine.pipelines.planning.temporal_plans import plan_with_times

    task = durative.read_temporal(wanted.domain, wanted.problem)
    with SearchInterruption(wanted.seconds) as interrupted:
        outcome = plan_with_times(task.problem, _effort(wanted, interrupted))
    raw = None
    if form is PlanForm.IPC and not isinstance(outcome, NoPlanInTime):
        raw = write_timed_plan(task, outcome.plan)

    def named(action: "Function") -> str:
        return f"({' '.join(timed_words(task, action))})"

    return VerbAnswer(
        timed_plan_report.status(outcome),
        timed_plan_report.document(outcome, named, stats) if form is PlanForm.JSON else {},
        text=lambda: timed_plan_report.text(outcome, named, stats),
        code=INTERRUPTED if interrupted.heard else CODES[timed_plan_report.status(outcome)],
        diagnostics=task.warnings,
        raw=raw,
    )


def _effort(wanted: TimedRequest, interrupted: "SearchInterruption") -> "TimeEffort":
    """When the search ends: at a share of the time limit. `--anytime` makes it use all of that."""
    import time

    from cellwright.engine.pipelines.planning.temporal_plans import TimeEffort
    from cellwright.engine.stages.planning import expansions_within

    end = None
    if interrupted.deadline is not None and wanted.seconds is not None:
        end = interrupted.deadline - (1 - SHARE) * wanted.seconds

    def over() -> bool:
        return interrupted() or (end is not None and time.monotonic() >= end)

    most = expansions_within(wanted.expansions, wanted.seconds)
    return TimeEffort(over, most, wanted.anytime, wanted.seed)
