"""Follows the journal of a run: its records, the run's state at any record, and a player."""

import threading
from array import array
from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, fields
from typing import Any, overload

from cellwright.engine.formats.report.runs.run_display import RunStanding
from cellwright.engine.formats.report.runs.run_report import narrate_record
from cellwright.engine.model.run_protocol import (
    OBSTRUCTED_REPLIES,
    CommandKind,
    JournalRecord,
    RecordKind,
    RunPhase,
)
from cellwright.kb.store.journal import Begun, Journal, JournalLine
from cellwright.kb.store.term_notation import NotationError, read_stored_atom
from cellwright.kb.terms import ANYTHING, Function, Term

Mask = tuple[bool, ...]  # for each argument whether the goal says what it is


@dataclass(frozen=True, slots=True)
class GoalIndex:
    """Goals that are single facts, by predicate and by the arguments that they name.

    Other goals are in no index.
    """

    masks: dict[str, dict[Mask, dict[tuple[Term, ...], str]]] = field(default_factory=dict)
    general: set[str] = field(default_factory=set)  # those that several facts can meet

    @classmethod
    def of(cls, goals: Iterable[str]) -> "GoalIndex":
        """The index of some goals."""
        index = cls()
        for goal in goals:
            if (atom := _fact_of(goal)) is not None:
                mask = tuple(argument != ANYTHING for argument in atom.arguments)
                index.general.update([] if all(mask) else [goal])
                index.masks.setdefault(atom.name, {}).setdefault(mask, {})[
                    _named_arguments(atom, mask)
                ] = goal
        return index

    def met_by(self, fact: str) -> list[str]:
        """The goals that a fact meets."""
        masks = self.masks.get(fact.partition("(")[0])
        atom = _fact_of(fact) if masks else None
        if masks is None or atom is None:
            return []
        fitting = (mask for mask in masks if len(mask) == len(atom.arguments))
        goals = (masks[mask].get(_named_arguments(atom, mask)) for mask in fitting)
        return [goal for goal in goals if goal is not None]


def _fact_of(text: str) -> Function | None:
    try:
        return read_stored_atom(text)
    except NotationError:
        return None


def _named_arguments(atom: Function, mask: Mask) -> tuple[Term, ...]:
    return tuple(argument for argument, said in zip(atom.arguments, mask, strict=True) if said)


RECORDS_PER_PAGE = 500  # records that are read, and let go, together
MAX_PAGES = 12  # that are in memory at most
Read = Callable[[int, int], list[JournalRecord]]  # the records behind a number up to another one


