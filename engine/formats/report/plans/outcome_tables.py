"""Outcomes of planning as rich tables: the steps of the plan, histories of objects, statistics."""

import itertools
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.segment import Segment
from rich.style import Style
from rich.table import Table
from rich.text import Text

from cellwright.engine.formats.report.text_tables import TextTable, indented_text, wrap_text
from cellwright.engine.model.answer_wording import step_purposes
from cellwright.engine.model.noun_wording import count_noun
from cellwright.engine.model.outcome import Found, GaveUp, Infeasible, Outcome, Statistics
from cellwright.engine.model.plan_times import (
    History,
    earliest_starts,
    object_histories,
    plan_makespan,
)
from cellwright.engine.model.task_costs import cost_text
from cellwright.kb.model.plan_model import Plan, Step, StepId
from cellwright.kb.model.planning_problem import Problem

if TYPE_CHECKING:
    from cellwright.engine.model.shop_scheduling import Timetable

COLUMN_SPACES = "  "


def table_lines(
    head: Sequence[str], rows: Iterable[Sequence[str]], right: Collection[int]
) -> Iterator[Segment]:
    """A head and rows in columns as wide as their text.

    Cells may have several lines; columns in `right` hold numbers.
    """
    table = [[cell.splitlines() or [""] for cell in row] for row in rows]
    widths = [
        max(len(name), *(len(line) for row in table for line in row[place]))
        for place, name in enumerate(head)
    ]
    yield Segment(_table_line(head, widths, right), Style(bold=True))
    for row in table:
        for cells in itertools.zip_longest(*row, fillvalue=""):
            yield Segment(_table_line(cells, widths, right))


def _table_line(cells: Sequence[str], widths: Sequence[int], right: Collection[int]) -> str:
    placed = (
        cell.rjust(width) if place in right else cell.ljust(width)
        for place, (cell, width) in enumerate(zip(cells, widths, strict=True))
    )
    return COLUMN_SPACES.join(placed).rstrip() + "\n"


STEP_LIST_WIDTH = 12  # characters of a line of step numbers
STEP_COLUMN_GAP = 2  # characters between columns
LONG_PLAN_STEPS = 300  # steps
MIN_OPERATOR_WIDTH = 30  # characters for operators of a long plan
MANY, NAMED = 40, 10  # of more consumers of a condition than MANY, so many are named first


