"""Answer of the planner as a whole: outcome, times, measurements, motions and origin of the
plan.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from cellwright.engine.formats.report import rich_parts
from cellwright.engine.pipelines import planning

if TYPE_CHECKING:
    from rich.console import RenderableType

    from cellwright.engine.model.robustness import RobustPlan
    from cellwright.engine.model.time_limits import Unmet
    from cellwright.engine.pipelines.motion.moving_plan import MovingRun
    from cellwright.engine.pipelines.planning.plan_objective import Run
    from cellwright.kb.diagnostics import Diagnostic
    from cellwright.kb.model.planning_problem import Problem


@dataclass(frozen=True, slots=True)
class PlanAnswer:
    """What planning made: the run for a problem.

    `origin` says where the plan comes from, `moving` holds the motions of its steps, `robust` says
    whether windows are kept whatever happens. Each is empty where nobody asked for it.
    """

    run: "Run"
    problem: "Problem"
    origin: Mapping[str, Any] = field(default_factory=dict)
    moving: "MovingRun | None" = None
    robust: "RobustPlan | None" = None


def plan_answer_content(plan_answer: PlanAnswer, stats: bool) -> dict[str, Any]:
    """The outcome as data, with its statistics if they were asked for."""
    from cellwright.engine.formats.report import json_answers
    from cellwright.engine.formats.report.plans.gantt_chart import proof_entry, window_entries

    run = plan_answer.run
    content = {
        **json_answers.outcome_entry(run.outcome, plan_answer.problem, starts=run.starts),
        **plan_answer.origin,
    }
    if run.itinerary:
        from cellwright.engine.formats.report.plans import itinerary_report

        content |= itinerary_report.itinerary_entry(run)
    if limits := _limits(plan_answer):
        content["timeouts_ms"] = {str(number): limit for number, limit in limits.items()}
    content |= _unmet_times(plan_answer).entry()
    if run.timetable:
        table = run.timetable
        content["makespan"] = proof_entry(table.schedule, table.scope, table.floor)
        content |= window_entries(table)
    if plan_answer.robust is not None:
        from cellwright.engine.formats.report.plans import robustness_report

        content["robustness"] = robustness_report.robustness_entry(plan_answer.robust)
    if stats:
        content["statistics"] = json_answers.statistics_entry(run.outcome.statistics)
    if plan_answer.moving is None:
        return content
    from cellwright.engine.formats.report.plans import plan_motions

    return {**content, **plan_motions.plan_motions_entry(plan_answer.moving)}


def _limits(plan_answer: PlanAnswer) -> Mapping[int, int]:
    """After how long without a reply the steps are given up, if there is a plan."""
    plan = getattr(plan_answer.run.outcome, "plan", None)
    if plan is None:
        return {}
    from cellwright.engine.formats.report.plans.reply_limits import reply_limits

    return reply_limits(plan, plan_answer.problem)


def plan_answer_text(plan_answer: PlanAnswer, stats: bool, folded: bool) -> "RenderableType":
    """The outcome as people read it; `folded`: the MACROPs in the plan stand for its steps."""
    from cellwright.engine.formats.report.plans import outcome_tables as report

    run = plan_answer.run
    by_geometry = plan_answer.moving is not None and bool(
        plan_answer.moving.given_up or plan_answer.moving.refused
    )
    shown = report.outcome_text(run.outcome, plan_answer.problem, run.timetable, by_geometry)
    parts = [shown, *origin_text(plan_answer.origin)]
    if folded and plan_answer.origin.get("source", {}).get("parts"):
        parts = parts[1:]
    if limits := _limits(plan_answer):
        from cellwright.engine.formats.report.plans.reply_limits import reply_limits_text

        parts.append(rich_parts.Text(reply_limits_text(limits)))
    if run.itinerary:
        from cellwright.engine.formats.report.plans import itinerary_report

        parts.append(itinerary_report.itinerary_text(run, plan_answer.problem.domain.time_unit))
    parts += [
        rich_parts.Text(line)
        for line in _unmet_times(plan_answer).lines(plan_answer.problem.domain.time_unit)
    ]
    if plan_answer.robust is not None:
        from cellwright.engine.formats.report.plans import robustness_report

        unit = plan_answer.problem.domain.time_unit
        lines = robustness_report.robustness_lines(plan_answer.robust, unit)
        parts += [rich_parts.Text(line) for line in lines]
    if plan_answer.moving is not None:
        from cellwright.engine.formats.report.plans import plan_motions

        parts += plan_motions.plan_motions_text(plan_answer.moving)
    return rich_parts.Group(
        *parts, *([report.statistics_table(run.outcome.statistics)] if stats else [])
    )


def _unmet_times(plan_answer: PlanAnswer) -> "Unmet":
    """What the problem asks of the times of measurements, and the plan does not keep."""
    from cellwright.engine.model.outcome import Found
    from cellwright.engine.model.time_limits import Unmet
    from cellwright.kb.model.plan_model import Claims

    outcome, starts = plan_answer.run.outcome, plan_answer.run.starts
    if not isinstance(outcome, Found) or starts is None:
        return Unmet()
    return planning.unmet_times(plan_answer.problem, outcome.plan, Claims(dict(starts)))


def library_warnings(content: Mapping[str, Any], store: str) -> "tuple[Diagnostic, ...]":
    """A warning if the library could not keep what was learned. The plan is no worse for it."""
    from cellwright.kb.diagnostics import Diagnostic, Source

    lost_text = content.get("source", {}).get("lost")
    message, hint = (
        f"nothing was kept: {lost_text}",
        "make room on the disk, start the server, or name another library",
    )
    return (Diagnostic(Source(store), "K416", message, hint, warning=True),) if lost_text else ()


def origin_text(content: Mapping[str, Any]) -> "list[RenderableType]":
    """A line about where a plan comes from, if a library was used, and the parts of the plan."""
    source = content.get("source")
    if not source:
        return []
    from cellwright.engine.formats.report.plans.library_report import folded_plan, plan_origin

    parts = folded_plan(source.get("parts", ()))
    origin_line = plan_origin(
        source["origin"],
        source["macrop"],
        source["name"],
        source["reason"],
        listed=parts is not None,
    )
    return [origin_part for origin_part in (parts, origin_line) if origin_part]