class RecordPages(Sequence[JournalRecord]):
    """The records of a run in their order, as far as they are known; `read` gives those again that
    are no longer in memory.

    What is in memory does not grow with the run, but for 8 bytes a record.
    """

    def __init__(self, read: Read) -> None:
        self._read = read
        self._times = array("q")  # ms on the run's clock
        self._pages: OrderedDict[int, list[JournalRecord]] = OrderedDict()
        self._turning = threading.Lock()

    def append(self, record: JournalRecord) -> None:
        """One record more; its number is the next one."""
        with self._turning:
            self._page(len(self._times) // RECORDS_PER_PAGE).append(record)
            self._times.append(record.at_ms)

    def __len__(self) -> int:
        return len(self._times)

    @overload
    def __getitem__(self, at: int) -> JournalRecord: ...
    @overload
    def __getitem__(self, at: slice) -> list[JournalRecord]: ...
    def __getitem__(self, at: int | slice) -> JournalRecord | list[JournalRecord]:
        with self._turning:
            if isinstance(at, int):
                place = range(len(self))[at]
                return self._page(place // RECORDS_PER_PAGE)[place % RECORDS_PER_PAGE]
            return [
                self._page(place // RECORDS_PER_PAGE)[place % RECORDS_PER_PAGE]
                for place in range(len(self))[at]
            ]

    def number_at(self, at_ms: float) -> int:
        """The number of the last record up to a time on the run's clock; 0 if there is none."""
        return bisect_right(self._times, at_ms)

    def _page(self, page: int) -> list[JournalRecord]:
        if page not in self._pages:
            self._pages[page] = self._read(
                RECORDS_PER_PAGE * page, min(RECORDS_PER_PAGE * (page + 1), len(self._times))
            )
            while len(self._pages) > MAX_PAGES:
                self._pages.popitem(last=False)
        self._pages.move_to_end(page)
        return self._pages[page]


RECORDS_BETWEEN_STATES = 2000  # records at least between two states that are kept for going back
MAX_SAVED_STATES = 8  # that are kept at most
HANDLING_COMMANDS = (CommandKind.TEST, CommandKind.REPAIR, CommandKind.ASK)
Content = dict[str, Any]
LOG, DONE = 2000, 400  # lines of the log, and steps that were done, that are kept for pages


@dataclass
class WatchedRun(RunStanding):
    """All that a page shows of a run up to a record.

    `holds` are the facts of the world model, each with the number of the record that brought it.
    `why` says, for each step of the last plan, the steps that it waits for. `met` are bodies that
    were seen where the cell does not have them, as records tell of them; `stopped` are the commands
    whose arm met something, and went back.
    """

    number: int = 0
    holds: dict[str, int] = field(default_factory=dict)
    # number of the record, what it tells
    story: list[tuple[int, str]] = field(default_factory=list)
    results: list[dict[str, Any]] = field(default_factory=list)
    findings: list[dict[str, Any]] = field(default_factory=list)
    questions: dict[int, dict[str, Any]] = field(default_factory=dict)  # commands that ask a person
    histories: list[dict[str, Any]] = field(default_factory=list)
    goals: dict[str, str] = field(default_factory=dict)  # open, reached, or why it was given up
    index: GoalIndex = field(default_factory=GoalIndex)  # those of the goals that are single facts
    plan: dict[str, Any] = field(default_factory=dict)
    met: dict[str, dict[str, Any]] = field(default_factory=dict)
    stopped: set[int] = field(default_factory=set)

    def copied(self) -> "WatchedRun":
        """The same, to go on from. What its lists hold is never changed, so it is not copied."""
        return WatchedRun(
            **{
                state_field.name: copy(getattr(self, state_field.name))
                for state_field in fields(self)
            }
        )

    def take(self, record: JournalRecord) -> None:
        """Take in a record."""
        super().take(record)
        self.number = record.number
        self.story += [(record.number, line) for line in narrate_record(record)]
        del self.story[:-LOG]
        if (move := STATE_CHANGES.get(record.kind)) is not None:
            move(self, dict(record.content), record)

    def planned(self, content: Content, _: JournalRecord) -> None:
        """Another plan."""
        self.plan = content
        self.goals = {goal: self.goals.get(goal, "open") for goal in content["goals"]}
        self.index = GoalIndex.of(self.goals)
        self._meet(self.holds)
        self.goals |= dict(content["given_up"])

    def asked(self, content: Content, _: JournalRecord) -> None:
        """A command was noted; some ask a person, and some look for what went wrong."""
        if content["command_kind"] in HANDLING_COMMANDS:
            self.phase = RunPhase.HANDLING.value
        if content.get("asks"):
            self.questions[content["command"]] = content

    def answered(self, content: Content, _: JournalRecord) -> None:
        """A command was answered."""
        self.questions.pop(content["command"], None)
        if content.get("text") == OBSTRUCTED_REPLIES:
            self.stopped.add(content["command"])

    def did(self, content: Content, record: JournalRecord) -> None:
        """A step was done."""
        self.become(content, record)
        self.histories.append({**content, "ended_ms": record.at_ms})
        del self.histories[:-DONE]

    def measured(self, content: Content, record: JournalRecord) -> None:
        """A value was measured."""
        self.results.append({**content, "at_ms": record.at_ms})

    def found(self, content: Content, record: JournalRecord) -> None:
        """An exception, or what was found out about it."""
        self.findings.append({**content, "kind": record.kind.value, "at_ms": record.at_ms})

    def reached(self, content: Content, _: JournalRecord) -> None:
        """A goal was reached."""
        self.goals[content["goal"]] = "reached"

    def gave_up(self, content: Content, _: JournalRecord) -> None:
        """A goal was given up."""
        self.goals[content["goal"]] = content["why"]

    def ended(self, content: Content, _: JournalRecord) -> None:
        """The run ended."""
        self.goals |= dict.fromkeys(content["goals"], "reached")

    def become(self, content: Content, _: JournalRecord) -> None:
        """The world model changed."""
        opened = {goal for fact in content["ends"] for goal in self.index.met_by(fact)}
        self.goals |= {goal: "open" for goal in opened if self.goals[goal] == "reached"}
        for ended_fact in content["ends"]:
            self.holds.pop(ended_fact, None)
        for added_fact in content["adds"]:
            self.holds[added_fact] = self.number
        self._meet(self.holds if opened & self.index.general else content["adds"])
        for name, seen in content.get("bodies", {}).items():
            self.met.pop(name, None)
            self.met |= {name: seen} if seen else {}

    def _meet(self, facts: Iterable[str]) -> None:
        """Some facts hold from now on, and so do the goals that they meet, unless these are
        given up.
        """
        for fact in facts:
            self.goals |= {
                goal: "reached" for goal in self.index.met_by(fact) if self.goals[goal] == "open"
            }


STATE_CHANGES = {
    RecordKind.PLAN: WatchedRun.planned,
    RecordKind.COMMAND: WatchedRun.asked,
    RecordKind.REPLY: WatchedRun.answered,
    RecordKind.DONE: WatchedRun.did,
    RecordKind.WORLD: WatchedRun.become,
    RecordKind.RESULT: WatchedRun.measured,
    RecordKind.EXCEPTION: WatchedRun.found,
    RecordKind.FINDING: WatchedRun.found,
    RecordKind.DIAGNOSIS: WatchedRun.found,
    RecordKind.GOAL: WatchedRun.reached,
    RecordKind.GIVEN_UP: WatchedRun.gave_up,
    RecordKind.END: WatchedRun.ended,
}


class RunFollower:
    """The records of one run, read from its journal as they come.

    Raises `InvalidInput` if the journal has no such run.
    """

    def __init__(self, store: str, run: str, initial: Sequence[str] = ()) -> None:
        with Journal(store) as journal:
            self.about: Mapping[str, Any] = journal.known(run).document
            journal.require_whole(run, unchained=True)
        self.store, self.run = store, run
        self.records = RecordPages(self._read)
        self._exceptions: list[int] = []
        self._ends: dict[int, int] = {}
        self.latest = WatchedRun(run, holds=dict.fromkeys(initial, 0))
        self._kept, self._apart = [self.latest.copied()], RECORDS_BETWEEN_STATES
        self._journal: Journal | None = None

    def refresh(self) -> int:
        """Read what has come; how many records that are."""
        fresh = 0
        for line in self._open().lines(self.run, len(self.records)):
            self._take(journal_record(line))
            fresh += 1
        return fresh

    def _take(self, record: JournalRecord) -> None:
        self.records.append(record)
        self.latest.take(record)
        if record.kind is RecordKind.REPLY:
            self._ends[record.content["command"]] = record.at_ms
        if record.kind is RecordKind.EXCEPTION:
            self._exceptions.append(record.number)
        if record.number == self._apart * len(self._kept):
            self._kept.append(self.latest.copied())
        if (
            len(self._kept) > MAX_SAVED_STATES
        ):  # half of them, twice as far apart, are as good for a longer run
            self._kept, self._apart = self._kept[::2], 2 * self._apart

    def _open(self) -> Journal:
        if self._journal is None:
            self._journal = Journal(self.store)
        return self._journal

    def _read(self, after: int, until: int) -> list[JournalRecord]:
        return [journal_record(line) for line in self._open().lines(self.run, after, until=until)]

    def done(self, after: int, until: int) -> list[Content]:
        """The steps that were done behind one record up to another one, with the time at which
        each ended.
        """
        lines = self._open().lines(self.run, after, [RecordKind.DONE.value], until)
        return [{**line.content, "number": line.number, "ended_ms": line.at_ms} for line in lines]

    def close(self) -> None:
        """Give back the connection to the journal; the next look opens another one."""
        if self._journal is not None:
            self._journal.close()
            self._journal = None

    def at(self, number: int, before: WatchedRun | None = None) -> WatchedRun:
        """How the run stood after a record; the last one if the number is beyond it.

        `before` is how it stood a little before. It is taken on, which is quicker than to start
        anew.
        """
        if number >= len(self.records):
            return self.latest
        number, kept = max(0, number), self._kept[max(0, number) // self._apart]
        useful = (
            before is not None
            and before is not self.latest
            and kept.number <= before.number <= number
        )
        state = before if before is not None and useful else kept.copied()
        for record in self.records[state.number : number]:
            state.take(record)
        return state

    def number_at(self, at_ms: float) -> int:
        """The number of the last record up to a time on the run's clock; at least 1."""
        return max(1, self.records.number_at(at_ms))

    def ends_ms(self, command: int) -> int | None:
        """When a command had ended; None if it has not."""
        return self._ends.get(command)

    def exceptions(self) -> list[int]:
        """The numbers of the records that tell of an exception."""
        return self._exceptions


def journal_record(line: JournalLine) -> JournalRecord:
    """A line of a journal as a record."""
    return JournalRecord(line.number, line.at_ms, RecordKind(line.kind), line.content)


def runs_of(store: str) -> tuple[Begun, ...]:
    """The runs in a store, the newest first."""
    with Journal(store) as journal:
        return journal.begun()[::-1]


def first_difference(
    one: Sequence[JournalRecord], other: Sequence[JournalRecord], same: int = 0
) -> int:
    """The number of the first record that two runs do not share; 0 if they are the same. Times and
    the run itself do not count.

    So many of the first records are known to be the `same`.
    """
    both = min(len(one), len(other))
    for n in range(max(1, same), both):
        if (one[n].kind, one[n].content) != (other[n].kind, other[n].content):
            return n + 1
    return 0 if len(one) == len(other) else both + 1


PLAYER_SPEEDS = (-1000, -100, -10, -1, 1, 10, 100, 1000)


@dataclass
class RunPlayer:
    """`number` is the record that is shown, `clock_ms` the time on the run's clock. `live`, it
    stays at the end; at a `speed` of 0 it stands.
    """

    follower: RunFollower
    live: bool = True
    speed: float = 0.0
    number: int = 0
    clock_ms: float = 0.0
    _looked_s: float | None = None
    _came_s: float = 0.0

    def tick(self, now_s: float, goes_on: bool = True) -> None:
        """Go on. `now_s` is a clock that never goes back."""
        passed_s = now_s - (self._looked_s if self._looked_s is not None else now_s)
        self._looked_s = now_s
        if self.live:
            self._at_the_end(now_s, goes_on)
        elif self.speed:
            self._moved(1000 * passed_s * self.speed)

    def _at_the_end(self, now_s: float, goes_on: bool) -> None:
        count = len(self.follower.records)
        if count != self.number or not self._came_s:
            self.number, self._came_s = count, now_s
        factor = float(self.follower.about.get("factor", 0) or 0)
        since = 1000 * (now_s - self._came_s) / factor if factor and goes_on else 0.0
        self.clock_ms = self.last_ms + since

    @property
    def last_ms(self) -> int:
        """The time of the last record."""
        return self.follower.records[-1].at_ms if self.follower.records else 0

    def _moved(self, by_ms: float) -> None:
        wanted = self.clock_ms + by_ms
        self.clock_ms = min(max(0.0, wanted), float(self.last_ms))
        self.number = self.follower.number_at(self.clock_ms)
        if wanted != self.clock_ms:
            self.speed = 0.0

    def go_to(self, number: int) -> None:
        """Go to a record, and stand there."""
        self.live, self.speed = False, 0.0
        self.number = max(0, min(number, len(self.follower.records)))
        self.clock_ms = float(self.follower.records[self.number - 1].at_ms) if self.number else 0.0

    def to_the_end(self) -> None:
        """Show the end, and whatever comes."""
        self.live, self.speed = True, 0.0

    def play(self, speed: float) -> None:
        """Go through the run from here; from its other end, if this is the end."""
        at_end = self.clock_ms >= self.last_ms if speed > 0 else self.clock_ms <= 0
        if self.live or at_end:
            self.go_to(0 if speed > 0 else len(self.follower.records))
        self.speed = speed

    def to_exception(self) -> bool:
        """Go to the next exception behind the record that is shown, or to the first one;
        whether there is one.
        """
        numbers = self.follower.exceptions()
        if numbers:
            self.go_to(
                next(
                    (
                        exception_number
                        for exception_number in numbers
                        if exception_number > self.number
                    ),
                    numbers[0],
                )
            )
        return bool(numbers)
