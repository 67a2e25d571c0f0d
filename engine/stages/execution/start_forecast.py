"""Forecast of step starts: how far ahead it reaches, and how sure it is (bootstrap).

How long the last steps took beside their forecasts, in this run, says how sure the next ones are.
Before anything has ended, a tenth is assumed. What is forecast is drawn many times, in the order of
the forecast, with durations drawn from those shares.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cellwright.engine.stages.execution.activity_program import ActivityProgram
from cellwright.engine.stages.execution.run_state import ExecutiveState

TOLERANCE_MS = 60_000  # a start that is known less exactly than this, either way, is not told
ASSUMED, WEIGHT = 0.1, 2  # the spread before anything is known, and how many steps this counts for
MAX_ACCURACY_STEPS = 200  # steps that say how sure the next ones are
DRAWS, AHEAD = 400, 500  # how often what is left is drawn, and how many of its steps
INTERVAL_PERCENT = 95.0  # percent of the starts that are in their intervals
INTERVAL_PERCENTILES = (
    (100 - INTERVAL_PERCENT) / 2,
    50.0,
    (100 + INTERVAL_PERCENT) / 2,
)  # percent: the ends of the interval, and the middle

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
        return Accuracy(
            (*self.shares[1 - MAX_ACCURACY_STEPS :], round(lasted_ms / forecast_ms - 1, 4))
        )


@dataclass(frozen=True, slots=True)
class StartWindow:
    """When a step will probably begin: `start_ms` is the middle of all draws, and 95 % of them are
    from `low_ms` to `high_ms`.

    95 % of the draws are also at most `off_ms` away from the middle.
    """

    start_ms: int
    low_ms: int
    high_ms: int
    off_ms: int


def forecast_starts(
    program: ActivityProgram,
    standing: ExecutiveState,
    accuracy: Accuracy,
    tolerance_ms: int = TOLERANCE_MS,
) -> Mapping[int, StartWindow | None]:
    """The next activities in the order of the forecast, each with its window; without one behind
    the horizon.

    The horizon is where the first start comes that may be off by more than the tolerance.
    """
    order = forecast_order(program, standing)[:AHEAD]
    windows = {
        activity_number: _start_window(drawn)
        for activity_number, drawn in _draw_starts(program, standing, accuracy, order).items()
    }
    horizon = min(
        (
            start_window.start_ms
            for start_window in windows.values()
            if start_window.off_ms > tolerance_ms
        ),
        default=None,
    )
    return {
        activity_number: window if horizon is None or window.start_ms < horizon else None
        for activity_number, window in windows.items()
    }


def forecast_order(program: ActivityProgram, standing: ExecutiveState) -> list[int]:
    """The activities that have not begun, in the order of the forecast."""
    order = {activity_number: place for place, activity_number in enumerate(program.activities)}
    waiting, later = list(standing.ready), set(standing.ready)
    waiting += [running.activity for running in standing.running.values()]
    while waiting:
        fresh = [
            successor for successor in program.successors[waiting.pop()] if successor not in later
        ]
        later.update(fresh)
        waiting += fresh
    later -= {running.activity for running in standing.running.values()}
    return sorted(
        later,
        key=lambda activity_number: (
            program.activities[activity_number].start_ms,
            order[activity_number],
        ),
    )


def _draw_starts(
    program: ActivityProgram, standing: ExecutiveState, accuracy: Accuracy, order: list[int]
) -> Mapping[int, Draws]:
    """The starts of activities in each draw: when those before them and those on their
    resources have ended.
    """
    now, lasts = float(standing.now_ms), _Lasting(accuracy)
    ends, free, starts = dict[int, Draws](), dict[str, Draws](), dict[int, Draws]()
    for running in standing.running.values():
        activity = program.activities[running.activity]
        ends[activity.id] = now + lasts.still(activity.lasts_ms, standing.now_ms - running.since_ms)
        free |= dict.fromkeys(activity.resources, ends[activity.id])
    for activity_number in order:
        activity = program.activities[activity_number]
        soonest = max(now, activity.start_ms) if program.timed else now
        start: Draws = np.full(DRAWS, soonest)
        for end in (
            *(ends.get(b) for b in activity.after),
            *(free.get(r) for r in activity.resources),
        ):
            start = start if end is None else np.maximum(start, end)
        starts[activity_number], ends[activity_number] = (
            start,
            start + lasts.whole(activity.lasts_ms),
        )
        free |= dict.fromkeys(activity.resources, ends[activity_number])
    return starts


class _Lasting:
    """How long activities last in each draw: the bootstrap (Efron 1979).

    Each draw has its own sample of the shares that are known, so what they do not tell yet is
    uncertain, too; the shares of its activities are taken from that sample.
    """

    def __init__(self, accuracy: Accuracy) -> None:
        self.chance = np.random.default_rng(0)
        known = np.broadcast_to(accuracy.shares, (DRAWS, len(accuracy.shares)))
        assumed = ASSUMED * self.chance.standard_normal((DRAWS, WEIGHT))
        self.shares: Shares = self._sample(
            np.hstack((known, assumed)), len(accuracy.shares) + WEIGHT
        )

    def _sample(self, shares: Shares, count: int) -> Shares:
        """So many of the shares of each draw, (DRAWS, count), taken with replacement."""
        places = self.chance.integers(shares.shape[1], size=(DRAWS, count))
        sample: Shares = np.take_along_axis(shares, places, axis=1)
        return sample

    def whole(self, lasts_ms: int) -> Draws:
        """How long an activity lasts."""
        durations: Draws = lasts_ms * np.maximum(0.0, 1.0 + self._sample(self.shares, 1)[:, 0])
        return durations

    def still(self, lasts_ms: int, passed_ms: int) -> Draws:
        """How much longer an activity lasts that began `passed_ms` ago, drawn from the shares
        with which it is not over yet.
        """
        left: Shares = lasts_ms * (1.0 + self.shares) - passed_ms
        keys = np.where(left > 0, self.chance.random(left.shape), -1.0)
        chosen = np.take_along_axis(left, keys.argmax(axis=1)[:, None], axis=1)[:, 0]
        durations: Draws = np.maximum(0.0, chosen)
        return durations


def _start_window(starts: Draws) -> StartWindow:
    low, middle, high = (
        round(float(percentile)) for percentile in np.percentile(starts, INTERVAL_PERCENTILES)
    )
    return StartWindow(
        middle, low, high, round(float(np.percentile(np.abs(starts - middle), INTERVAL_PERCENT)))
    )