@dataclass(frozen=True, slots=True)
class StepTable:
    """Each step with the steps it waits for, its times, and what it achieves for whom. Without a
    `unit` it shows no times.

    What is achieved has a column of its own; on narrower terminals it stands below the operator; on
    the narrowest everything does.
    """

    plan: Plan
    starts: Mapping[StepId, int]
    purposes: Mapping[StepId, Mapping[str, Sequence[str]]]
    unit: str

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        head, rows = self._narrow()
        taken = sum(
            max(map(_cell_width, cells)) + STEP_COLUMN_GAP
            for cells in zip(head, *rows, strict=True)
        )
        room = options.max_width - taken
        operators = max([len("operator"), *(len(str(step.operator)) for step in self.plan.steps)])
        reasons = (
            len(reason_text)
            for step in self.plan.steps
            for reason_text in self.purposes.get(step.id, {})
        )
        achieved = max([len("achieves"), *reasons])
        if operators + STEP_COLUMN_GAP + achieved <= room:
            long = len(self.plan.steps) > LONG_PLAN_STEPS
            yield from (
                self._long(head, rows)
                if long
                else [self._beside(head, rows, room - operators - STEP_COLUMN_GAP)]
            )
        elif len(self.plan.steps) > LONG_PLAN_STEPS:
            yield from self._long_below(head, rows, max(room, MIN_OPERATOR_WIDTH))
        elif max(operators, achieved + STEP_COLUMN_GAP) <= room:
            yield self._below(head, rows, room)
        else:
            yield self._stacked(options.max_width)

    def _beside(self, head: Sequence[str], rows: Sequence[tuple[str, ...]], room: int) -> Table:
        """A column for operators and one of `room` characters for what they achieve."""
        table = Table(box=None, pad_edge=False)
        table.add_column(head[0], justify="right", no_wrap=True, style="cyan")
        table.add_column("operator", no_wrap=True)
        _add_narrow(table, head[1:])
        table.add_column("achieves", overflow="fold")
        for step, (number, *rest) in zip(self.plan.steps, rows, strict=True):
            table.add_row(
                number,
                _operator_text(step),
                *rest,
                _mark_reasons(_join_reasons(self._reasons(step), room)),
            )
        return table

    def _below(self, head: Sequence[str], rows: Sequence[tuple[str, ...]], room: int) -> Table:
        """One column of `room` characters: what a step achieves stands below its operator."""
        table = Table(box=None, pad_edge=False)
        table.add_column(head[0], justify="right", no_wrap=True, style="cyan")
        _add_narrow(table, head[1:])
        table.add_column("operator, and what it achieves", overflow="fold")
        for step, row in zip(self.plan.steps, rows, strict=True):
            below = "".join(f"\n{line}" for line in self._indented(step, room))
            table.add_row(*row, _operator_text(step).append_text(_mark_reasons(below)))
        return table

    def _long(self, head: Sequence[str], rows: Sequence[tuple[str, ...]]) -> Iterator[Segment]:
        """`_beside` for a long plan."""
        cells = (
            (number, str(step.operator), *rest, "\n".join(self._reasons(step)))
            for step, (number, *rest) in zip(self.plan.steps, rows, strict=True)
        )
        names = (head[0], "operator", *head[1:], "achieves")
        return table_lines(names, cells, {0, *range(3, len(names) - 1)})

    def _long_below(
        self, head: Sequence[str], rows: Sequence[tuple[str, ...]], room: int
    ) -> Iterator[Segment]:
        """`_below` for a long plan."""
        cells = (
            (*row, "\n".join([wrap_text(str(step.operator), room), *self._indented(step, room)]))
            for step, row in zip(self.plan.steps, rows, strict=True)
        )
        names = (*head, "operator, and what it achieves")
        return table_lines(names, cells, {0, *range(2, len(names) - 1)})

    def _indented(self, step: Step, room: int) -> list[str]:
        return [
            " " * STEP_COLUMN_GAP + line
            for line in _join_reasons(self._reasons(step), room - STEP_COLUMN_GAP).splitlines()
        ]

    def _stacked(self, width: int) -> Table:
        """The steps for a narrow terminal: the content of the table in lines below each step."""
        table = Table(
            box=None, pad_edge=False, show_header=False, padding=(0, STEP_COLUMN_GAP, 0, 0)
        )
        table.add_column(justify="right", no_wrap=True, style="cyan")
        table.add_column(overflow="fold")
        room = width - STEP_COLUMN_GAP - max(len(str(step.id)) for step in self.plan.steps)
        for step in self.plan.steps:
            stacked_lines = [f"after {', '.join(map(str, step.after))}"] if step.after else []
            stacked_lines += (
                [span_text(self.starts[step.id], step.duration, self.unit)] if self.unit else []
            )
            parts = ["; ".join(stacked_lines), *self._reasons(step)]
            table.add_row(
                str(step.id), indented_text(str(step.operator), filter(None, parts), room)
            )
        return table

    def _narrow(self) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
        """Head and rows of the columns of fixed width: numbers of steps, and times."""
        rows = [
            (str(step.id), wrap_text(", ".join(map(str, step.after)), STEP_LIST_WIDTH, 0))
            + ((str(self.starts[step.id]), str(step.duration)) if self.unit else ())
            for step in self.plan.steps
        ]
        return ("step", "after") + ((f"start ({self.unit})", "lasts") if self.unit else ()), rows

    def _reasons(self, step: Step) -> list[str]:
        """The conditions that a step achieves, each with its consumers in order, the goal last."""
        achieved = self.purposes.get(step.id, {})
        return [
            f"{condition} for {_consumers_text(users)}" for condition, users in achieved.items()
        ]


def _consumers_text(users: Sequence[str]) -> str:
    """The consumers of a condition; of very many the first ones, how many more there are, and
    the last.
    """
    consumers = sorted(users, key=lambda user: (user == "goal", len(user), user))
    if len(consumers) > MANY:
        consumers = [
            *consumers[:NAMED],
            f"{len(consumers) - NAMED - 1} more (--format json has all)",
            consumers[-1],
        ]
    return ", ".join(consumers)


def span_text(start: int, duration: int, unit: str) -> str:
    """When something happens, in words."""
    return f"from {start} for {duration} {unit}"


def _add_narrow(table: Table, names: Sequence[str]) -> None:
    table.add_column(names[0], overflow="fold")
    for name in names[1:]:
        table.add_column(name, justify="right", no_wrap=True)


def _cell_width(cell: str) -> int:
    return max((len(line) for line in cell.splitlines()), default=0)


def _operator_text(step: Step) -> Text:
    operator_cell = Text(str(step.operator))
    operator_cell.highlight_regex(r"^\w+", "bold")
    return operator_cell


