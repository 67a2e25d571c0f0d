"""The steps of a plan as a table that fits the width of the terminal. No term that fits on a line is broken."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from rich.console import Console, ConsoleOptions, RenderResult
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from cellwright.engine.formats.report.lines import lines
from cellwright.engine.formats.report.rows import headed
from cellwright.engine.formats.report.wrapping import wrapped
from cellwright.kb.model.plan import Plan, Step, StepId

LIST = 12  # characters of a line of step numbers
GAP = 2  # characters between columns
LONG = 300  # steps
LEAST = 30  # characters for operators of a long plan
MANY, NAMED = 40, 10  # of more consumers of a condition than MANY, so many are named first


@dataclass(frozen=True, slots=True)
class StepTable:
    """Each step with the steps it waits for, its times, and what it achieves for whom. Without a `unit` it shows no times.

    What is achieved has a column of its own; on narrower terminals it stands below the operator; on the narrowest
    everything does.
    """

    plan: Plan
    starts: Mapping[StepId, int]
    purposes: Mapping[StepId, Mapping[str, Sequence[str]]]
    unit: str

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        head, rows = self._narrow()
        taken = sum(max(map(_width, cells)) + GAP for cells in zip(head, *rows, strict=True))
        room = options.max_width - taken
        operators = max([len("operator"), *(len(str(step.operator)) for step in self.plan.steps)])
        reasons = (len(said) for step in self.plan.steps for said in self.purposes.get(step.id, {}))
        achieved = max([len("achieves"), *reasons])
        if operators + GAP + achieved <= room:
            long = len(self.plan.steps) > LONG
            yield from self._long(head, rows) if long else [self._beside(head, rows, room - operators - GAP)]
        elif len(self.plan.steps) > LONG:
            yield from self._long_below(head, rows, max(room, LEAST))
        elif max(operators, achieved + GAP) <= room:
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
            table.add_row(number, _operator(step), *rest, _marked(_joined(self._reasons(step), room)))
        return table

    def _below(self, head: Sequence[str], rows: Sequence[tuple[str, ...]], room: int) -> Table:
        """One column of `room` characters: what a step achieves stands below its operator."""
        table = Table(box=None, pad_edge=False)
        table.add_column(head[0], justify="right", no_wrap=True, style="cyan")
        _add_narrow(table, head[1:])
        table.add_column("operator, and what it achieves", overflow="fold")
        for step, row in zip(self.plan.steps, rows, strict=True):
            below = "".join(f"\n{line}" for line in self._indented(step, room))
            table.add_row(*row, _operator(step).append_text(_marked(below)))
        return table

    def _long(self, head: Sequence[str], rows: Sequence[tuple[str, ...]]) -> Iterator[Segment]:
        """`_beside` for a long plan."""
        cells = (
            (number, str(step.operator), *rest, "\n".join(self._reasons(step)))
            for step, (number, *rest) in zip(self.plan.steps, rows, strict=True)
        )
        names = (head[0], "operator", *head[1:], "achieves")
        return lines(names, cells, {0, *range(3, len(names) - 1)})

    def _long_below(
        self, head: Sequence[str], rows: Sequence[tuple[str, ...]], room: int
    ) -> Iterator[Segment]:
        """`_below` for a long plan."""
        cells = (
            (*row, "\n".join([wrapped(str(step.operator), room), *self._indented(step, room)]))
            for step, row in zip(self.plan.steps, rows, strict=True)
        )
        names = (*head, "operator, and what it achieves")
        return lines(names, cells, {0, *range(2, len(names) - 1)})

    def _indented(self, step: Step, room: int) -> list[str]:
        return [" " * GAP + line for line in _joined(self._reasons(step), room - GAP).splitlines()]

    def _stacked(self, width: int) -> Table:
        """The steps for a narrow terminal: the content of the table in lines below each step."""
        table = Table(box=None, pad_edge=False, show_header=False, padding=(0, GAP, 0, 0))
        table.add_column(justify="right", no_wrap=True, style="cyan")
        table.add_column(overflow="fold")
        room = width - GAP - max(len(str(step.id)) for step in self.plan.steps)
        for step in self.plan.steps:
            said = [f"after {', '.join(map(str, step.after))}"] if step.after else []
            said += [span(self.starts[step.id], step.duration, self.unit)] if self.unit else []
            parts = ["; ".join(said), *self._reasons(step)]
            table.add_row(str(step.id), headed(str(step.operator), filter(None, parts), room))
        return table

    def _narrow(self) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
        """Head and rows of the columns of fixed width: numbers of steps, and times."""
        rows = [
            (str(step.id), wrapped(", ".join(map(str, step.after)), LIST, 0))
            + ((str(self.starts[step.id]), str(step.duration)) if self.unit else ())
            for step in self.plan.steps
        ]
        return ("step", "after") + ((f"start ({self.unit})", "lasts") if self.unit else ()), rows

    def _reasons(self, step: Step) -> list[str]:
        """The conditions that a step achieves, each with its consumers in order, the goal last."""
        achieved = self.purposes.get(step.id, {})
        return [f"{condition} for {_users(users)}" for condition, users in achieved.items()]


def _users(users: Sequence[str]) -> str:
    """The consumers of a condition; of very many the first ones, how many more there are, and the last."""
    known = sorted(users, key=lambda user: (user == "goal", len(user), user))
    if len(known) > MANY:
        known = [*known[:NAMED], f"{len(known) - NAMED - 1} more (--format json has all)", known[-1]]
    return ", ".join(known)


def span(start: int, duration: int, unit: str) -> str:
    """When something happens, in words."""
    return f"from {start} for {duration} {unit}"


def _add_narrow(table: Table, names: Sequence[str]) -> None:
    table.add_column(names[0], overflow="fold")
    for name in names[1:]:
        table.add_column(name, justify="right", no_wrap=True)


def _width(cell: str) -> int:
    return max((len(line) for line in cell.splitlines()), default=0)


def _operator(step: Step) -> Text:
    made = Text(str(step.operator))
    made.highlight_regex(r"^\w+", "bold")
    return made


def _joined(reasons: Sequence[str], width: int) -> str:
    """All reasons on one line if they fit; otherwise each reason begins a new line."""
    line = "; ".join(reasons)
    return line if len(line) <= width else "\n".join(wrapped(reason, width) for reason in reasons)


def _marked(reasons: str) -> Text:
    made = Text(reasons)
    made.highlight_regex(r" for(?= (\d|goal\b))", "dim")
    made.highlight_regex(r"\bgoal\b", "green")
    return made
