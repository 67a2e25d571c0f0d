"""A lower bound of the cost of a case that adds up pairs of causes.

Each pair is a problem by itself, whose prices are shares of the costs. Under a cause, the cost of
an action is shared out among the pairs that this cause is in, and what the cause costs by itself.
A policy of the whole problem is a policy of every pair. There it pays no more than its shares, so
that the least costs of the pairs add up to no more than the cost of the policy: Lagrangian
decomposition (Guignard & Kim 1987).

A pair may repeat what the problem allows once. Prices may therefore add up to more than the cost,
if the difference is paid back once for every action that is still open (Lagrangian relaxation of
weakly coupled problems: Adelman & Mersereau 2008). Any such prices give a bound. Better ones are
approached by steps along subgradients: where a pair uses an action more than others do, its price
rises.
"""

from dataclasses import dataclass, replace

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs, Truths
from cellwright.engine.kernels.cancellation import Poll
from cellwright.engine.stages.diagnosis.kernels.belief import Beliefs
from cellwright.engine.stages.diagnosis.kernels.pairing import PairBounds, PairProblems

# points for each doubling of a ratio, and doublings on either side of equal weights
OCTAVE, OCTAVES = 3, 12
POINTS = 2 * OCTAVE * OCTAVES + 1
RATIOS: Floats = 2.0 ** ((np.arange(POINTS) - OCTAVE * OCTAVES) / OCTAVE)
STEP = 0.1  # the first step along a subgradient, as a part of a cost
LEAST_SLOPES = 1e-3  # of sums of squares that steps are divided by
RECENT = 0.05  # the part of the last prices in their mean
ROUGH_SWEEPS, ROUGH = 12, 1e-3  # of a value iteration whose result only leads the prices
SWEEPS, SETTLED = 3000, 1e-6  # of one whose result is a bound
STEP_NS = 1.0  # about nanoseconds for one point of one outcome in a sweep


@dataclass(frozen=True, slots=True)
class PriceShares:
    """Prices of the actions (P, A, 2) and losses of the conclusions (P, G, 2) of each pair, under
    its first and its second cause; and the losses (G, C) that each cause is charged by itself.

    `slopes` (P, A, 2) are sums of squares of subgradients of the prices so far.
    """

    prices: Floats
    losses: Floats
    sole: Floats
    slopes: Floats


def no_pairs(problem: Beliefs) -> PairBounds:
    """No bound by pairs: for a problem of one cause, or one whose value is not concave."""
    excess, sole = np.zeros((problem.actions, problem.causes)), np.zeros(problem.causes)
    cures = np.full((problem.causes, 1), -1, np.int64)
    return PairBounds(RATIOS, np.zeros((0, POINTS)), excess, sole, cures)


