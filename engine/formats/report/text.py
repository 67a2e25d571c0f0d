"""Outcomes as rich tables.

The library rich decides on colours: none in a pipe, none with NO_COLOR. Tables are fitted to the width of the terminal here,
because rich would break atoms in the middle of words.
"""

<<<<<<< HEAD
import itertools
from collections.abc import Iterator, Mapping, Sequence
=======
from collections.abc import Iterator, Sequence
>>>>>>> main
from dataclasses import dataclass

from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.segment import Segment
from rich.style import Style
from rich.table import Table
from rich.text import Text

from engine.formats.report.gantt import Gantt, kept_order, summary
from engine.formats.report.rows import TextTable, headed
from engine.formats.report.steps import StepTable, span
from engine.model.forecast import earliest_starts, makespan
from engine.model.histories import History, histories
from engine.model.outcome import Found, GaveUp, Infeasible, Outcome, Statistics
from engine.model.purposes import purposes
from engine.model.schedule import Timetable
from engine.model.wording import counted
from kb.model.plan import Plan
from kb.model.problem import Problem

WIDEST = 10_000
<<<<<<< HEAD
MANY, NAMED = 40, 10  # consumers of a condition; of more than MANY, so many are named
LONG = 300  # steps; longer tables are written line by line
JUDGED = 60  # the number of steps that determine the widths of columns
=======
>>>>>>> main


def outcome(result: Outcome, problem: Problem, timetable: Timetable | None = None) -> RenderableType:
    """An outcome for people; with a timetable also the chart of its plan."""
    match result:
        case Found(plan):
            return plan_table(plan, problem, timetable)
        case Infeasible(reason):
            return Text(f"No plan exists: {reason}.")
        case GaveUp(reason):
            return Text(f"Gave up: {reason}.")


def plan_table(plan: Plan, problem: Problem, timetable: Timetable | None = None) -> RenderableType:
    """Steps with the steps they wait for, start times and reasons; then histories, the chart and totals."""
    if not plan.steps:
        return Text("Nothing to do: the goals hold already.")
    timed = any(step.duration for step in plan.steps)
    unit = problem.domain.time_unit
    said = [counted(len(plan.steps), "step"), f"cost {plan.cost}"]
    starts = timetable.starts if timetable else earliest_starts(plan)
    chart: list[RenderableType] = []
    if timetable:
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


<<<<<<< HEAD
def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


@dataclass(frozen=True, slots=True)
class _Steps:
    """The table of steps, made when the width is known. Without a `unit` it shows no times."""

    plan: Plan
    starts: Mapping[StepId, int]
    purposes: Mapping[StepId, Mapping[str, Sequence[str]]]
    unit: str

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        names, rows = self._narrow()
        spare = options.max_width - sum(
            max(map(_width, cells)) + 2 for cells in zip(names, *rows, strict=True)
        )
        if spare < LEGIBLE:
            yield self._stacked(options.max_width)
        elif len(self.plan.steps) > LONG:
            yield from self._lines(names, rows, spare)
        else:
            yield self._table(names, rows, spare)

    def _lines(self, names: Sequence[str], rows: Sequence[tuple[str, ...]], spare: int) -> Iterator[Segment]:
        """The table of a long plan, line by line: rich would take longer for it than the plan took."""
        reasons = [_reasons(self.purposes.get(step.id, {})) for step in self.plan.steps]
        operators, achieved = _widths([str(step.operator) for step in self.plan.steps], reasons, spare - 2)
        fixed = [max(map(_width, cells)) for cells in zip(names, *rows, strict=True)]
        widths = (fixed[0], operators, *fixed[1:], achieved)
        yield Segment(_line((names[0], "operator", *names[1:], "achieves"), widths), Style(bold=True))
        for step, (number, *rest), reason in zip(self.plan.steps, rows, reasons, strict=True):
            cells = (number, wrapped(str(step.operator), operators), *rest, _stacked(reason, achieved))
            columns = itertools.zip_longest(*(cell.splitlines() for cell in cells), fillvalue="")
            yield Segment("".join(_line(line, widths) for line in columns))

    def _stacked(self, width: int) -> Table:
        """The steps for a narrow terminal: the content of the table in lines below each step."""
        starts = self.starts
        table = Table(box=None, pad_edge=False, show_header=False, padding=(0, 2, 0, 0))
        table.add_column(justify="right", no_wrap=True, style="cyan")
        table.add_column(overflow="fold")
        room = width - 2 - max(len(str(step.id)) for step in self.plan.steps)
        for step in self.plan.steps:
            said = [f"after {', '.join(map(str, step.after))}"] if step.after else []
            said += [_span(starts[step.id], step.duration, self.unit)] if self.unit else []
            parts = ["; ".join(said), *_reasons(self.purposes.get(step.id, {}))]
            table.add_row(str(step.id), headed(str(step.operator), filter(None, parts), room))
        return table

    def _table(self, names: Sequence[str], rows: Sequence[tuple[str, ...]], spare: int) -> Table:
        reasons = [_reasons(self.purposes.get(step.id, {})) for step in self.plan.steps]
        operators, achieved = _widths([str(step.operator) for step in self.plan.steps], reasons, spare - 2)
        table = Table(box=None, pad_edge=False)
        table.add_column(names[0], justify="right", no_wrap=True, style="cyan")
        table.add_column("operator", overflow="fold")
        table.add_column(names[1], overflow="fold")
        for name in names[2:]:
            table.add_column(name, justify="right", no_wrap=True)
        table.add_column("achieves", overflow="fold")
        for step, (number, *rest), reason in zip(self.plan.steps, rows, reasons, strict=True):
            operator = Text(wrapped(str(step.operator), operators))
            operator.highlight_regex(r"^\w+", "bold")
            table.add_row(number, operator, *rest, _reason_text(reason, achieved))
        return table

    def _narrow(self) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
        """Head and rows of the columns of fixed width: numbers of steps, and times."""
        starts = self.starts
        rows = [
            (str(step.id), wrapped(", ".join(map(str, step.after)), LIST, 0))
            + ((str(starts[step.id]), str(step.duration)) if self.unit else ())
            for step in self.plan.steps
        ]
        return ("step", "after") + ((f"start ({self.unit})", "lasts") if self.unit else ()), rows