def _join_reasons(reasons: Sequence[str], width: int) -> str:
    """All reasons on one line if they fit; otherwise each reason begins a new line."""
    line = "; ".join(reasons)
    return line if len(line) <= width else "\n".join(wrap_text(reason, width) for reason in reasons)


def _mark_reasons(reasons: str) -> Text:
    marked_text = Text(reasons)
    marked_text.highlight_regex(r" for(?= (\d|goal\b))", "dim")
    marked_text.highlight_regex(r"\bgoal\b", "green")
    return marked_text


STATISTICS_WIDTH = 10_000


def outcome_text(
    result: Outcome, problem: Problem, timetable: "Timetable | None" = None, explained: bool = False
) -> RenderableType:
    """An outcome for people; with a timetable also the chart of its plan.

    `explained`: what is told below says why there is none.
    """
    match result:
        case Found(plan):
            return plan_table(plan, problem, timetable)
        case Infeasible(reason):
            more = "" if explained else " `cellwright explain` tells what would allow one."
            return Text(f"No plan exists: {reason}.{more}")
        case GaveUp(reason):
            return Text(f"Gave up: {reason}.")


def plan_table(
    plan: Plan, problem: Problem, timetable: "Timetable | None" = None
) -> RenderableType:
    """Steps with the steps they wait for, start times and reasons; then histories, the chart
    and totals.
    """
    if not plan.steps:
        return Text("Nothing to do: the goals hold already.")
    timed = any(step.duration for step in plan.steps)
    unit = problem.domain.time_unit
    summary_parts = [
        count_noun(len(plan.steps), "step"),
        f"cost {cost_text(plan.cost, problem.domain)}",
    ]
    starts = timetable.starts if timetable else earliest_starts(plan)
    chart: list[RenderableType] = []
    if timetable:
        from cellwright.engine.formats.report.plans.gantt_chart import (
            GanttChart,
            kept_order,
            schedule_summary,
        )

        summary_parts.append(
            schedule_summary(timetable.schedule, unit, timetable.scope, timetable.floor)
        )
        shown = GanttChart(timetable.shop, timetable.schedule, unit, timetable.spans)
        chart = [Text(), shown, Text()]
        chart += [Text(kept_order(timetable))] if timetable.note else []
    elif timed:
        summary_parts.append(
            f"{plan_makespan(plan)} {unit} if every step starts as early as possible"
        )
    made = object_histories(problem, plan, starts)
    steps = StepTable(plan, starts, step_purposes(problem, plan), unit if timed else "")
    below_table: list[RenderableType] = [Text(), _HistoryTable(made, unit)] if made else []
    between = chart or ([Text()] if made else [])
    return Group(steps, *below_table, *between, Text(", ".join(summary_parts)))


@dataclass(frozen=True, slots=True)
class _HistoryTable:
    """The history of each object, in order, as a table if there is room for it."""

    made: Sequence[History]
    unit: str

    def __rich_console__(
        self, console: Console, options: ConsoleOptions
    ) -> Iterator[RenderableType]:
        table = _history_table(self.made, self.unit)
        if (
            console.measure(table, options=options.update(max_width=STATISTICS_WIDTH)).maximum
            <= options.max_width
        ):
            yield table
            return
        for history in self.made:
            stages = (
                f"{happening.stage} "
                f"{span_text(happening.start, happening.duration, self.unit)}, step "
                f"{happening.step}"
                for happening in history.happenings
            )
            yield indented_text(_history_name(history), stages, options.max_width)


def _history_name(history: History) -> str:
    return ", ".join([str(history.subject or history.chain), *history.names.values()])


def _history_table(object_histories: Sequence[History], unit: str) -> Table:
    """One line for each stage."""
    table = Table(box=None, pad_edge=False)
    table.add_column("history of", style="bold", overflow="fold")
    table.add_column("done", overflow="fold")
    for name in (f"start ({unit})", "lasts", "step"):
        table.add_column(name, justify="right", no_wrap=True)
    for history in object_histories:
        name = _history_name(history)
        for place, happening in enumerate(history.happenings):
            times = (str(happening.start), str(happening.duration), str(happening.step))
            table.add_row(Text(name if place == 0 else ""), Text(str(happening.stage)), *times)
    return table


def statistics_table(figures: Statistics) -> RenderableType:
    """Counts and seconds."""
    rows = [(name, str(count)) for name, count in figures.counts.items()]
    rows += [(f"{name} (s)", f"{seconds:.3f}") for name, seconds in figures.seconds.items()]
    widest = max((len(figure_text) for _, figure_text in rows), default=0)
    return TextTable(("", ""), [(name, figure_text.rjust(widest)) for name, figure_text in rows])
