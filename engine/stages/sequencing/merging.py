"""Several tours are merged: what all have in common stays, and a tour is searched among the edges in which they differ.

Cook & Seymour 2003 (tour merging). Paths of common edges become single edges that must stay. So the search has a fraction
of the cities and few candidates, and needs little time.
"""

from collections.abc import Sequence

import numpy as np

from cellwright.engine.kernels.arrays import Ints, Longs, Truths
from cellwright.engine.kernels.cancellation import Interrupted, never
from cellwright.engine.stages.sequencing.costs import Costs

SLICE = 2000  # kicks, or cities that are looked at, between two questions whether to stop
LEAST = 8  # with fewer cities left there is nothing to search
FAR = 2**60
WARM, COLD = 0.3, 0.03  # times the mean edge
KICKS = 40  # for each city that is left


def merged(costs: Costs, tours: Sequence[Ints], seed: int, interrupted: Interrupted = never) -> Ints:
    """A tour (n,) that costs no more than the first of `tours`, which are permutations of the same n cities."""
    from cellwright.engine.stages.sequencing.kernels.kicks import Kicker

    base = _turned(tours[0], costs)
    codes = [_codes(tour) for tour in (base, *tours[1:])]
    edges, counts = np.unique(np.concatenate(codes), return_counts=True)
    fixed = np.isin(codes[0], edges[counts == len(codes)], assume_unique=True)
    left = np.flatnonzero(~(fixed & np.roll(fixed, 1)))
    if len(left) < LEAST:
        return base
    cities, mate = base[left], _mates(fixed[left])
    part = costs.part(cities)
    near, toll = _candidates(part, cities, edges[counts < len(codes)], len(base))
    tour = np.arange(len(cities), dtype=np.int32)
    kicker = Kicker(tour, part.kernel(), near, toll, mate, seed)
    for first in range(0, len(tour), SLICE):
        if interrupted():
            break
        kicker.settle(first, first + SLICE)
    kicks = KICKS * len(tour)
    warmth = WARM * max(1, costs.of_tour(base)) / len(base)
    for done in range(0, kicks, SLICE):
        if interrupted():
            break
        warmth = kicker.anneal(min(SLICE, kicks - done), warmth, (COLD / WARM) ** (1 / kicks))
    return _expanded(base, left, mate, kicker.best())


def _turned(tour: Ints, costs: Costs) -> Ints:
    """The tour, with the last city at its end: a city that is no point has the last number."""
    return np.roll(tour, len(tour) - 1 - int(np.flatnonzero(tour == len(costs) - 1)[0]))


def _codes(tour: Ints) -> Longs:
    """A number for each edge (n,), the same in both directions."""
    here, there = tour.astype(np.int64), np.roll(tour, -1).astype(np.int64)
    return np.minimum(here, there) * len(tour) + np.maximum(here, there)


def _mates(fixed: Truths) -> Ints:
    """The other end of the common path that ends at a city, or -1. `fixed` says whether a path begins at a city."""
    n = len(fixed)
    mate = np.full(n, -1, np.int32)
    begins = np.flatnonzero(fixed)
    mate[begins], mate[(begins + 1) % n] = (begins + 1) % n, begins
    return mate


def _candidates(part: Costs, cities: Ints, open_edges: Longs, n: int) -> tuple[Ints, Longs]:
    """The other ends of the open edges of each city, nearest first, and the costs to them."""
    m = len(cities)
    number = np.full(n, -1, np.int64)
    number[cities] = np.arange(m)
    a, b = number[open_edges // n], number[open_edges % n]
    here, there = np.concatenate((a, b)), np.concatenate((b, a))
    cost = part.between(here, there)
    order = np.lexsort((there, cost, here))
    here, there, cost = here[order], there[order], cost[order]
    count = np.bincount(here, minlength=m)
    rank = np.arange(len(here)) - np.repeat(np.cumsum(count) - count, count)
    near = np.repeat(((np.arange(m, dtype=np.int32) + 1) % m)[:, None], int(count.max()), axis=1)
    toll = np.full(near.shape, FAR, np.int64)
    near[here, rank], toll[here, rank] = there, cost
    return near, toll


def _expanded(base: Ints, left: Longs, mate: Ints, tour: Ints) -> Ints:
    """The tour of all cities: between mates the path of the base is put in again."""
    n, m, pieces = len(base), len(left), []
    for a, b in zip(tour, np.roll(tour, -1), strict=True):
        pieces.append(base[left[a] : left[a] + 1])
        if mate[a] == b:
            first, last = (a, b) if b == (a + 1) % m else (b, a)
            start, end = int(left[first]) + 1, int(left[last])
            inner = base[start:end] if start <= end else np.concatenate((base[start:n], base[:end]))
            pieces.append(inner if first == a else inner[::-1])
    return np.concatenate(pieces)
