"""Lower bounds of the cost of a case by pairs of causes, as if every test could be repeated
independently.
"""

from dataclasses import dataclass

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs
from cellwright.engine.stages.diagnosis.kernels.belief import Beliefs

# points for each doubling of a ratio, and doublings on either side of equal weights
OCTAVE, OCTAVES = 3, 12
POINTS = 2 * OCTAVE * OCTAVES + 1
# repairs of a pair that may fail and are counted as tried; others can be repeated in the bound
UNSURE = 4
SWEEPS = 60
SETTLED = 1e-7  # relative change of a value at which a sweep is the last

RATIOS: Floats = 2.0 ** ((np.arange(POINTS) - OCTAVE * OCTAVES) / OCTAVE)


@dataclass(frozen=True, slots=True)
class PairBounds:
    """Lower bounds of pairs of causes (P, S, POINTS), and the repairs (P, UNSURE) that each has to
    do with; -1: none.

    The causes one < two have row two (two - 1) / 2 + one. At point k the weight of one is
    `RATIOS[k]`, that of two is 1. Bit n of the number s of S says that repair n of the pair has
    been tried. Between points the bound is linear in the weights. That is no more than the value,
    which is concave.
    """

    values: Floats
    repairs: Longs


def no_pairs() -> PairBounds:
    """No bounds."""
    return PairBounds(np.zeros((0, 1, POINTS)), np.zeros((0, UNSURE), np.int64))


def pair_bounds(problem: Beliefs) -> PairBounds:
    """The bounds of all pairs, by value iteration from below."""
    pairs = [(one, two) for two in range(problem.causes) for one in range(two)]
    repairs = np.full((len(pairs), UNSURE), -1, np.int64)
    for number, pair in enumerate(pairs):
        unsure = _unsure(problem, pair)
        repairs[number, : len(unsure)] = unsure
    count = 1 << int((repairs >= 0).sum(axis=1).max(initial=0))
    values = np.zeros((len(pairs), count, POINTS))
    for number, pair in enumerate(pairs):
        _fill(values[number], problem, pair, [a for a in repairs[number].tolist() if a >= 0])
    return PairBounds(values, repairs)


def _unsure(problem: Beliefs, pair: tuple[int, int]) -> list[int]:
    """The repairs that may fail under a cause of a pair which they may cure; some of them if
    there are many.
    """
    cures = (problem.likelihoods[:, :, list(pair)] * problem.ends[:, :, None]).sum(axis=1)
    some = ((cures > 0.0) & (cures < 1.0)).any(axis=1)
    return [int(action) for action in np.flatnonzero(some)[:UNSURE]]


def _fill(values: Floats, problem: Beliefs, pair: tuple[int, int], unsure: list[int]) -> None:
    """Fill the bounds of one pair (S, POINTS), the sets of tried repairs from the largest to
    the smallest.
    """
    steps = _Steps.of(problem, pair)
    for tried in range((1 << len(unsure)) - 1, -1, -1):
        once = steps.stopping
        for place, action in enumerate(unsure):
            if not tried >> place & 1:
                once = np.minimum(once, steps.following(action, values[tried | 1 << place]))
        again = [a for a in steps.useful if a not in unsure]
        values[tried] = steps.iterated(again, once)
    values[1 << len(unsure) :] = values[0]


@dataclass(frozen=True)
class _Steps:
    """What each action of a problem costs and leads to for two causes, at all points.

    `costs` (A, POINTS), and of each outcome (A, O, POINTS) the first of two neighbouring points,
    and how much of both.
    """

    stopping: Floats
    known: Floats
    useful: list[int]
    costs: Floats
    point: Longs
    low: Floats
    high: Floats

    @classmethod
    def of(cls, problem: Beliefs, pair: tuple[int, int]) -> "_Steps":
        one, two = pair
        known = problem.known[[one, two]]
        stopping = np.full(POINTS, np.inf)
        if len(problem.losses):
            stopping = (problem.losses[:, [one]] * RATIOS + problem.losses[:, [two]]).min(axis=0)
        rows = problem.likelihoods[:, :, [one, two]]
        telling = np.ptp(rows, axis=2).max(axis=1) > 0.0
        ending = (problem.ends[:, :, None] * rows).any(axis=(1, 2))
        shown = np.where(problem.ends[:, :, None], 0.0, rows)
        point, low, high, rest = _parts(
            shown[:, :, :1] * RATIOS, shown[:, :, 1:] * np.ones(POINTS), known
        )
        costs = problem.costs.min(axis=0)[:, None] * (RATIOS + 1.0) + rest.sum(axis=1)
        useful = np.flatnonzero(telling | ending).tolist()
        return cls(stopping, known, useful, costs, point, low, high)

    def following(self, action: "int | list[int]", value: Floats) -> Floats:
        """The cost of an action, or of each of some, and then of the value at the points that
        it leads to.
        """
        point = self.point[action]
        after = self.low[action] * value[point] + self.high[action] * value[point + 1]
        going: Floats = self.costs[action] + after.sum(axis=-2)
        return going

    def iterated(self, again: list[int], once: Floats) -> Floats:
        """A lower bound (POINTS,) if some actions can be repeated, and any other way costs
        `once`.
        """
        value: Floats = np.minimum(once, self.known[0] * RATIOS + self.known[1])
        for _ in range(SWEEPS):
            after = np.minimum(once, self.following(again, value).min(axis=0)) if again else once
            after = np.maximum(after, value)
            if (after - value <= SETTLED * after).all():
                break
            value = after
        return value


def _parts(one: Floats, two: Floats, known: Floats) -> tuple[Longs, Floats, Floats, Floats]:
    """Weights of two causes as sums of the weights at two neighbouring points and a rest of one
    cause alone.

    Returns the first of both points, how much of each point, and the cost of the rest.
    """
    largest = RATIOS[-1]
    over = np.maximum(0.0, one - two * largest)
    under = np.maximum(0.0, two - one * largest)
    one, two = one - over, two - under
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.clip(np.where(two > 0.0, one / two, 1.0), RATIOS[0], largest)
    point = np.clip(np.searchsorted(RATIOS, ratio, side="right") - 1, 0, POINTS - 2)
    share = (ratio - RATIOS[point]) / (RATIOS[point + 1] - RATIOS[point])
    return point, two * (1.0 - share), two * share, over * known[0] + under * known[1]
