"""How a run stands, as its records tell: the steps of its plans, what is under way, what changed last, and a log.

A `Standing` takes in one record after another; whatever shows a run draws it.
"""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from cellwright.engine.formats.report.execution import duration
from cellwright.engine.formats.report.narration import narrated
from cellwright.engine.model.execution import Phase, Record, RecordKind
from cellwright.engine.pipelines.execution.records import activity_of
from cellwright.engine.stages.execution import Program, Running, standing_of
from cellwright.engine.stages.execution.outlook import TOLERANCE_MS, Accuracy, Window, outlook

LOG, FACTS = 8, 6  # lines of the log, last changes of the world
HALTED = "stopped"


@dataclass(frozen=True, slots=True)
class Bar:
    """A step of a plan: when it begins and how long it lasts, as forecast or as it was, and how it stands.

    It stands `planned`, `running`, `done` or `failed`.
    """

    step: str
    stream: str
    start_ms: int
    lasts_ms: int
    standing: str = "planned"


def begins(window: Window | None) -> str:
    """When a step probably begins, and by how much this may be off; nothing but its place in the order if nobody can say."""
    if window is None:
        return "later"
    off = round(window.off_ms / 1000)
    start = duration(round(window.start_ms / 1000) * 1000)
    return f"{start}, {off} s sooner or later" if off else start


@dataclass
class Standing:
    """A run up to a record: `bars` are the steps of its last plan, `past` those of plans before it that had begun."""

    run: str
    phase: str = "ready"
    now_ms: int = 0
    end_ms: int = 0
    bars: dict[int, Bar] = field(default_factory=dict)
    past: list[Bar] = field(default_factory=list)
    under_way: dict[int, tuple[str, str, int, int]] = field(
        default_factory=dict
    )  # stream, action, since, lasts
    facts: deque[str] = field(default_factory=lambda: deque(maxlen=FACTS))
    log: deque[str] = field(default_factory=lambda: deque(maxlen=LOG))
    accuracy: Accuracy = field(default_factory=Accuracy)  # of the forecasts of this run, as far as it is
    tolerance_ms: int = TOLERANCE_MS  # starts that may be off by more are not told
    program: Program | None = None
    _ahead: Mapping[int, Window | None] | None = None

    def ahead(self) -> Mapping[int, Window | None]:
        """The steps that have not begun, in the order of the forecast: when each begins, or None where that cannot be said."""
        if self._ahead is None and self.program is not None:
            running = {
                n: Running(n, bar.start_ms) for n, bar in self.bars.items() if bar.standing == "running"
            }
            done = [n for n, bar in self.bars.items() if bar.standing == "done"]
            standing = standing_of(self.program, self.now_ms, 0, Phase.RUNNING, done, running)
            self._ahead = outlook(self.program, standing, self.accuracy, self.tolerance_ms)
        return self._ahead or {}

    def take(self, record: Record) -> None:
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
        self.log.extend(narrated(record))

    def _plan(self, content: Mapping[str, Any]) -> None:
        self.phase = "running"
        going_on = dict(content.get("running", ()))
        stays = ("planned", "running") if going_on else ("planned",)
        self.past += [each for each in self.bars.values() if each.standing not in stays]
        self.end_ms = content["forecast_ms"]
        steps = {each["id"]: activity_of(each) for each in content["steps"]}
        self.program = Program(steps, timed=content.get("timed", False))
        self.bars = {
            each["id"]: Bar(each["step"], each["stream"], each.get("start_ms", 0), each.get("lasts_ms", 0))
            for each in content["steps"]
        }
        for number, step in going_on.items():
            if number in self.under_way:
                self._stand(step, "running", self.under_way[number][2])

    def _end(self, outcome: str) -> None:
        self.phase = outcome
        if outcome == HALTED:  # nothing of what was under way is answered any more
            self.under_way.clear()

    def _command(self, record: Record) -> None:
        content = record.content
        if content["command_kind"] in ("wait", "continue"):
            return
        if self.phase in (
            "ready",
            HALTED,
        ):  # that a plan was approved, or a run is taken up, is no phase of its own
            self.phase = "running"
        said = (content["stream"], content["action"], record.at_ms, content["lasts_ms"])
        self.under_way[content["command"]] = said
        self._stand(content.get("step"), "running", record.at_ms)

    def _done(self, content: Mapping[str, Any]) -> None:
        self._stand(content["step"], "done", content["started_ms"])
        if (bar := self.bars.get(content["step"])) is not None:
            lasts = self.now_ms - content["started_ms"]
            self.accuracy = self.accuracy.after(lasts, bar.lasts_ms)
            self.bars[content["step"]] = replace(bar, lasts_ms=lasts)
        self.facts.extend(
            [*(f"+ {each}" for each in content["adds"]), *(f"- {each}" for each in content["ends"])]
        )

    def _stand(self, step: int | None, standing: str, start_ms: int | None = None) -> None:
        if step is None or (bar := self.bars.get(step)) is None:
            return
        self.bars[step] = replace(
            bar, standing=standing, start_ms=bar.start_ms if start_ms is None else start_ms
        )
