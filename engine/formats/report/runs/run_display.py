"""State of a run by its records (steps, what is under way, log), and its live display.

A `Standing` takes in one record after another; whatever shows a run draws it.
"""

from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from typing import Any

from rich.console import Console, ConsoleOptions, Group, RenderableType
from rich.panel import Panel
from rich.table import Column, Table
from rich.text import Text

from cellwright.engine.formats.report.runs.run_report import duration_text, narrate_record
from cellwright.engine.model.noun_wording import count_noun
from cellwright.engine.model.run_protocol import JournalRecord, RecordKind, RunPhase
from cellwright.engine.pipelines.execution.plan_records import activity_of
from cellwright.engine.stages.execution import ActivityProgram, Running, standing_of
from cellwright.engine.stages.execution.start_forecast import (
    TOLERANCE_MS,
    Accuracy,
    StartWindow,
    forecast_starts,
)

LOG, FACTS = 8, 6  # lines of the log, last changes of the world
HALTED = "stopped"


@dataclass(frozen=True, slots=True)
class StepBar:
    """A step of a plan: when it begins and how long it lasts, as forecast or as it was, and how it
    stands.

    It stands `planned`, `running`, `done` or `failed`.
    """

    step: str
    stream: str
    start_ms: int
    lasts_ms: int
    standing: str = "planned"


def begin_text(window: StartWindow | None) -> str:
    """When a step probably begins, and by how much this may be off; nothing but its place in
    the order if nobody can say.
    """
    if window is None:
        return "later"
    off = round(window.off_ms / 1000)
    start = duration_text(round(window.start_ms / 1000) * 1000)
    return f"{start}, {off} s sooner or later" if off else start


@dataclass
class RunStanding:
    """A run up to a record: `bars` are the steps of its last plan, `past` those of plans before
    it that had begun.
    """

    run: str
    phase: str = "ready"
    now_ms: int = 0
    end_ms: int = 0
    bars: dict[int, StepBar] = field(default_factory=dict)
    past: list[StepBar] = field(default_factory=list)
    under_way: dict[int, tuple[str, str, int, int]] = field(
        default_factory=dict
    )  # stream, action, since, lasts
    facts: deque[str] = field(default_factory=lambda: deque(maxlen=FACTS))
    log: deque[str] = field(default_factory=lambda: deque(maxlen=LOG))
    # of the forecasts of this run, as far as it is
    accuracy: Accuracy = field(default_factory=Accuracy)
    tolerance_ms: int = TOLERANCE_MS  # starts that may be off by more are not told
    program: ActivityProgram | None = None
    _ahead: Mapping[int, StartWindow | None] | None = None

    def ahead(self) -> Mapping[int, StartWindow | None]:
        """The steps that have not begun, in the order of the forecast: when each begins, or
        None where that cannot be said.
        """
        if self._ahead is None and self.program is not None:
            running = {
                n: Running(n, bar.start_ms)
                for n, bar in self.bars.items()
                if bar.standing == "running"
            }
            done = [n for n, bar in self.bars.items() if bar.standing == "done"]
            standing = standing_of(self.program, self.now_ms, 0, RunPhase.RUNNING, done, running)
            self._ahead = forecast_starts(self.program, standing, self.accuracy, self.tolerance_ms)
        return self._ahead or {}

    def take(self, record: JournalRecord) -> None:
        """Take in a record."""
        self.now_ms, self._ahead = record.at_ms, None
        content = record.content
        match record.kind:
            case RecordKind.PLAN:
                self._plan(content)
            case RecordKind.COMMAND:
                self._command(record)
            case RecordKind.REPLY:
                self.under_way.pop(content["command"], None)
            case RecordKind.DONE:
                self._done(content)
            case RecordKind.EXCEPTION:
                self._stand(content.get("step"), "failed")
            case RecordKind.PHASE:
                self.phase = content["phase"]
            case RecordKind.END:
                self._end(content["outcome"])
            case _:
                pass
        self.log.extend(narrate_record(record))

    def _plan(self, content: Mapping[str, Any]) -> None:
        self.phase = "running"
        going_on = dict(content.get("running", ()))
        stays = ("planned", "running") if going_on else ("planned",)
        self.past += [bar for bar in self.bars.values() if bar.standing not in stays]
        self.end_ms = content["forecast_ms"]
        steps = {step_content["id"]: activity_of(step_content) for step_content in content["steps"]}
        self.program = ActivityProgram(steps, timed=content.get("timed", False))
        self.bars = {
            step_content["id"]: StepBar(
                step_content["step"],
                step_content["stream"],
                step_content.get("start_ms", 0),
                step_content.get("lasts_ms", 0),
            )
            for step_content in content["steps"]
        }
        for number, step in going_on.items():
            if number in self.under_way:
                self._stand(step, "running", self.under_way[number][2])

    def _end(self, outcome: str) -> None:
        self.phase = outcome
        if outcome == HALTED:  # nothing of what was under way is answered any more
            self.under_way.clear()

    def _command(self, record: JournalRecord) -> None:
        content = record.content
        if content["command_kind"] in ("wait", "continue"):
            return
        if self.phase in (
            "ready",
            HALTED,
        ):  # that a plan was approved, or a run is taken up, is no phase of its own
            self.phase = "running"
        command_entry = (content["stream"], content["action"], record.at_ms, content["lasts_ms"])
        self.under_way[content["command"]] = command_entry
        self._stand(content.get("step"), "running", record.at_ms)

    def _done(self, content: Mapping[str, Any]) -> None:
        self._stand(content["step"], "done", content["started_ms"])
        if (bar := self.bars.get(content["step"])) is not None:
            lasts = self.now_ms - content["started_ms"]
            self.accuracy = self.accuracy.after(lasts, bar.lasts_ms)
            self.bars[content["step"]] = replace(bar, lasts_ms=lasts)
        self.facts.extend(
            [
                *(f"+ {added_fact}" for added_fact in content["adds"]),
                *(f"- {ended_fact}" for ended_fact in content["ends"]),
            ]
        )

    def _stand(self, step: int | None, standing: str, start_ms: int | None = None) -> None:
        if step is None or (bar := self.bars.get(step)) is None:
            return
        self.bars[step] = replace(
            bar, standing=standing, start_ms=bar.start_ms if start_ms is None else start_ms
        )