def _line(cells: Sequence[str], widths: Sequence[int]) -> str:
    """Cells in columns, numbers to the right."""
    right = {0, *range(3, len(cells) - 1)}
    placed = (
        cell.rjust(width) if place in right else cell.ljust(width)
        for place, (cell, width) in enumerate(zip(cells, widths, strict=True))
    )
    return "  ".join(placed).rstrip() + "\n"


def _span(start: int, duration: int, unit: str) -> str:
    return f"from {start} for {duration} {unit}"


def _width(cell: str) -> int:
    return max((len(line) for line in cell.splitlines()), default=0)


def _reasons(achieved: Mapping[str, Sequence[str]]) -> list[str]:
    """The conditions that a step achieves, each with its consumers in order, the goal last."""
    return [f"{condition} for {_users(users)}" for condition, users in achieved.items()]


def _users(users: Sequence[str]) -> str:
    """The consumers of a condition; of very many the first ones, how many more there are, and the last."""
    known = sorted(users, key=lambda user: (user == "goal", len(user), user))
    if len(known) > MANY:
        known = [*known[:NAMED], f"{len(known) - NAMED - 1} more", known[-1]]
    return ", ".join(known)


def _widths(operators: Sequence[str], reasons: Sequence[Sequence[str]], spare: int) -> tuple[int, int]:
    """The widths of operators and reasons: as wide as their text, or so that the table has as few lines as possible.

    For long tables, only the first steps are considered.
    """
    widest = max(len("operator"), *map(len, operators))
    if widest + max(len("; ".join(reason)) for reason in reasons) <= spare:
        return widest, spare - widest
    rows = list(zip(operators, reasons, strict=True))[:JUDGED]

    def lines(given: int) -> int:
        return sum(
            max(wrapped(operator, given).count("\n"), _stacked(reason, spare - given).count("\n"))
            for operator, reason in rows
        )

    least, most = len("operator"), max(min(widest, spare - len("achieves")), len("operator"))
    given = min(range(most, least - 1, -1), key=lines)
    return given, max(spare - given, len("achieves"))


def _stacked(reasons: Sequence[str], width: int) -> str:
    """All reasons on one line if they fit; otherwise each reason begins a new line."""
    line = "; ".join(reasons)
    return line if len(line) <= width else "\n".join(wrapped(reason, width) for reason in reasons)


def _reason_text(reasons: Sequence[str], width: int) -> Text:
    made = Text(_stacked(reasons, width))
    made.highlight_regex(r" for(?= (\d|goal\b))", "dim")
    made.highlight_regex(r"\bgoal\b", "green")
    return made


=======
>>>>>>> main
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
