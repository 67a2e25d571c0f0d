"""How far ahead the starts of steps can be forecast, and how surely (Fox and Kempf: as far as the accuracy warrants).

How long steps took beside their forecasts, so far in this run, says how sure the next ones are. Before anything has ended, a
tenth is assumed. What is forecast is drawn many times, in the order of the forecast, with durations that vary so.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from engine.stages.execution.program import Program
from engine.stages.execution.standing import Standing

TOLERANCE_MS = 60_000  # a start that is known less exactly than this, either way, is not told
ASSUMED, WEIGHT = 0.1, 2  # the spread before anything is known, and how many steps this counts for
DRAWS, AHEAD = 400, 500  # how often what is left is drawn, and how many of its steps
TAILS = (2.5, 50.0, 97.5)  # percent: the ends of the interval that has 95 % of the starts, and the middle

Draws = NDArray[np.float64]  # (DRAWS,): a time in milliseconds in each draw


@dataclass(frozen=True, slots=True)
class Accuracy:
    """By which share of their forecasts so many steps took longer: the sum of the shares, and that of their squares."""

    count: int = 0
    total: float = 0.0
    squares: float = 0.0

    def after(self, lasted_ms: int, forecast_ms: int) -> "Accuracy":
        """The accuracy when another step has ended. A step without a forecast says nothing."""
        if forecast_ms <= 0:
            return self
        share = lasted_ms / forecast_ms - 1
        return Accuracy(self.count + 1, self.total + share, self.squares + share * share)


@dataclass(frozen=True, slots=True)
class Window:
    """When a step will probably begin: in the middle of all draws, and 95 % of them from `low_ms` to `high_ms`."""

    start_ms: int
    low_ms: int
    high_ms: int

    @property
    def off_ms(self) -> int:
        """By how much the start may be off, the larger way."""
        return max(self.start_ms - self.low_ms, self.high_ms - self.start_ms)


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
    now = float(standing.now_ms)
    lasts = partial(_lasting, np.random.default_rng(0), *_spread(accuracy))
    ends, free, starts = dict[int, Draws](), dict[str, Draws](), dict[int, Draws]()
    for running in standing.running.values():
        activity = program.activities[running.activity]
        ends[activity.id] = np.maximum(now, running.since_ms + lasts(activity.lasts_ms))
        free |= dict.fromkeys(activity.resources, ends[activity.id])
    for each in order:
        activity = program.activities[each]
        soonest = max(now, activity.start_ms) if program.timed else now
        start: Draws = np.full(DRAWS, soonest)
        for end in (*(ends.get(b) for b in activity.after), *(free.get(r) for r in activity.resources)):
            start = start if end is None else np.maximum(start, end)
        starts[each], ends[each] = start, start + lasts(activity.lasts_ms)
        free |= dict.fromkeys(activity.resources, ends[each])
    return starts


def _spread(accuracy: Accuracy) -> tuple[Draws, Draws]:
    """In each draw the share by which all steps take longer, and how much each of them varies around that.

    Both are known less exactly the fewer steps have ended: the predictive distribution of a normal sample.
    """
    chance = np.random.default_rng(1)
    count = accuracy.count + WEIGHT
    mean = accuracy.total / count
    variance = max(0.0, (accuracy.squares + WEIGHT * ASSUMED**2) / count - mean**2)
    each = np.sqrt(variance * count / chance.chisquare(count, DRAWS))
    return mean + each * chance.standard_normal(DRAWS) / np.sqrt(count), each


def _lasting(chance: np.random.Generator, common: Draws, each: Draws, lasts_ms: int) -> Draws:
    """How long an activity lasts in each draw."""
    share: Draws = np.maximum(0.0, 1.0 + common + each * chance.standard_normal(DRAWS))
    return lasts_ms * share


def _window(starts: Draws) -> Window:
    low, middle, high = (round(float(each)) for each in np.percentile(starts, TAILS))
    return Window(middle, low, high)