MAX_NEXT_STEPS = 5  # steps that have not begun
DEVICE_NAME_WIDTH = 16  # columns for the name of a device
# lines that are always there: the border, what is done, headings, and what is left blank
FRAME_LINES = 10
DISPLAY_KEYS = "p pause or continue   i interrupt   s stop   q leave the display"
FEW_KEYS = "p pause  i interrupt  s stop  q leave"
# in plain words
PHASE_WORDS = {"interrupting": "will pause", "quiescing": "comes to rest after a failure"}
STANDING_STYLES = {
    "done": "green",
    "running": "bold yellow",
    "failed": "bold red",
    "planned": "dim",
}


@dataclass
class RunDisplay(RunStanding):
    """How a run stands, on a terminal; `passed_ms` is the time on the run's clock since the
    last record.
    """

    passed_ms: Callable[[], float] = lambda: 0.0
    told: str = ""  # the last order to pause or go on that nothing has come of yet

    def take(self, record: JournalRecord) -> None:
        """Take in a record."""
        super().take(record)
        if record.kind is RecordKind.PHASE:
            self.told = ""

    def toggled(self) -> str:
        """The order that a person wants who pauses what goes on, or continues what pauses or is
        about to.
        """
        pauses = self.told or (
            "interrupt" if self.phase in ("paused", "interrupting") else "continue"
        )
        self.told = "continue" if pauses == "interrupt" else "interrupt"
        return self.told

    def __rich_console__(
        self, console: Console, options: ConsoleOptions
    ) -> Iterator[RenderableType]:
        now, chart = (
            self._shown_ms(),
            list(self._chart(max(10, options.max_width - DEVICE_NAME_WIDTH - 6))),
        )
        ahead = list(self.ahead().items())
        fixed = FRAME_LINES + len(self.under_way) + len(chart)
        log, following, facts = share_lines(
            options.max_height - 1 - fixed,
            (len(self.log), min(MAX_NEXT_STEPS, len(ahead)), len(self.facts)),
        )
        done = sum(step_bar.standing == "done" for step_bar in (*self.past, *self.bars.values()))
        title = (
            f"{self.run}: {PHASE_WORDS.get(self.phase, self.phase)}, {duration_text(now)} of "
            f"about {duration_text(max(self.end_ms, now))}"
        )
        parts: list[RenderableType] = [
            Text(f"{count_noun(done, 'step')} done, {len(self.bars)} in the plan")
        ]
        parts += [self._current(), Text(), self._next(ahead[:following]), Text(), *chart, Text()]
        parts += [
            Text("last changes", "bold"),
            *_last_lines(self.facts, facts),
            Text(),
            *_last_lines(self.log, log),
        ]
        yield Panel(
            Group(*parts),
            title=title if self.bars else f"{self.run}: no plan yet",
            subtitle=DISPLAY_KEYS if options.max_width > len(DISPLAY_KEYS) + 6 else FEW_KEYS,
        )

    def _shown_ms(self) -> int:
        """The time now, in whole seconds: while something is under way, the clock goes on
        without records.
        """
        passed = self.passed_ms() if self.under_way else 0.0
        return self.now_ms if not passed else round((self.now_ms + passed) / 1000) * 1000

    def _current(self) -> Table:
        """What each device does now."""
        table = Table("device", "current step", "since", box=None, pad_edge=False)
        for stream, action, since, _ in self.under_way.values():
            table.add_row(_cut_line(stream), _cut_line(action), _cut_line(duration_text(since)))
        return table

    def _next(self, ahead: Sequence[tuple[int, StartWindow | None]]) -> Table:
        """Steps that come next, with the times at which they probably begin as far as these can
        be told.
        """
        table = Table(
            "device", "next step", Column("begins", no_wrap=True), box=None, pad_edge=False
        )
        for step, window in ahead:
            bar = self.bars[step]
            table.add_row(_cut_line(bar.stream), _cut_line(bar.step), _cut_line(begin_text(window)))
        return table

    def _chart(self, width: int) -> Iterator[Text]:
        """A line for each device, and one with a mark at now."""
        bars = [*self.past, *self.bars.values()]
        last = max((bar.start_ms + bar.lasts_ms for bar in bars), default=0)
        scale = width / max(1, last, self.now_ms)
        for stream in dict.fromkeys(bar.stream for bar in bars):
            line = Text(f"{stream[: DEVICE_NAME_WIDTH - 1]:<{DEVICE_NAME_WIDTH}}")
            line.append_text(
                _device_lane([bar for bar in bars if bar.stream == stream], scale, width)
            )
            yield line
        now = min(width - 1, int(self._shown_ms() * scale))
        mark = "| now" if now < width - 6 else "now |"
        yield Text(
            " " * (DEVICE_NAME_WIDTH + now - (0 if mark[0] == "|" else len(mark) - 1)) + mark,
            "bold",
        )


