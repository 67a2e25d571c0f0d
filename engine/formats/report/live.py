"""The live display of a run: devices and their current steps, a chart with a line at now, the world's last changes, and a log.

`Display` takes in one record after another. What is shown follows from these, and from the time that has passed since the last.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

from rich.console import Console, ConsoleOptions, Group, RenderableType
from rich.panel import Panel
from rich.table import Column, Table
from rich.text import Text

from cellwright.engine.formats.report.execution import duration
from cellwright.engine.formats.report.standing import Bar, Standing, begins
from cellwright.engine.model.execution import Record, RecordKind
from cellwright.engine.model.wording import counted
from cellwright.engine.stages.execution.outlook import Window

NEXT = 5  # steps that have not begun
NAME = 16  # columns for the name of a device
FRAME = 10  # lines that are always there: the border, what is done, headings, and what is left blank
KEYS = "p pause or continue   i interrupt   s stop   q leave the display"
FEW_KEYS = "p pause  i interrupt  s stop  q leave"
PHASES = {"interrupting": "will pause", "quiescing": "comes to rest after a failure"}  # in plain words
STYLES = {"done": "green", "running": "bold yellow", "failed": "bold red", "planned": "dim"}


@dataclass
class Display(Standing):
    """How a run stands, on a terminal; `passed_ms` is the time on the run's clock since the last record."""

    passed_ms: Callable[[], float] = lambda: 0.0
    told: str = ""  # the last order to pause or go on that nothing has come of yet

    def take(self, record: Record) -> None:
        """Take in a record."""
        super().take(record)
        if record.kind is RecordKind.PHASE:
            self.told = ""

    def toggled(self) -> str:
        """The order that a person wants who pauses what goes on, or continues what pauses or is about to."""
        pauses = self.told or ("interrupt" if self.phase in ("paused", "interrupting") else "continue")
        self.told = "continue" if pauses == "interrupt" else "interrupt"
        return self.told

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        now, chart = self._shown_ms(), list(self._chart(max(10, options.max_width - NAME - 6)))
        ahead = list(self.ahead().items())
        fixed = FRAME + len(self.under_way) + len(chart)
        log, following, facts = shared(
            options.max_height - 1 - fixed, (len(self.log), min(NEXT, len(ahead)), len(self.facts))
        )
        done = sum(each.standing == "done" for each in (*self.past, *self.bars.values()))
        title = f"{self.run}: {PHASES.get(self.phase, self.phase)}, {duration(now)} of about {duration(max(self.end_ms, now))}"
        parts: list[RenderableType] = [Text(f"{counted(done, 'step')} done, {len(self.bars)} in the plan")]
        parts += [self._current(), Text(), self._next(ahead[:following]), Text(), *chart, Text()]
        parts += [Text("last changes", "bold"), *_lines(self.facts, facts), Text(), *_lines(self.log, log)]
        yield Panel(
            Group(*parts),
            title=title if self.bars else f"{self.run}: no plan yet",
            subtitle=KEYS if options.max_width > len(KEYS) + 6 else FEW_KEYS,
        )

    def _shown_ms(self) -> int:
        """The time now, in whole seconds: while something is under way, the clock goes on without records."""
        passed = self.passed_ms() if self.under_way else 0.0
        return self.now_ms if not passed else round((self.now_ms + passed) / 1000) * 1000

    def _current(self) -> Table:
        """What each device does now."""
        table = Table("device", "current step", "since", box=None, pad_edge=False)
        for stream, action, since, _ in self.under_way.values():
            table.add_row(_line(stream), _line(action), _line(duration(since)))
        return table

    def _next(self, ahead: Sequence[tuple[int, Window | None]]) -> Table:
        """Steps that come next, with the times at which they probably begin as far as these can be told."""
        table = Table("device", "next step", Column("begins", no_wrap=True), box=None, pad_edge=False)
        for step, window in ahead:
            bar = self.bars[step]
            table.add_row(_line(bar.stream), _line(bar.step), _line(begins(window)))
        return table

    def _chart(self, width: int) -> Iterator[Text]:
        """A line for each device, and one with a mark at now."""
        bars = [*self.past, *self.bars.values()]
        last = max((each.start_ms + each.lasts_ms for each in bars), default=0)
        scale = width / max(1, last, self.now_ms)
        for stream in dict.fromkeys(each.stream for each in bars):
            line = Text(f"{stream[: NAME - 1]:<{NAME}}")
            line.append_text(_lane([each for each in bars if each.stream == stream], scale, width))
            yield line
        now = min(width - 1, int(self._shown_ms() * scale))
        mark = "| now" if now < width - 6 else "now |"
        yield Text(" " * (NAME + now - (0 if mark[0] == "|" else len(mark) - 1)) + mark, "bold")


def shared(lines: int, wanted: Sequence[int]) -> list[int]:
    """How many lines each part gets if there are so many: one after another in turn, none more than it wants."""
    given = [0] * len(wanted)
    while lines > 0 and any(got < most for got, most in zip(given, wanted, strict=True)):
        for part, most in enumerate(wanted):
            if given[part] < most and lines > 0:
                given[part], lines = given[part] + 1, lines - 1
    return given


def _line(text: str) -> Text:
    """A text that is cut where the line ends."""
    return Text(text, no_wrap=True, overflow="ellipsis")


def _lines(texts: Collection[str], count: int) -> list[Text]:
    """The last ones of some texts."""
    return [_line(each) for each in list(texts)[len(texts) - count :]]


def _lane(bars: list[Bar], scale: float, width: int) -> Text:
    cells, styles = [" "] * width, [""] * width
    for each in sorted(bars, key=lambda bar: bar.standing != "planned"):
        first = min(width - 1, int(each.start_ms * scale))
        last = min(width - 1, max(first, int((each.start_ms + each.lasts_ms) * scale) - 1))
        for place in range(first, last + 1):
            cells[place] = "." if each.standing == "planned" else "X" if each.standing == "failed" else "="
            styles[place] = STYLES[each.standing]
    text = Text()
    for style, places in groupby(range(width), styles.__getitem__):
        text.append("".join(cells[place] for place in places), style)
    return text
