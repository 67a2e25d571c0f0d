"""A schedule of a shop or of the steps of a plan: tables of starts, chart, and unmet windows."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from cellwright.engine.formats.report import rich_parts
from cellwright.engine.formats.report.text_tables import TextTable
from cellwright.engine.model.outcome import Found, Statistics
from cellwright.engine.model.shop_scheduling import Schedule, Shop, Timetable
from cellwright.engine.model.time_limits import Unmet
from cellwright.engine.pipelines import planning
from cellwright.kb.model.plan_model import Claims
from cellwright.kb.model.planning_problem import Problem

if TYPE_CHECKING:
    from rich.console import RenderableType

START_NUMBER_COLUMNS = ("end", "step")


def of_steps(timetable: Timetable, unit: str) -> TextTable:
    """The steps of a timetable in the order of their starts, with what they hold."""
    start = f"start ({unit})" if unit else "start"
    steps = sorted(timetable.plan.steps, key=lambda step: (timetable.starts[step.id], step.id))
    rows = [
        (
            str(timetable.starts[step.id]),
            str(timetable.starts[step.id] + step.duration),
            str(step.id),
            str(step.operator),
            ", ".join(map(str, step.resources)),
        )
        for step in steps
    ]
    return TextTable(
        (start, "end", "step", "operator", "holds"), rows, right=(start, *START_NUMBER_COLUMNS)
    )


def of_stages(shop: Shop, schedule: Schedule, unit: str = "") -> TextTable:
    """The stages of a shop and the changes of its devices in the order of their starts."""
    start = f"start ({unit})" if unit else "start"
    start_rows = [
        (
            schedule.starts[name],
            schedule.starts[name] + stage.duration,
            shop.owners[name].name,
            name.removeprefix(shop.owners[name].name).strip(" .:") or name,
            ", ".join(stage.resources),
        )
        for name, stage in shop.stages.items()
    ]
    start_rows += [
        (
            adjustment.start,
            adjustment.end,
            "",
            f"{adjustment.device} to {adjustment.change.after}",
            "",
        )
        for adjustment in schedule.adjustments
    ]
    rows = [(str(begin), str(end), *rest) for begin, end, *rest in sorted(start_rows)]
    return TextTable(
        (start, "end", "job", "stage", "on"), rows, right=(start, *START_NUMBER_COLUMNS)
    )


@dataclass(frozen=True, slots=True)
class ScheduleAnswer:
    """A schedule of the stages of a shop; of a plan if there is a `timetable`, with its problem
    and what it does not keep.
    """

    shop: Shop
    schedule: Schedule
    statistics: Statistics
    timetable: Timetable | None = None
    problem: Problem | None = None
    unmet: Unmet = field(default_factory=Unmet)

    @property
    def status(self) -> str:
        """`optimal` if it is proved that no schedule is shorter, else `found`."""
        return "optimal" if self.schedule.proved else "found"

    @property
    def unit(self) -> str:
        """The unit of its times; empty if nobody has said."""
        return self.problem.domain.time_unit if self.problem else ""


def of_plan(timetable: Timetable, problem: Problem) -> ScheduleAnswer:
    """The schedule of a plan for a problem, with the windows of measurements that it does not
    keep.
    """
    broken = planning.unmet_times(problem, timetable.plan, Claims(dict(timetable.starts)))
    return ScheduleAnswer(
        timetable.shop, timetable.schedule, timetable.statistics, timetable, problem, broken
    )


def schedule_content(schedule_answer: ScheduleAnswer, stats: bool = False) -> dict[str, Any]:
    """The schedule as data, with its statistics if they are asked for."""
    from cellwright.engine.formats.report import json_answers
    from cellwright.engine.formats.report.plans.gantt_chart import schedule_entry

    if schedule_answer.timetable is None or schedule_answer.problem is None:
        schedule_data: dict[str, Any] = {
            "schedule": schedule_entry(schedule_answer.shop, schedule_answer.schedule)
        }
    else:
        schedule_data = _of_plan(
            schedule_answer, schedule_answer.timetable, schedule_answer.problem
        )
    return schedule_data | (
        {"statistics": json_answers.statistics_entry(schedule_answer.statistics)} if stats else {}
    )


def _of_plan(schedule_answer: ScheduleAnswer, table: Timetable, problem: Problem) -> dict[str, Any]:
    from cellwright.engine.formats.report import json_answers
    from cellwright.engine.formats.report.plans.gantt_chart import (
        bottleneck_entry,
        schedule_entry,
        window_entries,
    )

    planned = json_answers.outcome_entry(Found(table.plan), problem, starts=table.starts)["plan"]
    staged = (
        table.scope != planning.SCOPE_KEPT_ORDER
        or len(table.plan.steps) <= planning.MAX_SCHEDULED_STEPS
    )
    entry = schedule_entry(table.shop, table.schedule, table.scope, staged, table.floor)
    bounded = bottleneck_entry(table)
    return {
        "schedule": entry,
        "note": table.note,
        "bounded_by": bounded,
        "plan": planned,
        **window_entries(table),
        **schedule_answer.unmet.entry(),
    }


def schedule_text(schedule_answer: ScheduleAnswer, stats: bool = False) -> "RenderableType":
    """The schedule as people read it: a table, a chart, and what it does not keep."""
    from cellwright.engine.formats.report.plans import outcome_tables as report
    from cellwright.engine.formats.report.plans.gantt_chart import charted_shop, timetable_chart

    unit, timetable = schedule_answer.unit, schedule_answer.timetable
    table = (
        of_steps(timetable, unit)
        if timetable
        else of_stages(schedule_answer.shop, schedule_answer.schedule, unit)
    )
    parts = (
        timetable_chart(timetable, unit)
        if timetable
        else charted_shop(schedule_answer.shop, schedule_answer.schedule, unit)
    )
    figures = [report.statistics_table(schedule_answer.statistics)] if stats else []
    return rich_parts.Group(
        table, "", *parts, *map(rich_parts.Text, schedule_answer.unmet.lines(unit)), *figures
    )


def schedule_svg(schedule_answer: ScheduleAnswer) -> str:
    """The schedule as a Gantt chart in SVG."""
    from cellwright.engine.formats.report.plans import gantt_svg
    from cellwright.engine.formats.report.plans.gantt_chart import SHOP, kept_order

    if schedule_answer.timetable is None:
        return gantt_svg.draw_gantt(
            schedule_answer.shop, schedule_answer.schedule, schedule_answer.unit, SHOP
        )
    note = kept_order(schedule_answer.timetable) if schedule_answer.timetable.note else ""
    return gantt_svg.draw_gantt(
        schedule_answer.shop,
        schedule_answer.schedule,
        schedule_answer.unit,
        schedule_answer.timetable.scope,
        note,
        schedule_answer.timetable.spans,
    )
