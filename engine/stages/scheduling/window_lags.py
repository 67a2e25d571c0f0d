"""Windows of time as least and greatest times between steps whose order is known.

Starts that are raised until every lag is kept are the earliest ones: what a lag asks, and what a
calendar asks, can only be mended by starting later (a longest path, as in a simple temporal
network: Dechter, Meiri & Pearl 1991).
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from cellwright.engine.model.window_breaches import Joining, Occurrence
from cellwright.kb.model.time_windows import EventPattern, Side, TimeWindow

AT_START = -1  # in place of a step: the start of the plan
AT_END = -2  # the end of the plan
SPARE_ROUNDS = 20  # beside one for each lag


@dataclass(frozen=True, slots=True)
class StepMoment:
    """A time after the start of a step, by its place in the order of the plan."""

    step: int
    offset: int = 0


@dataclass(frozen=True, slots=True)
class StepLag:
    """`later` comes at least `least` and at most `most` after `earlier`.

    Each unit of time by which it is broken costs `price`, if there is one.
    """

    earlier: StepMoment
    later: StepMoment
    least: int
    most: int | None = None
    price: int | None = None


def lags_in_order(
    windows: Iterable[TimeWindow], occurrences: Iterable[Occurrence], durations: Sequence[int]
) -> list[StepLag]:
    """The lags that windows ask between the steps of a plan, if events come in its order."""
    joining = Joining(occurrences)

    def moment(occurrence: Occurrence | None, pattern: EventPattern) -> StepMoment:
        if occurrence is None:
            return StepMoment(AT_END if pattern.side is Side.END else AT_START)
        if occurrence.step < 0:
            return StepMoment(AT_START)
        return StepMoment(
            occurrence.step, durations[occurrence.step] if pattern.side is Side.END else 0
        )

    return [
        StepLag(
            moment(pair.earlier, window.earlier),
            moment(pair.later, window.later),
            window.least or 0,
            window.most,
            window.price,
        )
        for window in windows
        for pair in joining.pairs(window, _in_order)
    ]


def _in_order(occurrence: Occurrence, side: Side) -> tuple[int, int]:
    return occurrence.step, 1 if side is Side.END else 0


Pass = Callable[[Sequence[int]], tuple[list[int], int]]


def raised_starts(
    lags: Sequence[StepLag], count: int, forward: Pass
) -> tuple[list[int], int] | None:
    """The earliest starts of steps and the end of the plan; None if there are none.

    `forward` gives the earliest starts that are not below some others, and when all has ended, as
    the order of the plan and calendars allow.
    """
    least = [0] * count
    for _ in range(len(lags) + SPARE_ROUNDS):
        starts, end = forward(least)
        least, changed = list(starts), False
        for lag in lags:
            one, other = (
                {AT_START: 0, AT_END: end}.get(m.step, 0)
                if m.step < 0
                else least[m.step] + m.offset
                for m in (lag.earlier, lag.later)
            )
            if other - one < lag.least:
                if lag.later.step < 0:
                    return None
                least[lag.later.step] += lag.least - (other - one)
                changed = True
            elif lag.most is not None and other - one > lag.most:
                if lag.earlier.step < 0:
                    return None
                least[lag.earlier.step] += other - one - lag.most
                changed = True
        if not changed:
            return starts, end
    return None
