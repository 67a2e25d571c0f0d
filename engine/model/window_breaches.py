"""What windows of time mean for a plan with times: which events they join, and what is broken.

This is the only place that says it. The checker asks it with the times of a plan, a scheduler with
the order of its steps. An occurrence of the earlier event is joined with the next occurrence of the
later one, if none of the earlier comes between. If no later one follows any earlier one, the first
earlier and the last later are joined: they come the wrong way round. The start and the end of the
plan are joined with every occurrence.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from cellwright.kb.model.plan_model import INITIAL_STEP, Plan, StepId
from cellwright.kb.model.time_windows import (
    Bindings,
    EventKind,
    EventPattern,
    Side,
    TimeOfWork,
    TimeWindow,
)
from cellwright.kb.terms import Atom, Term, term_variables

MAX_LISTED_BREACHES = 6  # breaches that are told in words


@dataclass(frozen=True, slots=True)
class Occurrence:
    """Something that a step does: `step` is its place in the order of the plan, -1 for what is so
    from the start.
    """

    kind: EventKind
    atom: Atom
    step: int


FROM_THE_START, PLAN_EVENT = -1, -2
Rank = Callable[[Occurrence, Side], tuple[int, int]]


@dataclass(frozen=True, slots=True)
class WindowPair:
    """Two occurrences that a window joins; None is the start or the end of the plan."""

    window: TimeWindow
    earlier: Occurrence | None
    later: Occurrence | None


def occurrences_of(
    steps: Sequence[Atom],
    changes: Sequence[tuple[Iterable[Atom], Iterable[Atom], Iterable[Atom]]],
    initial: Iterable[Atom],
    every: bool = False,
) -> list[Occurrence]:
    """What the steps of a plan do, in its order; `changes` are what each adds and ends, and its
    events. What a step adds that held already does not become true; it counts if `every` adding
    and ending is asked for.
    """
    state = set(initial)
    said = [Occurrence(EventKind.FACT, atom, FROM_THE_START) for atom in sorted(state, key=str)]
    for place, (step, (adds, ends, events)) in enumerate(zip(steps, changes, strict=True)):
        added, ended = set(adds), set(ends)
        said.append(Occurrence(EventKind.STEP, step, place))
        said += (Occurrence(EventKind.EVENT, atom, place) for atom in sorted(events, key=str))
        new, gone = (added, ended) if every else (added - state, (ended & state) - added)
        said += (Occurrence(EventKind.FACT, atom, place) for atom in sorted(new, key=str))
        said += (Occurrence(EventKind.ENDING, atom, place) for atom in sorted(gone, key=str))
        state = (state - ended) | added
    return said


class Joining:
    """The occurrences of a plan, by kind and name, so that each window finds its own."""

    def __init__(self, occurrences: Iterable[Occurrence]) -> None:
        self._by_name: dict[tuple[EventKind, str], list[Occurrence]] = defaultdict(list)
        for occurrence in occurrences:
            self._by_name[occurrence.kind, occurrence.atom.name].append(occurrence)

    def matching(
        self, window: TimeWindow, pattern: EventPattern
    ) -> Iterator[tuple[Occurrence, Bindings]]:
        """The occurrences of a pattern, with the values of its variables."""
        for occurrence in self._by_name.get((pattern.kind, pattern.atom.name), ()):
            bound = window.bindings(pattern, occurrence.atom)
            if bound is not None:
                yield occurrence, bound

    def pairs(self, window: TimeWindow, rank: Rank) -> Iterator[WindowPair]:
        """What a window joins, if occurrences come in the order of their ranks."""
        if window.earlier.kind is EventKind.PLAN or window.later.kind is EventKind.PLAN:
            yield from self._with_plan(window)
            return
        for earlier, later in self.groups(window).values():
            yield from _joined_in_turn(window, earlier, later, rank)

    def groups(
        self, window: TimeWindow
    ) -> dict[tuple[Term, ...], tuple[list[Occurrence], list[Occurrence]]]:
        """The occurrences of both events, together if the variables in both have equal values."""
        own = set(term_variables(window.later.atom))
        shared = [v for v in dict.fromkeys(term_variables(window.earlier.atom)) if v in own]
        shared = [variable for variable in shared if variable.name != "_"]
        found: dict[tuple[Term, ...], tuple[list[Occurrence], list[Occurrence]]] = defaultdict(
            lambda: ([], [])
        )
        for occurrence, bound in self.matching(window, window.earlier):
            found[tuple(bound[v] for v in shared)][0].append(occurrence)
        for occurrence, bound in self.matching(window, window.later):
            if occurrence.step != FROM_THE_START:
                found[tuple(bound[v] for v in shared)][1].append(occurrence)
        return found

    def is_fixed(self, window: TimeWindow) -> bool:
        """Whether a window joins the same occurrences in whatever order they come."""
        if EventKind.PLAN in (window.earlier.kind, window.later.kind):
            return True
        groups = self.groups(window).values()
        return all(len(earlier) <= 1 and len(later) <= 1 for earlier, later in groups)

    def _with_plan(self, window: TimeWindow) -> Iterator[WindowPair]:
        if window.earlier.kind is window.later.kind:
            yield WindowPair(window, None, None)
        elif window.earlier.kind is EventKind.PLAN:
            for occurrence, _ in self.matching(window, window.later):
                if occurrence.step != FROM_THE_START:
                    yield WindowPair(window, None, occurrence)
        else:
            for occurrence, _ in self.matching(window, window.earlier):
                yield WindowPair(window, occurrence, None)


def _joined_in_turn(
    window: TimeWindow, earlier: Sequence[Occurrence], later: Sequence[Occurrence], rank: Rank
) -> Iterator[WindowPair]:
    line = sorted(
        [(rank(each, window.earlier.side), 1, each) for each in earlier]
        + [(rank(each, window.later.side), 0, each) for each in later],
        key=lambda entry: entry[:2],
    )
    waiting: Occurrence | None = None
    joined = False
    for _, opens, occurrence in line:
        if opens:
            waiting = occurrence
        elif waiting is not None:
            joined = True
            yield WindowPair(window, waiting, occurrence)
            waiting = None
    begun = [each for each in earlier if each.step != FROM_THE_START]
    if not joined and begun and later:
        first = min(begun, key=lambda each: rank(each, window.earlier.side))
        last = max(later, key=lambda each: rank(each, window.later.side))
        if first != last:
            yield WindowPair(window, first, last)


@dataclass(frozen=True, slots=True)
class WindowSpan:
    """A window in a plan with times: both events in words, and when they are. Steps are 0, and
    `events` None, where the start or the end of the plan is meant.
    """

    window: TimeWindow
    earlier: str
    later: str
    begin: int
    end: int
    steps: tuple[StepId, StepId]
    events: tuple[Atom | None, Atom | None]

    @property
    def lasts(self) -> int:
        """The time from one event to the other."""
        return self.end - self.begin

    @property
    def slack(self) -> int | None:
        """How much later the later event may come; None if it may come at any time."""
        return None if self.window.most is None else self.window.most - self.lasts

    def breach(self) -> "WindowBreach | None":
        """What is broken; None if the window is kept."""
        amount = broken_by(self.window, self.lasts)
        if not amount:
            return None
        return WindowBreach(
            self.window, self.earlier, self.later, self.lasts, amount, self.steps, self.events
        )

    def entry(self) -> dict[str, Any]:
        """The same for JSON."""
        return {
            "window": str(self.window),
            "from": self.earlier,
            "to": self.later,
            "begin": self.begin,
            "end": self.end,
            "slack": self.slack,
        }

    def text(self, unit: str) -> str:
        """The same in words."""
        spare = f" ({self.slack} {unit} slack)" if self.slack is not None else ""
        span = f"{self.lasts} {unit} from {self.earlier} to {self.later}"
        return f"{span}, {self.window.limits}{spare}"


@dataclass(frozen=True, slots=True)
class WindowBreach:
    """A window that a plan breaks: what `lasts` from one event to the other, and by how much that
    is too long or too short. Steps are 0 where the start or the end of the plan is meant.
    """

    window: TimeWindow
    earlier: str
    later: str
    lasts: int
    amount: int
    steps: tuple[StepId, StepId]
    events: tuple[Atom | None, Atom | None] = (None, None)

    @property
    def cost(self) -> int:
        """What the breach costs; 0 of a window that must not be broken."""
        return (self.window.price or 0) * self.amount

    def text(self, unit: str) -> str:
        """The breach in words."""
        size = "long" if self.is_late else "short"
        priced = f", at a price of {self.cost}" if self.window.price is not None else ""
        return (
            f"{self.lasts} {unit} from {self.earlier} to {self.later}, "
            f"{self.window.limits}: {self.amount} {unit} too {size}{priced}"
        )

    @property
    def is_late(self) -> bool:
        """Whether the later event comes too late, and not too early."""
        return self.window.most is not None and self.lasts > self.window.most

    def entry(self) -> dict[str, Any]:
        """The same for JSON."""
        priced = {} if self.window.price is None else {"cost": self.cost}
        return {
            "window": str(self.window),
            "from": self.earlier,
            "to": self.later,
            "lasts": self.lasts,
            "by": self.amount,
            "steps": [int(step) for step in self.steps],
            **priced,
        }


@dataclass(frozen=True, slots=True)
class PlanEvents:
    """The occurrences of a plan and the times of its steps, in the order of the plan."""

    plan: Plan
    starts: Mapping[StepId, int]
    occurrences: Sequence[Occurrence]

    def time(self, occurrence: Occurrence, side: Side) -> int:
        """When the end of its step is that is meant."""
        if occurrence.step < 0:
            return 0
        step = self.plan.steps[occurrence.step]
        return self.starts[step.id] + (step.duration if side is Side.END else 0)

    @property
    def end(self) -> int:
        """When the last step ends."""
        return max((self.starts[s.id] + s.duration for s in self.plan.steps), default=0)

    def breaches(self, windows: Iterable[TimeWindow]) -> Iterator[WindowBreach]:
        """Every window that the plan breaks, once for each pair of events."""
        breaches = (span.breach() for span in self.spans(windows))
        return (breach for breach in breaches if breach is not None)

    def spans(self, windows: Iterable[TimeWindow]) -> Iterator[WindowSpan]:
        """Every pair of events that a window joins, with its times."""
        joining = Joining(self.occurrences)
        for window in windows:
            yield from (self._span(pair) for pair in joining.pairs(window, self._rank))

    def _rank(self, occurrence: Occurrence, side: Side) -> tuple[int, int]:
        return self.time(occurrence, side), occurrence.step

    def _span(self, pair: WindowPair) -> WindowSpan:
        window = pair.window
        begin, end = (
            (self.end if pattern.side is Side.END else 0)
            if occurrence is None
            else self.time(occurrence, pattern.side)
            for occurrence, pattern in ((pair.earlier, window.earlier), (pair.later, window.later))
        )
        return WindowSpan(
            window,
            _said(pair.earlier, window.earlier),
            _said(pair.later, window.later),
            begin,
            end,
            (self._number(pair.earlier), self._number(pair.later)),
            (
                None if pair.earlier is None else pair.earlier.atom,
                None if pair.later is None else pair.later.atom,
            ),
        )

    def _number(self, occurrence: Occurrence | None) -> StepId:
        if occurrence is None or occurrence.step < 0:
            return INITIAL_STEP
        return self.plan.steps[occurrence.step].id


def broken_by(window: TimeWindow, lasts: int) -> int:
    """By how much a time between two events is too long or too short. Without a least time, the
    later event must not come before the earlier one.
    """
    least = 0 if window.least is None else window.least
    most = lasts if window.most is None else window.most
    return max(0, least - lasts, lasts - most)


def _said(occurrence: Occurrence | None, pattern: EventPattern) -> str:
    if occurrence is None or occurrence.step == FROM_THE_START:
        about = "plan" if occurrence is None else str(occurrence.atom)
        return f"the {pattern.side} of the plan" if occurrence is None else f"{about} at the start"
    denied = "not " if pattern.kind is EventKind.ENDING else ""
    return f"the {pattern.side} of {denied}{occurrence.atom}"


@dataclass(frozen=True, slots=True)
class OffHours:
    """A step outside the times in which its calendar allows it."""

    calendar: TimeOfWork
    step: StepId
    operator: Atom
    start: int

    def text(self, unit: str) -> str:
        """The same in words."""
        return f"{self.operator} starts at {self.start} {unit}, outside the calendar of " + str(
            self.calendar.of
        )

    def entry(self) -> dict[str, Any]:
        """The same for JSON."""
        return {"calendar": str(self.calendar.of), "step": int(self.step), "start": self.start}


def off_hours(
    plan: Plan, starts: Mapping[StepId, int], calendars: Sequence[TimeOfWork]
) -> Iterator[OffHours]:
    """Every step that starts when its calendar does not allow it."""
    for step in plan.steps if calendars else ():
        for calendar in calendars:
            if calendar.covers(step.operator, step.resources):
                start = starts[step.id]
                if calendar.soonest(start, step.duration) != start:
                    yield OffHours(calendar, step.id, step.operator, start)


def breach_lines(breaches: Sequence[WindowBreach], unit: str) -> Iterator[str]:
    """What is broken, in words; nothing if nothing is."""
    for head, some in (
        ("Windows that are not kept", [b for b in breaches if b.window.is_hard]),
        ("Windows with a price that are not kept", [b for b in breaches if not b.window.is_hard]),
    ):
        if some:
            more = len(some) - MAX_LISTED_BREACHES
            listed = "; ".join(each.text(unit) for each in some[:MAX_LISTED_BREACHES])
            yield f"{head}: {listed}" + (
                f"; and {more} more (--format json has all)." if more > 0 else "."
            )
