"""How far ahead the starts of steps can be forecast, and how surely (Fox and Kempf: as far as the accuracy warrants).

How long the last steps took beside their forecasts, in this run, says how sure the next ones are. Before anything has ended, a
tenth is assumed. What is forecast is drawn many times, in the order of the forecast, with durations drawn from those shares.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cellwright.engine.stages.execution.program import Program
from cellwright.engine.stages.execution.standing import Standing

TOLERANCE_MS = 60_000  # a start that is known less exactly than this, either way, is not told
ASSUMED, WEIGHT = 0.1, 2  # the spread before anything is known, and how many steps this counts for
KEPT = 200  # steps that say how sure the next ones are
DRAWS, AHEAD = 400, 500  # how often what is left is drawn, and how many of its steps
SURE = 95.0  # percent of the starts that are in their intervals
TAILS = ((100 - SURE) / 2, 50.0, (100 + SURE) / 2)  # percent: the ends of the interval, and the middle

Draws = NDArray[np.float64]  # (DRAWS,): a time in milliseconds in each draw
Shares = NDArray[np.float64]  # (DRAWS, n): by which shares of their forecasts steps take longer


@dataclass(frozen=True, slots=True)
class Accuracy:
    """By which shares of their forecasts the last steps took longer, the oldest first."""

    shares: tuple[float, ...] = ()

    def after(self, lasted_ms: int, forecast_ms: int) -> "Accuracy":
        """The accuracy when another step has ended. A step without a forecast says nothing."""
        if forecast_ms <= 0:
            return self
        return Accuracy((*self.shares[1 - KEPT :], round(lasted_ms / forecast_ms - 1, 4)))


@dataclass(frozen=True, slots=True)
class Window:
    """When a step will probably begin: `start_ms` is the middle of all draws, and 95 % of them are from `low_ms` to `high_ms`.

    95 % of the draws are also at most `off_ms` away from the middle.
    """

    start_ms: int
    low_ms: int
    high_ms: int
    off_ms: int


def outlook(
    program: Program, standing: Standing, accuracy: Accuracy, tolerance_ms: int = TOLERANCE_MS
) -> Mapping[int, Window | None]:
    """The next activities in the order of the forecast, each with its window; without one behind the horizon.

    The horizon is where the first start comes that may be off by more than the tolerance.
    """
    order = in_order(program, standing)[:AHEAD]
    found = {each: _window(drawn) for each, drawn in _starts(program, standing, accuracy, order).items()}
    horizon = min((each.start_ms for each in found.values() if each.off_ms > tolerance_ms), default=None)
    return {
        each: window if horizon is None or window.start_ms < horizon else None
        for each, window in found.items()
    }


def in_order(program: Program, standing: Standing) -> list[int]:
    """The activities that have not begun, in the order of the forecast."""
    order = {each: place for place, each in enumerate(program.activities)}
    waiting, found = list(standing.ready), set(standing.ready)
    waiting += [each.activity for each in standing.running.values()]
    while waiting:
        fresh = [each for each in program.successors[waiting.pop()] if each not in found]
        found.update(fresh)
        waiting += fresh
    found -= {each.activity for each in standing.running.values()}
    return sorted(found, key=lambda each: (program.activities[each].start_ms, order[each]))


def _starts(
    program: Program, standing: Standing, accuracy: Accuracy, order: list[int]
) -> Mapping[int, Draws]:
    """The starts of activities in each draw: when those before them and those on their resources have ended."""
    now, lasts = float(standing.now_ms), _Lasting(accuracy)
    ends, free, starts = dict[int, Draws](), dict[str, Draws](), dict[int, Draws]()
    for running in standing.running.values():
        activity = program.activities[running.activity]
        ends[activity.id] = now + lasts.still(activity.lasts_ms, standing.now_ms - running.since_ms)
        free |= dict.fromkeys(activity.resources, ends[activity.id])
    for each in order:
        activity = program.activities[each]
        soonest = max(now, activity.start_ms) if program.timed else now
        start: Draws = np.full(DRAWS, soonest)
        for end in (*(ends.get(b) for b in activity.after), *(free.get(r) for r in activity.resources)):
            start = start if end is None else np.maximum(start, end)
        starts[each], ends[each] = start, start + lasts.whole(activity.lasts_ms)
        free |= dict.fromkeys(activity.resources, ends[each])
    return starts


class _Lasting:
    """How long activities last in each draw: the bootstrap (Efron 1979).

    Each draw has its own sample of the shares that are known, so what they do not tell yet is uncertain, too; the shares of
    its activities are taken from that sample.
    """

    def __init__(self, accuracy: Accuracy) -> None:
        self.chance = np.random.default_rng(0)
        known = np.broadcast_to(accuracy.shares, (DRAWS, len(accuracy.shares)))
        assumed = ASSUMED * self.chance.standard_normal((DRAWS, WEIGHT))
        self.shares: Shares = self._sample(np.hstack((known, assumed)), len(accuracy.shares) + WEIGHT)

    def _sample(self, shares: Shares, count: int) -> Shares:
        """So many of the shares of each draw, (DRAWS, count), taken with replacement."""
        places = self.chance.integers(shares.shape[1], size=(DRAWS, count))
        found: Shares = np.take_along_axis(shares, places, axis=1)
        return found

    def whole(self, lasts_ms: int) -> Draws:
        """How long an activity lasts."""
        found: Draws = lasts_ms * np.maximum(0.0, 1.0 + self._sample(self.shares, 1)[:, 0])
        return found

    def still(self, lasts_ms: int, passed_ms: int) -> Draws:
        """How much longer an activity lasts that began `passed_ms` ago, drawn from the shares with which it is not over yet."""
        left: Shares = lasts_ms * (1.0 + self.shares) - passed_ms
        keys = np.where(left > 0, self.chance.random(left.shape), -1.0)
        chosen = np.take_along_axis(left, keys.argmax(axis=1)[:, None], axis=1)[:, 0]
        found: Draws = np.maximum(0.0, chosen)
        return found


def _window(starts: Draws) -> Window:
    low, middle, high = (round(float(each)) for each in np.percentile(starts, TAILS))
    return Window(middle, low, high, round(float(np.percentile(np.abs(starts - middle), SURE))))
