"""Follows the journal of a run, and tells how the run stood at any of its records."""

from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, fields
from typing import Any

from cellwright.engine.faces.monitor.goals import GoalIndex
from cellwright.engine.faces.monitor.keeping import Kept
from cellwright.engine.formats.report.narration import narrated
from cellwright.engine.formats.report.standing import Standing
from cellwright.engine.model.execution import OBSTRUCTED, CommandKind, Phase, Record, RecordKind
from cellwright.kb.store.journal import Begun, Journal, Line

KEPT = 2000  # records at least between two states that are kept for going back
STATES = 8  # that are kept at most
SEEKING = (CommandKind.TEST, CommandKind.REPAIR, CommandKind.ASK)
Content = dict[str, Any]
LOG, DONE = 2000, 400  # lines of the log, and steps that were done, that are kept for pages


@dataclass
class Watched(Standing):
    """All that a page shows of a run up to a record.

    `holds` are the facts of the world model, each with the number of the record that brought it. `why` says, for each step of
    the last plan, the steps that it waits for. `met` are bodies that were seen where the cell does not have them, as records tell
    of them; `stopped` are the commands whose arm met something, and went back.
    """

    number: int = 0
    holds: dict[str, int] = field(default_factory=dict)
    story: list[tuple[int, str]] = field(default_factory=list)  # number of the record, what it tells
    results: list[dict[str, Any]] = field(default_factory=list)
    findings: list[dict[str, Any]] = field(default_factory=list)
    questions: dict[int, dict[str, Any]] = field(default_factory=dict)  # commands that ask a person
    histories: list[dict[str, Any]] = field(default_factory=list)
    goals: dict[str, str] = field(default_factory=dict)  # open, reached, or why it was given up
    index: GoalIndex = field(default_factory=GoalIndex)  # those of the goals that are single facts
    plan: dict[str, Any] = field(default_factory=dict)
    met: dict[str, dict[str, Any]] = field(default_factory=dict)
    stopped: set[int] = field(default_factory=set)

    def copied(self) -> "Watched":
        """The same, to go on from. What its lists hold is never changed, so it is not copied."""
        return Watched(**{each.name: copy(getattr(self, each.name)) for each in fields(self)})

    def take(self, record: Record) -> None:
        """Take in a record."""
        super().take(record)
        self.number = record.number
        self.story += [(record.number, line) for line in narrated(record)]
        del self.story[:-LOG]
        if (move := MOVES.get(record.kind)) is not None:
            move(self, dict(record.content), record)

    def planned(self, content: Content, _: Record) -> None:
        """Another plan."""
        self.plan = content
        self.goals = {each: self.goals.get(each, "open") for each in content["goals"]}
        self.index = GoalIndex.of(self.goals)
        self._meet(self.holds)
        self.goals |= dict(content["given_up"])

    def asked(self, content: Content, _: Record) -> None:
        """A command was noted; some ask a person, and some look for what went wrong."""
        if content["command_kind"] in SEEKING:
            self.phase = Phase.HANDLING.value
        if content.get("asks"):
            self.questions[content["command"]] = content

    def answered(self, content: Content, _: Record) -> None:
        """A command was answered."""
        self.questions.pop(content["command"], None)
        if content.get("text") == OBSTRUCTED:
            self.stopped.add(content["command"])

    def did(self, content: Content, record: Record) -> None:
        """A step was done."""
        self.become(content, record)
        self.histories.append({**content, "ended_ms": record.at_ms})
        del self.histories[:-DONE]

    def measured(self, content: Content, record: Record) -> None:
        """A value was measured."""
        self.results.append({**content, "at_ms": record.at_ms})

    def found(self, content: Content, record: Record) -> None:
        """An exception, or what was found out about it."""
        self.findings.append({**content, "kind": record.kind.value, "at_ms": record.at_ms})

    def reached(self, content: Content, _: Record) -> None:
        """A goal was reached."""
        self.goals[content["goal"]] = "reached"

    def gave_up(self, content: Content, _: Record) -> None:
        """A goal was given up."""
        self.goals[content["goal"]] = content["why"]

    def ended(self, content: Content, _: Record) -> None:
        """The run ended."""
        self.goals |= dict.fromkeys(content["goals"], "reached")

    def become(self, content: Content, _: Record) -> None:
        """The world model changed."""
        opened = {goal for each in content["ends"] for goal in self.index.met_by(each)}
        self.goals |= {goal: "open" for goal in opened if self.goals[goal] == "reached"}
        for each in content["ends"]:
            self.holds.pop(each, None)
        for each in content["adds"]:
            self.holds[each] = self.number
        self._meet(self.holds if opened & self.index.general else content["adds"])
        for name, seen in content.get("bodies", {}).items():
            self.met.pop(name, None)
            self.met |= {name: seen} if seen else {}

    def _meet(self, facts: Iterable[str]) -> None:
        """Some facts hold from now on, and so do the goals that they meet, unless these are given up."""
        for each in facts:
            self.goals |= {goal: "reached" for goal in self.index.met_by(each) if self.goals[goal] == "open"}


