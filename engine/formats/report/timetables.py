"""A schedule, whole: of a shop, or of the steps of a plan with what it was asked to keep and does not."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from cellwright.engine.model.outcome import Found, Statistics
from cellwright.engine.model.schedule import Schedule, Timetable
from cellwright.engine.model.shop import Shop
from cellwright.engine.model.windows import Unmet
from cellwright.kb.model.problem import Problem

if TYPE_CHECKING:
    from rich.console import RenderableType


@dataclass(frozen=True, slots=True)
class Timed:
    """A schedule of the stages of a shop; of a plan if there is a `timetable`, with its problem and what it does not keep."""

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


def of_plan(made: Timetable, problem: Problem) -> Timed:
    """The schedule of a plan for a problem, with the windows of measurements that it does not keep."""
    from cellwright.engine.pipelines.plan_files import unmet
    from cellwright.kb.model.plan import Claims

    broken = unmet(problem, made.plan, Claims(dict(made.starts)))
    return Timed(made.shop, made.schedule, made.statistics, made, problem, broken)


def content(made: Timed, stats: bool = False) -> dict[str, Any]:
    """The schedule as data, with its statistics if they are asked for."""
    from cellwright.engine.formats.report import json
    from cellwright.engine.formats.report.gantt import schedule_entry

    if made.timetable is None or made.problem is None:
        found: dict[str, Any] = {"schedule": schedule_entry(made.shop, made.schedule)}
    else:
        found = _of_plan(made, made.timetable, made.problem)
    return found | ({"statistics": json.statistics(made.statistics)} if stats else {})


def _of_plan(made: Timed, table: Timetable, problem: Problem) -> dict[str, Any]:
    from cellwright.engine.formats.report import json
    from cellwright.engine.formats.report.bounds import bottleneck_entry
    from cellwright.engine.formats.report.gantt import schedule_entry
    from cellwright.engine.pipelines.timetable.kept import LONG

    planned = json.outcome(Found(table.plan), problem, starts=table.starts)["plan"]
    entry = schedule_entry(table.shop, table.schedule, table.scope, staged=len(table.plan.steps) <= LONG)
    bounded = bottleneck_entry(table)
    return {
        "schedule": entry,
        "note": table.note,
        "bounded_by": bounded,
        "plan": planned,
        **made.unmet.entry(),
    }


def text(made: Timed, stats: bool = False) -> "RenderableType":
    """The schedule as people read it: a table, a chart, and what it does not keep."""
    from rich.console import Group
    from rich.text import Text

    from cellwright.engine.formats.report import starts
    from cellwright.engine.formats.report import text as report
    from cellwright.engine.formats.report.gantt import charted, charted_shop

    unit, timetable = made.unit, made.timetable
    table = (
        starts.of_steps(timetable, unit) if timetable else starts.of_stages(made.shop, made.schedule, unit)
    )
    parts = charted(timetable, unit) if timetable else charted_shop(made.shop, made.schedule, unit)
    figures = [report.statistics(made.statistics)] if stats else []
    return Group(table, "", *parts, *map(Text, made.unmet.lines(unit)), *figures)


def chart(made: Timed) -> str:
    """The schedule as a Gantt chart in SVG."""
    from cellwright.engine.formats.report import gantt_svg
    from cellwright.engine.formats.report.gantt import SHOP, kept_order

    if made.timetable is None:
        return gantt_svg.chart(made.shop, made.schedule, made.unit, SHOP)
    note = kept_order(made.timetable) if made.timetable.note else ""
    return gantt_svg.chart(made.shop, made.schedule, made.unit, made.timetable.scope, note)
