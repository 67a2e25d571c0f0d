"""The live display of a run: devices and their current steps, a chart with a line at now, the world's last changes, and a log.

`Display` takes in one record after another. What is shown follows from these, and from the time that has passed since the last.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import groupby

from rich.console import Console, ConsoleOptions, Group, RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from engine.formats.report.execution import duration
from engine.formats.report.standing import Bar, Standing, begins
from engine.model.wording import counted

NEXT = 5  # steps that have not begun
NAME = 16  # columns for the name of a device
KEYS = "p pause or continue   i interrupt   s stop   q leave the display"
STYLES = {"done": "green", "running": "bold yellow", "failed": "bold red", "planned": "dim"}


@dataclass
class Display(Standing):
    """How a run stands, on a terminal; `passed_ms` is the time on the run's clock since the last record."""

    passed_ms: Callable[[], float] = lambda: 0.0

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        now = self._shown_ms()
        title = f"{self.run}: {self.phase}, {duration(now)} of about {duration(max(self.end_ms, now))}"
        done = sum(each.standing == "done" for each in (*self.past, *self.bars.values()))
        head = Text(f"{counted(done, 'step')} done, {len(self.bars)} in the plan")
        chart = Group(*self._chart(max(10, options.max_width - NAME - 6)))
        world = Group(*(Text(each) for each in self.facts))
        log = Group(*(Text(each, no_wrap=True, overflow="ellipsis") for each in self.log))
        yield Panel(
            Group(
                *(head, self._current(), Text(), self._next(), Text(), chart, Text()),
                *(Text("last changes", "bold"), world, Text(), log),
            ),
            title=title,
            subtitle=KEYS,
        )

    def _shown_ms(self) -> int:
        """The time now, in whole seconds: while something is under way, the clock goes on without records."""
        passed = self.passed_ms() if self.under_way else 0.0
        return self.now_ms if not passed else round((self.now_ms + passed) / 1000) * 1000

    def _current(self) -> Table:
        """What each device does now."""
        table = Table("device", "current step", "since", box=None, pad_edge=False)
        for stream, action, since, _ in self.under_way.values():
            table.add_row(Text(stream), Text(action), duration(since))
        return table

    def _next(self) -> Table:
        """The next steps in their order, with the times at which they probably begin as far as these can be told."""
        table = Table("device", "next step", "begins", box=None, pad_edge=False)
        for step, window in list(self.ahead().items())[:NEXT]:
            bar = self.bars[step]
            table.add_row(Text(bar.stream), Text(bar.step), Text(begins(window)))
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