MOVES = {
    RecordKind.PLAN: Watched.planned,
    RecordKind.COMMAND: Watched.asked,
    RecordKind.REPLY: Watched.answered,
    RecordKind.DONE: Watched.did,
    RecordKind.WORLD: Watched.become,
    RecordKind.RESULT: Watched.measured,
    RecordKind.EXCEPTION: Watched.found,
    RecordKind.FINDING: Watched.found,
    RecordKind.DIAGNOSIS: Watched.found,
    RecordKind.GOAL: Watched.reached,
    RecordKind.GIVEN_UP: Watched.gave_up,
    RecordKind.END: Watched.ended,
}


class Follower:
    """The records of one run, read from its journal as they come. Raises `InvalidInput` if the journal has no such run."""

    def __init__(self, store: str, run: str, initial: Sequence[str] = ()) -> None:
        with Journal(store) as journal:
            self.about: Mapping[str, Any] = journal.known(run).document
        self.store, self.run = store, run
        self.records = Kept(self._read)
        self._exceptions: list[int] = []
        self._ends: dict[int, int] = {}
        self.latest = Watched(run, holds=dict.fromkeys(initial, 0))
        self._kept, self._apart = [self.latest.copied()], KEPT
        self._journal: Journal | None = None

    def refresh(self) -> int:
        """Read what has come; how many records that are."""
        fresh = 0
        for line in self._open().lines(self.run, len(self.records)):
            self._take(record_of(line))
            fresh += 1
        return fresh

    def _take(self, record: Record) -> None:
        self.records.append(record)
        self.latest.take(record)
        if record.kind is RecordKind.REPLY:
            self._ends[record.content["command"]] = record.at_ms
        if record.kind is RecordKind.EXCEPTION:
            self._exceptions.append(record.number)
        if record.number == self._apart * len(self._kept):
            self._kept.append(self.latest.copied())
        if len(self._kept) > STATES:  # half of them, twice as far apart, are as good for a longer run
            self._kept, self._apart = self._kept[::2], 2 * self._apart

    def _open(self) -> Journal:
        if self._journal is None:
            self._journal = Journal(self.store)
        return self._journal

    def _read(self, after: int, until: int) -> list[Record]:
        return [record_of(line) for line in self._open().lines(self.run, after, until=until)]

    def done(self, after: int, until: int) -> list[Content]:
        """The steps that were done behind one record up to another one, with the time at which each ended."""
        found = self._open().lines(self.run, after, [RecordKind.DONE.value], until)
        return [{**line.content, "number": line.number, "ended_ms": line.at_ms} for line in found]

    def close(self) -> None:
        """Give back the connection to the journal; the next look opens another one."""
        if self._journal is not None:
            self._journal.close()
            self._journal = None

    def at(self, number: int, before: Watched | None = None) -> Watched:
        """How the run stood after a record; the last one if the number is beyond it.

        `before` is how it stood a little before. It is taken on, which is quicker than to start anew.
        """
        if number >= len(self.records):
            return self.latest
        number, kept = max(0, number), self._kept[max(0, number) // self._apart]
        useful = before is not None and before is not self.latest and kept.number <= before.number <= number
        found = before if before is not None and useful else kept.copied()
        for record in self.records[found.number : number]:
            found.take(record)
        return found

    def number_at(self, at_ms: float) -> int:
        """The number of the last record up to a time on the run's clock; at least 1."""
        return max(1, self.records.number_at(at_ms))

    def ends_ms(self, command: int) -> int | None:
        """When a command had ended; None if it has not."""
        return self._ends.get(command)

    def exceptions(self) -> list[int]:
        """The numbers of the records that tell of an exception."""
        return self._exceptions


def record_of(line: Line) -> Record:
    """A line of a journal as a record."""
    return Record(line.number, line.at_ms, RecordKind(line.kind), line.content)


def runs_of(store: str) -> tuple[Begun, ...]:
    """The runs in a store, the newest first."""
    with Journal(store) as journal:
        return journal.begun()[::-1]


def first_difference(one: Sequence[Record], other: Sequence[Record], same: int = 0) -> int:
    """The number of the first record that two runs do not share; 0 if they are the same. Times and the run itself do not count.

    So many of the first records are known to be the `same`.
    """
    both = min(len(one), len(other))
    for n in range(max(1, same), both):
        if (one[n].kind, one[n].content) != (other[n].kind, other[n].content):
            return n + 1
    return 0 if len(one) == len(other) else both + 1
