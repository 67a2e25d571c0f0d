"""Closed tours under symmetric costs: annealed exchanges, merged tours, and the bound of Held and Karp."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cellwright.engine.kernels.arrays import Floats, Ints
from cellwright.engine.kernels.cancellation import Interrupted, never
from cellwright.engine.stages.sequencing.candidates import nearest, quadrant
from cellwright.engine.stages.sequencing.costs import Costs
from cellwright.engine.stages.sequencing.limits import Limits
from cellwright.engine.stages.sequencing.merging import merged

if TYPE_CHECKING:
    from cellwright.engine.stages.sequencing.kernels.kicks import Kicker

Matrix = NDArray[Any]  # whole numbers of 32 or 64 bits
Order = Ints
FEW = 8  # fewer cities are left to the exact methods
SLICE = 2000  # kicks, or cities that are looked at, between two questions whether to stop
WARM, COLD = 2.0, 0.1  # times the mean edge, at the beginning and the end of each annealing
FIRST, LONGEST = 10, 40  # kicks for each city in the first annealing, and in the longest
HUGE = 20_000  # from this number of cities on, a first annealing that is hardly warm comes before all others
TOURS = 6  # that are merged
COUNT = 7  # candidates of each city
STEPS = 300  # of the ascent over a matrix if no proof is tried; fewer if each takes long
LITTLE, MOST = 20_000, 2_000_000  # kicks, if the caller sets no number


@dataclass(frozen=True, slots=True, eq=False)
class Searched:
    """The best order, its cost, and the number of kicks made."""

    order: Order
    cost: int
    work: int


def candidates(
    costs: Costs, positions: NDArray[np.floating] | None = None, interrupted: Interrupted = never
) -> Ints:
    """The candidate neighbours of each city (n, k); worth nothing if it is interrupted."""
    where = costs.points if positions is None else positions
    if where is None:
        assert costs.matrix is not None
        return nearest(costs.matrix, COUNT + 1)
    return quadrant(where, costs, COUNT, interrupted)


def search(
    costs: Costs, start: Order, limits: Limits, near: Ints | None = None, mates: Ints | None = None
) -> Searched:
    """The best closed tour found from `start` (n,), n >= 8. `near` (n, k) are candidate neighbours.

    `mates` (n,) has the city to which the edge of a city must stay, or -1; `start` has these edges.

    One annealing after another begins at the best tour. Then the last tours are merged. Cities are numbered along `start`,
    so that neighbours lie near each other in memory.
    """
    n, total = len(costs), limits.work or default_work(len(costs))
    near = candidates(costs, None, limits.interrupted) if near is None else near
    if limits.interrupted():
        return Searched(start, costs.of_tour(start), 0)
    cities = np.roll(start, n - 1 - int(np.flatnonzero(start == n - 1)[0]))
    number = np.empty(n, np.int32)
    number[cities] = np.arange(n, dtype=np.int32)
    search = _Search(costs.part(cities), np.ascontiguousarray(number[near[cities]]), limits)
    if mates is not None:
        search.mates = np.where(mates < 0, -1, number[mates])[cities].astype(np.int32)
    search.settle()
    while search.done < total and not limits.interrupted():
        search.anneal(total)
    return Searched(cities[search.best], search.cost, search.done)


class _Search:
    """The best tour so far and the tours that were found last."""

    def __init__(self, costs: Costs, near: Ints, limits: Limits) -> None:
        self.costs, self.limits, self.distances = costs, limits, costs.kernel()
        n = len(costs)
        self.near, self.toll = near, costs.between(np.arange(n)[:, None], near)
        self.best, self.mates = np.arange(n, dtype=np.int32), np.full(n, -1, np.int32)
        self.cost, self.done, self.rounds = costs.of_tour(self.best), 0, 0
        self.tours: list[Ints] = []

    def settle(self) -> None:
        """Exchange edges until nothing helps."""
        kicker = self._kicker(self.best.copy())
        for first in range(0, len(self.best), SLICE):
            if self.limits.interrupted():
                break
            kicker.settle(first, first + SLICE)
        self._offer(kicker.best())

    def anneal(self, total: int) -> None:
        """One annealing from the best tour, longer than the one before, and a merge of what was found."""
        n, huge = len(self.best), len(self.best) >= HUGE and self.rounds == 0
        kicks = min(total - self.done, n * min(LONGEST, FIRST << self.rounds) + 1000)
        warmth = (COLD if huge else WARM) * max(self.cost, 1) / n
        cooling, kicker, late = (
            (1.0 if huge else (COLD / WARM) ** (1 / kicks)),
            self._kicker(self.best.copy()),
            False,
        )
        end = self.done + kicks
        while self.done < end and not self.limits.interrupted():
            if not late and not huge and 10 * (end - self.done) <= kicks:
                late = True
                kicker.begin()
            now = min(SLICE, end - self.done)
            warmth, self.done = kicker.anneal(now, warmth, cooling), self.done + now
            self.limits.tell(min(self.cost, self.cost - kicker.best_gain) if huge else self.cost)
        self.rounds += 1
        self._offer(kicker.best())
        if self.done == end:
            self._merge(kicker.best())

    def _merge(self, found: Ints) -> None:
        self.tours = [*self.tours[1 - TOURS :], found]
        if len(self.tours) > 1 and not self.limits.interrupted():
            seed = self.limits.seed + self.rounds
            self._offer(merged(self.costs, (self.best, *self.tours), seed, self.limits.interrupted))

    def _offer(self, tour: Ints) -> None:
        cost = self.costs.of_tour(tour)
        if cost < self.cost:
            self.best, self.cost = tour, cost

    def _kicker(self, tour: Ints) -> "Kicker":
        from cellwright.engine.stages.sequencing.kernels.kicks import Kicker

        seed = self.limits.seed + 1_000_003 * self.rounds
        return Kicker(tour, self.distances, self.near, self.toll, self.mates, seed)


def default_work(n: int) -> int:
    """The number of kicks that suits n visits: two annealings, about a second for a thousand."""
    return min(max(LITTLE, 3 * FIRST * n + 2000), max(MOST, 10 * n))


def bound(
    cost: Matrix,
    upper: int,
    steps: int = 0,
    interrupted: Interrupted = never,
    penalties: Floats | None = None,
) -> tuple[int, Floats]:
    """A lower bound on all closed tours, and the penalties (n,) that prove it; n >= 3.

    If `steps` is 0, their number suits n. The ascent begins at some `penalties` (n,) if they are given.
    """
    from cellwright.engine.stages.sequencing.kernels.bounds import ascend

    steps = steps or max(60, min(STEPS, 400_000 // len(cost)))
    start = np.zeros(len(cost)) if penalties is None else penalties.copy()
    value, found, _ = ascend(cost, start, float(upper), steps, 1.0, interrupted)
    return int(np.ceil(value)), found
