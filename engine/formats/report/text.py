"""Outcomes as rich tables.

The library rich decides on colours: none in a pipe, none with NO_COLOR. Tables are fitted to the width of the terminal here,
because rich would break atoms in the middle of words.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rich.console import Console, ConsoleOptions, Group, RenderableType
from rich.table import Table
from rich.text import Text

from cellwright.engine.formats.report.rows import TextTable, headed
from cellwright.engine.formats.report.steps import StepTable, span
from cellwright.engine.model.forecast import earliest_starts, makespan
from cellwright.engine.model.histories import History, histories
from cellwright.engine.model.outcome import Found, GaveUp, Infeasible, Outcome, Statistics
from cellwright.engine.model.purposes import purposes
from cellwright.engine.model.wording import counted
from cellwright.kb.model.plan import Plan
from cellwright.kb.model.problem import Problem

if TYPE_CHECKING:
    from cellwright.engine.model.schedule import Timetable

WIDEST = 10_000


def outcome(
    result: Outcome, problem: Problem, timetable: "Timetable | None" = None, explained: bool = False
) -> RenderableType:
    """An outcome for people; with a timetable also the chart of its plan. `explained`: what is told below says why there is none."""
    match result:
        case Found(plan):
            return plan_table(plan, problem, timetable)
        case Infeasible(reason):
            more = "" if explained else " `cellwright explain` tells what would allow one."
            return Text(f"No plan exists: {reason}.{more}")
        case GaveUp(reason):
            return Text(f"Gave up: {reason}.")


def plan_table(plan: Plan, problem: Problem, timetable: "Timetable | None" = None) -> RenderableType:
    """Steps with the steps they wait for, start times and reasons; then histories, the chart and totals."""
    if not plan.steps:
        return Text("Nothing to do: the goals hold already.")
    timed = any(step.duration for step in plan.steps)
    unit = problem.domain.time_unit
    said = [counted(len(plan.steps), "step"), f"cost {plan.cost}"]
    starts = timetable.starts if timetable else earliest_starts(plan)
    chart: list[RenderableType] = []
    if timetable:
        from cellwright.engine.formats.report.gantt import Gantt, kept_order, summary

        said.append(summary(timetable.schedule, unit, timetable.scope))
        chart = [Text(), Gantt(timetable.shop, timetable.schedule, unit), Text()]
        chart += [Text(kept_order(timetable))] if timetable.note else []
    elif timed:
        said.append(f"{makespan(plan)} {unit} if every step starts as early as possible")
    made = histories(problem, plan, starts)
    steps = StepTable(plan, starts, purposes(problem, plan), unit if timed else "")
    told: list[RenderableType] = [Text(), _Histories(made, unit)] if made else []
    between = chart or ([Text()] if made else [])
    return Group(steps, *told, *between, Text(", ".join(said)))


@dataclass(frozen=True, slots=True)
class _Histories:
    """The history of each object, in order, as a table if there is room for it."""

    made: Sequence[History]
    unit: str

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        table = _history_table(self.made, self.unit)
        if console.measure(table, options=options.update(max_width=WIDEST)).maximum <= options.max_width:
            yield table
            return
        for history in self.made:
            stages = (
                f"{each.stage} {span(each.start, each.duration, self.unit)}, step {each.step}"
                for each in history.happenings
            )
            yield headed(_named(history), stages, options.max_width)


def _named(history: History) -> str:
    return ", ".join([str(history.subject or history.chain), *history.names.values()])


def _history_table(made: Sequence[History], unit: str) -> Table:
    """One line for each stage."""
    table = Table(box=None, pad_edge=False)
    table.add_column("history of", style="bold", overflow="fold")
    table.add_column("done", overflow="fold")
    for name in (f"start ({unit})", "lasts", "step"):
        table.add_column(name, justify="right", no_wrap=True)
    for history in made:
        name = _named(history)
        for place, each in enumerate(history.happenings):
            times = (str(each.start), str(each.duration), str(each.step))
            table.add_row(Text(name if place == 0 else ""), Text(str(each.stage)), *times)
    return table


def statistics(figures: Statistics) -> RenderableType:
    """Counts and seconds."""
    rows = [(name, str(count)) for name, count in figures.counts.items()]
    rows += [(f"{name} (s)", f"{seconds:.3f}") for name, seconds in figures.seconds.items()]
    widest = max((len(said) for _, said in rows), default=0)
    return TextTable(("", ""), [(name, said.rjust(widest)) for name, said in rows])