class PairPricing:
    """The pairs of a problem, and shares of its costs.

    `first` are shares that suit no belief in particular.
    """

    def __init__(self, problem: Beliefs) -> None:
        self.problem = problem
        causes = problem.causes
        self.two, self.one = np.tril_indices(causes, -1)
        self.cures = (problem.likelihoods * problem.ends[:, :, None]).sum(axis=1)
        self.cost = problem.costs.min(axis=0)
        self.pairs = self._problems()
        others = [[j for j in range(causes) if j != i] for i in range(causes)]
        self.slots = np.array(others, np.int64).reshape(causes, causes - 1)
        own = np.broadcast_to(np.arange(causes)[:, None], self.slots.shape)
        low, high = np.minimum(own, self.slots), np.maximum(own, self.slots)
        self.row, self.side = high * (high - 1) // 2 + low, (own > self.slots).astype(np.int64)
        self.priced = self._priced()
        self.first = self._first_shares()
        self.order = self._cure_order()

    def bounds(self, shares: PriceShares) -> PairBounds:
        """The bound that some shares give."""
        self.pairs.values[:] = 0.0
        self.pairs.solve(shares.prices, shares.losses, SWEEPS, SETTLED)
        values = self.pairs.values[:, POINTS : 2 * POINTS].copy()
        sole = shares.sole.min(axis=0)
        return PairBounds(RATIOS, values, self._excess(shares.prices), sole, self.order)

    def rounds_within(self, nanoseconds: float) -> int:
        """How many steps take about so long."""
        work = self.pairs.count * self.problem.actions * self.problem.outcomes * POINTS
        return 1 + int(nanoseconds / (STEP_NS * ROUGH_SWEEPS * work))

    def ascend(
        self, shares: PriceShares, weights: Floats, done: Truths, rounds: int, poll: Poll
    ) -> PriceShares:
        """Better shares at a belief; `done` (A,) are actions that are not open.

        Steps along subgradients, each price with a size of its own (Duchi, Hazan & Singer 2011):
        some tests would be repeated hundreds of times at a price near 0. The mean of the last
        prices is better than any of them, because the bound is concave in the prices.
        """
        prices, slopes, mean = shares.prices, shares.slopes, shares.prices
        ones, twos = weights[self.one], weights[self.two]
        self.pairs.values[:] = 0.0
        for step in range(rounds):
            if poll.check():
                break
            self.pairs.solve(prices, shares.losses, ROUGH_SWEEPS, ROUGH)
            slope = self._subgradient(prices, self.pairs.usage(ones, twos), done)
            slopes = slopes + slope * slope
            size = STEP * self.cost[None, :, None] / np.sqrt(slopes + LEAST_SLOPES)
            prices = np.where(self.priced, np.maximum(0.0, prices + size * slope), 0.0)
            part = max(RECENT, 1.0 / (step + 1))
            mean = (1.0 - part) * mean + part * prices
        return replace(shares, prices=mean, slopes=slopes)

    def _problems(self) -> PairProblems:
        """The pairs as arrays for the kernel."""
        rows, problem = self.problem.likelihoods, self.problem
        one, two = (np.moveaxis(rows[:, :, each], 2, 0) for each in (self.one, self.two))
        with np.errstate(divide="ignore", invalid="ignore"):
            place = OCTAVE * np.log2(one / two)
        both = (one > 0.0) & (two > 0.0) & ~problem.ends[None] & (place > -POINTS)
        place = np.clip(np.where(both, place, 0.0), 1 - POINTS, POINTS - 1)
        moves = np.clip(np.floor(place), 1 - POINTS, POINTS - 2).astype(np.int64)
        factor = 2.0 ** (1.0 / OCTAVE)
        parts = np.clip((2.0 ** ((place - moves) / OCTAVE) - 1.0) / (factor - 1.0), 0.0, 1.0)
        telling = (one != two).any(axis=2)
        curing = (self.cures[:, self.one] + self.cures[:, self.two]).T > 0.0
        useful = np.full(telling.shape, -1, np.int64)
        for row, mask in zip(useful, telling | curing, strict=True):
            actions = np.flatnonzero(mask)
            row[: len(actions)] = actions
        kept = np.where(both, two, 0.0)
        return PairProblems(
            RATIOS, np.ascontiguousarray(moves), np.ascontiguousarray(parts), kept.copy(), useful
        )

    def _priced(self) -> Truths:
        """Which prices (P, A, 2) there are: of tests that tell the pair apart, and of repairs that
        cure the other cause. A cause is charged by itself for what may cure it.
        """
        rows = self.problem.likelihoods
        sides = np.stack([self.one, self.two], axis=1)
        telling = (rows[:, :, self.one] != rows[:, :, self.two]).any(axis=1).T
        cured = np.moveaxis(self.cures[:, sides] > 0.0, 0, 1)
        other: Truths = telling[:, :, None] & ~cured
        return other

    def _first_shares(self) -> PriceShares:
        """Prices by how well an action tells a pair apart; each conclusion's loss in equal
        parts, after what a cause costs by itself.
        """
        problem, count = self.problem, len(self.one)
        roots = np.sqrt(problem.likelihoods)
        alike = np.einsum("aoi,aoj->aij", roots, roots)
        apart = np.sqrt(np.maximum(0.0, -np.log(np.maximum(alike, 1e-12))))
        worth = np.moveaxis(apart[:, self.slots, np.arange(problem.causes)[:, None]], 0, 2)
        worth = worth * self.priced[self.row, :, self.side]
        total = worth.sum(axis=1, keepdims=True)
        part = np.divide(worth, total, out=np.zeros_like(worth), where=total > 0.0)
        prices = np.zeros((count, problem.actions, 2))
        prices[self.row, :, self.side] = part * self.cost
        sole = self._sole_losses()
        rest = (problem.losses - np.where(np.isinf(sole), 0.0, sole)) / max(1, problem.causes - 1)
        losses = np.stack([rest[:, self.one], rest[:, self.two]], axis=2).transpose(1, 0, 2)
        return PriceShares(prices, np.ascontiguousarray(losses), sole, np.zeros_like(prices))

    def _sole_losses(self) -> Floats:
        """What of each loss (G, C) a cause is charged by itself.

        A cause that some repair surely cures is not charged more than that repair costs.
        """
        losses, known = self.problem.losses, self.problem.known
        sure = (self.cures == 1.0).any(axis=0)
        least = np.minimum(losses, known[None])
        half = np.maximum(least, np.where(np.isinf(losses), least, 0.5 * (losses + least)))
        return np.where(sure[None], least, half)

    def _cure_order(self) -> Longs:
        """The repairs that may cure each cause (C, M), the dearest per chance first; then -1."""
        causes = self.problem.causes
        order = np.full((causes, max(1, int((self.cures > 0.0).sum(axis=0).max(initial=0)))), -1)
        for cause in range(causes):
            own = np.flatnonzero(self.cures[:, cause] > 0.0)
            worst = np.argsort(-self.cost[own] / self.cures[own, cause], kind="stable")
            order[cause, : len(own)] = own[worst]
        return order.astype(np.int64)

    def _excess(self, prices: Floats) -> Floats:
        """By how much prices are together above the cost (A, C), for each action and cause."""
        above: Floats = prices[self.row, :, self.side].sum(axis=1) - self.cost
        return np.ascontiguousarray(np.maximum(0.0, above).T)

    def _subgradient(self, prices: Floats, uses: Floats, done: Truths) -> Floats:
        """Of the bound, for each price in parts of the weight: up by the uses, and down by the one
        use that is paid back where prices are together as high as the cost.
        """
        above = prices[self.row, :, self.side].sum(axis=1) > self.cost * (1.0 - 1e-9)
        paid = np.where(above & ~done, 1.0, 0.0)[:, None, :]
        slope = np.zeros_like(prices)
        slope[self.row, :, self.side] = uses[self.row, :, self.side] - paid
        return slope
