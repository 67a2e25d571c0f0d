"""With which chance windows are kept: steps start as rules say, and last as long as they happen to.

Durations are drawn many times from their ranges: evenly, or normally with a spread and cut to the
range. Numbers of draws and the seed are fixed, so the same plan has the same chances.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import erf, sqrt

import numpy as np
from numpy.typing import NDArray

from cellwright.engine.model.start_rules import StartRules

DRAWS = 20_000  # runs that are drawn; a share is then known within 0.7 points
Times = NDArray[np.float64]  # (DRAWS,)
TOLERANCE = 1e-9


@dataclass(frozen=True, slots=True)
class DrawnDuration:
    """From `least` to `most`, around `usual` with a standard deviation, or evenly without one."""

    least: int
    most: int
    usual: int = 0
    spread: int = 0

    def draw(self, chance: np.random.Generator, count: int) -> Times:
        """So many durations."""
        shares = chance.random(count)
        if not self.spread:
            return self.least + (self.most - self.least) * shares
        grid = np.linspace(self.least, self.most, 2001)
        below = np.array([self.chance_below(value) for value in grid])
        return np.interp(shares, below, grid)

    def chance_below(self, value: float) -> float:
        """With which chance a duration is at most so long."""
        if value >= self.most:
            return 1.0
        if value < self.least:
            return 0.0
        if not self.spread:
            return (value - self.least) / (self.most - self.least)
        low, high, here = (self._normal(x) for x in (self.least, self.most, value))
        return (here - low) / (high - low) if high > low else 1.0

    def _normal(self, value: float) -> float:
        return 0.5 * (1 + erf((value - self.usual) / (self.spread * sqrt(2))))


@dataclass(frozen=True, slots=True)
class TimedRuns:
    """When steps start and end in each of many runs."""

    starts: Mapping[int, Times]
    ends: Mapping[int, Times]

    def kept(self, earlier: Times, later: Times, least: int | None, most: int | None) -> Times:
        """In which runs (1 or 0) so much time lies between two times."""
        lasts = later - earlier
        kept = np.ones_like(lasts)
        if least is not None:
            kept *= lasts >= least - TOLERANCE
        if most is not None:
            kept *= lasts <= most + TOLERANCE
        return kept


def draw_runs(
    rules: StartRules, durations: Mapping[int, DrawnDuration], draws: int = DRAWS, seed: int = 0
) -> TimedRuns:
    """Many runs in which each step starts as soon as its rule allows."""
    chance = np.random.default_rng(seed)
    drawn = {step: durations[step].draw(chance, draws) for step in sorted(durations)}
    starts, ends = dict[int, Times](), dict[int, Times]()
    for step, rule in rules.items():
        soonest = [np.full(draws, float(rule.floor))]
        soonest += (starts[other] + lag for other, lag in rule.starts.items())
        soonest += (ends[other] + lag for other, lag in rule.ends.items())
        soonest += (
            np.minimum(ends[other], starts[other] + time) for other, time in rule.waits.items()
        )
        starts[step] = _latest(soonest)
        ends[step] = starts[step] + drawn[step]
    return TimedRuns(starts, ends)


def _latest(times: Iterable[Times]) -> Times:
    latest, *more = times
    for other in more:
        latest = np.maximum(latest, other)
    return latest