def share_lines(lines: int, wanted_lines: Sequence[int]) -> list[int]:
    """How many lines each part gets if there are so many: one after another in turn, none more
    than it wants.
    """
    granted = [0] * len(wanted_lines)
    while lines > 0 and any(got < most for got, most in zip(granted, wanted_lines, strict=True)):
        for part, most in enumerate(wanted_lines):
            if granted[part] < most and lines > 0:
                granted[part], lines = granted[part] + 1, lines - 1
    return granted


def _cut_line(text: str) -> Text:
    """A text that is cut where the line ends."""
    return Text(text, no_wrap=True, overflow="ellipsis")


def _last_lines(texts: Collection[str], count: int) -> list[Text]:
    """The last ones of some texts."""
    return [_cut_line(text) for text in list(texts)[len(texts) - count :]]


def _device_lane(bars: list[StepBar], scale: float, width: int) -> Text:
    cells, styles = [" "] * width, [""] * width
    for lane_bar in sorted(bars, key=lambda bar: bar.standing != "planned"):
        first = min(width - 1, int(lane_bar.start_ms * scale))
        last = min(width - 1, max(first, int((lane_bar.start_ms + lane_bar.lasts_ms) * scale) - 1))
        for place in range(first, last + 1):
            cells[place] = (
                "."
                if lane_bar.standing == "planned"
                else "X"
                if lane_bar.standing == "failed"
                else "="
            )
            styles[place] = STANDING_STYLES[lane_bar.standing]
    text = Text()
    for style, places in groupby(range(width), styles.__getitem__):
        text.append("".join(cells[place] for place in places), style)
    return text
