"""Windows of time between two events of a plan, and calendars: what a person writes about times.

An event is the start or the end of a step. A pattern names the step itself, or what it does: the
stage that it reaches, the fact that it makes true, the fact that it ends. The meaning of a window
for a plan with times is in `cellwright.engine.model.window_breaches`.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from cellwright.kb.diagnostics import NOWHERE, Source
from cellwright.kb.terms import Atom, Function, Term, Variable, match_term

PLAN = Function("plan")  # what a window calls the plan itself
Bindings = Mapping[Variable, Term]


class EventKind(StrEnum):
    """What happens: a step, an event of a workflow, a fact that becomes true or false, the plan."""

    STEP = "step"
    EVENT = "event"
    FACT = "fact"
    ENDING = "not"
    PLAN = "plan"


class Side(StrEnum):
    """Which end of the step is meant."""

    START = "start"
    END = "end"


@dataclass(frozen=True, slots=True)
class EventPattern:
    """An end of every step that is, reaches, makes true or ends what matches `atom`.

    `_` in the atom stands for anything.
    """

    kind: EventKind
    atom: Atom
    side: Side

    def __str__(self) -> str:
        word = {EventKind.ENDING: "not ", EventKind.STEP: "step "}.get(self.kind, "")
        return f"{self.side} of {word}{self.atom}"


@dataclass(frozen=True, slots=True)
class TimeWindow:
    """`later` comes at least `least` and at most `most` after `earlier`, in the unit of the domain.

    Variables have the same value in both patterns; `among` lists the values of some of them. Each
    unit of time by which it is broken costs `price`; without a price it is never broken.
    """

    earlier: EventPattern
    later: EventPattern
    least: int | None = None
    most: int | None = None
    price: int | None = None
    among: tuple[tuple[Variable, tuple[Term, ...]], ...] = ()
    where: Source = field(default=NOWHERE, compare=False)

    @property
    def is_hard(self) -> bool:
        """Whether no plan may break it."""
        return self.price is None

    @property
    def limits(self) -> str:
        """The least and the greatest time, in numbers of the domain's unit."""
        if self.least is not None and self.least == self.most:
            return f"exactly {self.least}"
        said = [] if self.least is None else [f"at least {self.least}"]
        return ", ".join([*said, *([] if self.most is None else [f"at most {self.most}"])])

    def __str__(self) -> str:
        """The window as a file has it, in numbers of the domain's unit."""
        priced = "" if self.price is None else f", price {self.price}"
        return f"{self.limits} from {self.earlier} to {self.later}{priced}"

    def entry(self) -> str | dict[str, Any]:
        """The window as an entry of a file."""
        if not self.among:
            return str(self)
        listed = {str(variable): list(map(str, values)) for variable, values in self.among}
        return {"keep": str(self), "for": listed}

    def bindings(self, pattern: EventPattern, event: Atom) -> Bindings | None:
        """The values of the variables of a pattern for an event; None if it does not match, or is
        of an object that the window is not about.
        """
        bound = match_term(pattern.atom, event, {})
        if bound is None:
            return None
        listed = ((v, values) for v, values in self.among if v in bound)
        return None if any(bound[v] not in values for v, values in listed) else bound


def same_values(one: Bindings, other: Bindings) -> bool:
    """Whether no variable has different values in two bindings."""
    return all(other.get(variable, value) == value for variable, value in one.items())


@dataclass(frozen=True, slots=True)
class TimeOfWork:
    """When steps may be done: those that hold `of` as a resource, or that match it as a step.

    They lie in one of `spans`, half-open, of the domain's unit of time; with `period` the spans
    come again and again. With `only_starts` they need only start there.
    """

    of: Function
    is_step: bool
    spans: tuple[tuple[int, int], ...]
    period: int | None = None
    only_starts: bool = False
    where: Source = field(default=NOWHERE, compare=False)

    def entry(self) -> dict[str, Any]:
        """The calendar as an entry of a file, in numbers of the domain's unit."""
        spans = ", ".join(f"{first} to {last}" for first, last in self.spans)
        again = {} if self.period is None else {"every": str(self.period)}
        starts = {"starts": True} if self.only_starts else {}
        return {"of": str(self.of), "open": spans, **again, **starts}

    def covers(self, step: Function, resources: Sequence[Term]) -> bool:
        """Whether the calendar is about a step that holds some resources."""
        if self.is_step:
            return match_term(self.of, step, {}) is not None
        return any(match_term(self.of, held, {}) is not None for held in resources)

    def allowed_starts(self, duration: int, horizon: int) -> list[tuple[int, int]]:
        """The times at which a step so long may start, up to a horizon: first and last of each
        span.
        """
        allowed = list[tuple[int, int]]()
        needed = 1 if self.only_starts else max(1, duration)
        for first, last in self.open_spans(horizon):
            if max(0, first) <= last - needed:
                allowed.append((max(0, first), min(horizon, last - needed)))
        return [(first, last) for first, last in allowed if first <= last]

    def open_spans(self, horizon: int) -> Iterator[tuple[int, int]]:
        """The spans that are open and begin by a horizon, in their order; those of periods that
        touch are one.
        """
        if self.period is None:
            yield from sorted(self.spans)
            return
        joined = _join_spans(self.spans, self.period)
        for turn in range(-1, horizon // self.period + 1 if len(joined) else 0):
            shift = turn * self.period
            yield from ((first + shift, last + shift) for first, last in joined)

    def horizon(self, work: int) -> int:
        """A time by which so much work can be done in the open times, if all of it can be."""
        if self.period is None:
            return work + max((last for _, last in self.spans), default=0)
        longest = max((last - first for first, last in self.spans), default=1)
        return work + self.period * (2 + 2 * work // max(1, longest))

    def soonest(self, time: int, duration: int) -> int | None:
        """The first time from `time` on at which a step so long may start; None if none is."""
        needed = 1 if self.only_starts else max(1, duration)
        if self.period is None:
            return _soonest_in(self.spans, time, needed)
        turn = time // self.period
        joined = _join_spans(self.spans, self.period)
        for number in (turn - 1, turn, turn + 1, turn + 2):
            shift = number * self.period
            begin = _soonest_in([(a + shift, b + shift) for a, b in joined], time, needed)
            if begin is not None:
                return begin
        return None


def _soonest_in(spans: Sequence[tuple[int, int]], time: int, needed: int) -> int | None:
    begins = (max(time, first) for first, last in spans if max(time, first) + needed <= last)
    return min(begins, default=None)


def _join_spans(spans: Sequence[tuple[int, int]], period: int) -> list[tuple[int, int]]:
    """Spans of one period; one that reaches its end goes on in the next, if that begins open."""
    ordered = sorted(spans)
    if not ordered or ordered[-1][1] < period or ordered[0][0] > 0:
        return list(ordered)
    if ordered[0] == (0, period):
        return [(-(1 << 40), 1 << 40)]
    return [*ordered[:-1], (ordered[-1][0], ordered[-1][1] + ordered[0][1])]
