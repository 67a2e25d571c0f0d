"""Closed tours under symmetric costs: annealed exchanges, merged tours, and a lower bound.

Cook & Seymour 2003 (tour merging). Paths of common edges become single edges that must stay. So the
search has a fraction of the cities and few candidates, and needs little time.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cellwright.engine.kernels.arrays import Floats, Ints, Longs, Truths
from cellwright.engine.kernels.cancellation import Interrupted, never
from cellwright.engine.stages.sequencing.city_costs import (
    CityCosts,
    nearest_cities,
    quadrant_cities,
)
from cellwright.engine.stages.sequencing.search_limits import TourLimits

if TYPE_CHECKING:
    from cellwright.engine.stages.sequencing.kernels.kicks import Kicker

MERGING_SLICE = 2000  # kicks, or cities that are looked at, between two questions whether to stop
MIN_OPEN_CITIES = 8  # with fewer cities left there is nothing to search
FAR_COST = 2**60
MERGING_WARM, MERGING_COLD = 0.3, 0.03  # times the mean edge
KICKS = 40  # for each city that is left


def merge_tours(
    costs: CityCosts, tours: Sequence[Ints], seed: int, interrupted: Interrupted = never
) -> Ints:
    """A tour (n,) that costs no more than the first of `tours`, which are permutations of the
    same n cities.
    """
    from cellwright.engine.stages.sequencing.kernels.kicks import Kicker

    base = _turn_tour(tours[0], costs)
    codes = [_tour_codes(tour) for tour in (base, *tours[1:])]
    edges, counts = np.unique(np.concatenate(codes), return_counts=True)
    fixed = np.isin(codes[0], edges[counts == len(codes)], assume_unique=True)
    open_cities = np.flatnonzero(~(fixed & np.roll(fixed, 1)))
    if len(open_cities) < MIN_OPEN_CITIES:
        return base
    cities, mate = base[open_cities], _path_mates(fixed[open_cities])
    part = costs.part(cities)
    near, toll = _open_candidates(part, cities, edges[counts < len(codes)], len(base))
    tour = np.arange(len(cities), dtype=np.int32)
    kicker = Kicker(tour, part.kernel(), near, toll, mate, seed)
    for first in range(0, len(tour), MERGING_SLICE):
        if interrupted():
            break
        kicker.settle(first, first + MERGING_SLICE)
    kicks = KICKS * len(tour)
    warmth = MERGING_WARM * max(1, costs.of_tour(base)) / len(base)
    for done in range(0, kicks, MERGING_SLICE):
        if interrupted():
            break
        warmth = kicker.anneal(
            min(MERGING_SLICE, kicks - done), warmth, (MERGING_COLD / MERGING_WARM) ** (1 / kicks)
        )
    return _expand_tour(base, open_cities, mate, kicker.best())


def _turn_tour(tour: Ints, costs: CityCosts) -> Ints:
    """The tour, with the last city at its end: a city that is no point has the last number."""
    return np.roll(tour, len(tour) - 1 - int(np.flatnonzero(tour == len(costs) - 1)[0]))


def _tour_codes(tour: Ints) -> Longs:
    """A number for each edge (n,), the same in both directions."""
    edge_start, edge_end = tour.astype(np.int64), np.roll(tour, -1).astype(np.int64)
    return np.minimum(edge_start, edge_end) * len(tour) + np.maximum(edge_start, edge_end)


def _path_mates(fixed: Truths) -> Ints:
    """The other end of the common path that ends at a city, or -1.

    `fixed` says whether a path begins at a city.
    """
    n = len(fixed)
    mate = np.full(n, -1, np.int32)
    begins = np.flatnonzero(fixed)
    mate[begins], mate[(begins + 1) % n] = (begins + 1) % n, begins
    return mate


def _open_candidates(
    part: CityCosts, cities: Ints, open_edges: Longs, n: int
) -> tuple[Ints, Longs]:
    """The other ends of the open edges of each city, nearest first, and the costs to them."""
    m = len(cities)
    number = np.full(n, -1, np.int64)
    number[cities] = np.arange(m)
    a, b = number[open_edges // n], number[open_edges % n]
    edge_start, edge_end = np.concatenate((a, b)), np.concatenate((b, a))
    cost = part.between(edge_start, edge_end)
    order = np.lexsort((edge_end, cost, edge_start))
    edge_start, edge_end, cost = edge_start[order], edge_end[order], cost[order]
    count = np.bincount(edge_start, minlength=m)
    rank = np.arange(len(edge_start)) - np.repeat(np.cumsum(count) - count, count)
    near = np.repeat(((np.arange(m, dtype=np.int32) + 1) % m)[:, None], int(count.max()), axis=1)
    toll = np.full(near.shape, FAR_COST, np.int64)
    near[edge_start, rank], toll[edge_start, rank] = edge_end, cost
    return near, toll


def _expand_tour(base: Ints, open_cities: Longs, mate: Ints, tour: Ints) -> Ints:
    """The tour of all cities: between mates the path of the base is put in again."""
    n, m, pieces = len(base), len(open_cities), []
    for a, b in zip(tour, np.roll(tour, -1), strict=True):
        pieces.append(base[open_cities[a] : open_cities[a] + 1])
        if mate[a] == b:
            first, last = (a, b) if b == (a + 1) % m else (b, a)
            start, end = int(open_cities[first]) + 1, int(open_cities[last])
            inner = base[start:end] if start <= end else np.concatenate((base[start:n], base[:end]))
            pieces.append(inner if first == a else inner[::-1])
    return np.concatenate(pieces)


Matrix = NDArray[Any]  # whole numbers of 32 or 64 bits
Order = Ints
MIN_SEARCHED_CITIES = 8  # fewer cities are left to the exact methods
KICKS_SLICE = 2000  # kicks, or cities that are looked at, between two questions whether to stop
WARM, COLD = 2.0, 0.1  # times the mean edge, at the beginning and the end of each annealing
FIRST, LONGEST = 10, 40  # kicks for each city in the first annealing, and in the longest
# from this number of cities on, a first annealing that is hardly warm comes before all others
MIN_HUGE_CITIES = 20_000
MERGED_TOURS = 6  # that are merged
TOUR_CANDIDATES = 7  # candidates of each city
ASCENT_STEPS = 300  # of the ascent over a matrix if no proof is tried; fewer if each takes long
LITTLE, MOST = 20_000, 2_000_000  # kicks, if the caller sets no number


@dataclass(frozen=True, slots=True, eq=False)
class SymmetricAnswer:
    """The best order, its cost, and the number of kicks made."""

    order: Order
    cost: int
    work: int


def tour_candidates(
    costs: CityCosts,
    positions: NDArray[np.floating] | None = None,
    interrupted: Interrupted = never,
) -> Ints:
    """The candidate neighbours of each city (n, k); worth nothing if it is interrupted."""
    where = costs.points if positions is None else positions
    if where is None:
        assert costs.matrix is not None
        return nearest_cities(costs.matrix, TOUR_CANDIDATES + 1)
    return quadrant_cities(where, costs, TOUR_CANDIDATES, interrupted)


def search_tour(
    costs: CityCosts,
    start: Order,
    limits: TourLimits,
    near: Ints | None = None,
    mates: Ints | None = None,
) -> SymmetricAnswer:
    """The best closed tour found from `start` (n,), n >= 8. `near` (n, k) are candidate neighbours.

    `mates` (n,) has the city to which the edge of a city must stay, or -1; `start` has these edges.

    One annealing after another begins at the best tour. Then the last tours are merged. Cities are
    numbered along `start`, so that neighbours lie near each other in memory.
    """
    n, total = len(costs), limits.work or default_work(len(costs))
    near = tour_candidates(costs, None, limits.interrupted) if near is None else near
    if limits.interrupted():
        return SymmetricAnswer(start, costs.of_tour(start), 0)
    cities = np.roll(start, n - 1 - int(np.flatnonzero(start == n - 1)[0]))
    number = np.empty(n, np.int32)
    number[cities] = np.arange(n, dtype=np.int32)
    search = _TourSearch(costs.part(cities), np.ascontiguousarray(number[near[cities]]), limits)
    if mates is not None:
        search.mates = np.where(mates < 0, -1, number[mates])[cities].astype(np.int32)
    search.settle()
    while search.done < total and not limits.interrupted():
        search.anneal(total)
    return SymmetricAnswer(cities[search.best], search.cost, search.done)


class _TourSearch:
    """The best tour so far and the tours that were found last."""

    def __init__(self, costs: CityCosts, near: Ints, limits: TourLimits) -> None:
        self.costs, self.limits, self.distances = costs, limits, costs.kernel()
        n = len(costs)
        self.near, self.toll = near, costs.between(np.arange(n)[:, None], near)
        self.best, self.mates = np.arange(n, dtype=np.int32), np.full(n, -1, np.int32)
        self.cost, self.done, self.rounds = costs.of_tour(self.best), 0, 0
        self.tours: list[Ints] = []

    def settle(self) -> None:
        """Exchange edges until nothing helps."""
        kicker = self._kicker(self.best.copy())
        for first in range(0, len(self.best), KICKS_SLICE):
            if self.limits.interrupted():
                break
            kicker.settle(first, first + KICKS_SLICE)
        self._offer(kicker.best())

    def anneal(self, total: int) -> None:
        """One annealing from the best tour, longer than the one before, and a merge of what was
        found.
        """
        n, huge = len(self.best), len(self.best) >= MIN_HUGE_CITIES and self.rounds == 0
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
            now = min(KICKS_SLICE, end - self.done)
            warmth, self.done = kicker.anneal(now, warmth, cooling), self.done + now
            self.limits.tell(min(self.cost, self.cost - kicker.best_gain) if huge else self.cost)
        self.rounds += 1
        self._offer(kicker.best())
        if self.done == end:
            self._merge(kicker.best())

    def _merge(self, new_tour: Ints) -> None:
        self.tours = [*self.tours[1 - MERGED_TOURS :], new_tour]
        if len(self.tours) > 1 and not self.limits.interrupted():
            seed = self.limits.seed + self.rounds
            self._offer(
                merge_tours(self.costs, (self.best, *self.tours), seed, self.limits.interrupted)
            )

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


def tour_lower_bound(
    cost: Matrix,
    upper: int,
    steps: int = 0,
    interrupted: Interrupted = never,
    penalties: Floats | None = None,
) -> tuple[int, Floats]:
    """A lower bound on all closed tours, and the penalties (n,) that prove it; n >= 3.

    If `steps` is 0, their number suits n. The ascent begins at some `penalties` (n,) if they are
    given.
    """
    from cellwright.engine.stages.sequencing.kernels.bounds import ascend

    steps = steps or max(60, min(ASCENT_STEPS, 400_000 // len(cost)))
    start = np.zeros(len(cost)) if penalties is None else penalties.copy()
    value, best_penalties, _ = ascend(cost, start, float(upper), steps, 1.0, interrupted)
    return int(np.ceil(value)), best_penalties
