"""Compiled parts of the chain of 1987: cheapest insertion, two-edge exchange, and the peephole.

Works on any costs that are the same in both directions.
"""

import numpy as np

from engine.stages.sequencing.kernels import compiled
from engine.stages.sequencing.kernels.arrays import Ints, Longs

NEVER = 1 << 60


@compiled
def insert_all(ring: Ints, cost: Ints) -> Ints:
    """A tour of all cities from a ring of some: again and again the insertion that costs least beside the edge it cuts.

    Among the cheapest places of all cities, the city goes in whose detour is shortest in proportion to that edge
    (Golden, Bodin, Doyle & Stewart 1980, hull insertion). `ring` (m,), m >= 2, `cost` (n, n).
    """
    n = cost.shape[0]
    after, place = np.full(n, -1, np.int32), np.full(n, -1, np.int32)
    for index in range(ring.shape[0]):
        after[ring[index]] = ring[(index + 1) % ring.shape[0]]
    for city in range(n):
        if after[city] < 0:
            place[city] = _cheapest_place(city, after, cost)
    for _ in range(n - ring.shape[0]):
        chosen = _shortest_detour(after, place, cost)
        a = place[chosen]
        after[chosen], after[a] = after[a], chosen
        for city in range(n):
            if after[city] < 0:
                place[city] = _better_place(city, place[city], a, chosen, after, cost)
    tour, city = np.empty(n, np.int32), ring[0]
    for index in range(n):
        tour[index] = city
        city = after[city]
    return tour


@compiled
def _shortest_detour(after: Ints, place: Ints, cost: Ints) -> int:
    """The city outside whose way through its cheapest place is shortest in proportion to the edge there."""
    chosen, least = -1, np.inf
    for city in range(after.shape[0]):
        if after[city] >= 0:
            continue
        a = place[city]
        ratio = (cost[a, city] + cost[city, after[a]]) / max(cost[a, after[a]], 1)
        if ratio < least:
            chosen, least = city, ratio
    return chosen


@compiled
def _detour(city: int, a: int, after: Ints, cost: Ints) -> int:
    return int(cost[a, city] + cost[city, after[a]] - cost[a, after[a]])


@compiled
def _cheapest_place(city: int, after: Ints, cost: Ints) -> int:
    chosen = -1
    for a in range(after.shape[0]):
        if after[a] >= 0 and (
            chosen < 0 or _detour(city, a, after, cost) < _detour(city, chosen, after, cost)
        ):
            chosen = a
    return chosen


@compiled
def _better_place(city: int, old: int, a: int, new: int, after: Ints, cost: Ints) -> int:
    """The cheapest place after `new` was put behind `a`: only a place that was cut makes a new search necessary."""
    if old == a:
        return int(_cheapest_place(city, after, cost))
    best = a if _detour(city, a, after, cost) < _detour(city, old, after, cost) else old
    return new if _detour(city, new, after, cost) < _detour(city, best, after, cost) else best


@compiled
def exchange_edges(tour: Ints, cost: Ints) -> int:
    """Two-edge exchanges (Croes 1958), each as soon as it is seen, until none helps; `tour` is changed. Their number."""
    n, made, improved = tour.shape[0], 0, True
    while improved:
        improved = False
        for i in range(n - 1):
            for j in range(i + 2, n - 1 if i == 0 else n):
                a, b, c, d = tour[i], tour[i + 1], tour[j], tour[(j + 1) % n]
                if cost[a, c] + cost[b, d] < cost[a, b] + cost[c, d]:
                    tour[i + 1 : j + 1] = tour[i + 1 : j + 1][::-1].copy()
                    made, improved = made + 1, True
    return made


@compiled
def peephole(tour: Ints, cost: Ints, width: int) -> int:
    """Put each stretch of `width` cities into its best order between its neighbours, until nothing changes.

    Needs n >= width + 2. `tour` is changed; returns how many stretches were changed.
    """
    n, made, improved = tour.shape[0], 0, True
    while improved:
        improved = False
        for start in range(n):
            if _reorder(tour, cost, start, width):
                made, improved = made + 1, True
    return made


@compiled
def _reorder(tour: Ints, cost: Ints, start: int, width: int) -> bool:
    """The best order of one stretch, by dynamic programming over subsets (Held & Karp 1962); whether it is shorter."""
    n, full = tour.shape[0], (1 << width) - 1
    inner = np.empty(width, np.int32)
    old = 0
    for index in range(width):
        inner[index] = tour[(start + 1 + index) % n]
        old += cost[tour[(start + index) % n], inner[index]]
    left, right = tour[start], tour[(start + width + 1) % n]
    old += cost[inner[width - 1], right]
    value, origin = _subsets(inner, left, cost)
    best = 0
    for last in range(width):
        if value[full, last] + cost[inner[last], right] < value[full, best] + cost[inner[best], right]:
            best = last
    if value[full, best] + cost[inner[best], right] >= old:
        return False
    subset = full
    for index in range(width - 1, -1, -1):
        tour[(start + 1 + index) % n] = inner[best]
        subset, best = subset & ~(1 << best), origin[subset, best]
    return True


@compiled
def _subsets(inner: Ints, left: int, cost: Ints) -> tuple[Longs, Ints]:
    """The cheapest path from `left` through each subset of `inner` to each of its cities, and the city before that."""
    width = inner.shape[0]
    value = np.full((1 << width, width), NEVER, np.int64)
    origin = np.zeros((1 << width, width), np.int32)
    for index in range(width):
        value[1 << index, index] = cost[left, inner[index]]
    for subset in range(1, 1 << width):
        for pair in range(width * width):
            last, following = pair // width, pair % width
            if value[subset, last] == NEVER or subset >> following & 1:
                continue
            longer, wider = value[subset, last] + cost[inner[last], inner[following]], subset | 1 << following
            if longer < value[wider, following]:
                value[wider, following], origin[wider, following] = longer, last
    return value, origin
