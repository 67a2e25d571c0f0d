# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False
# cython: initializedcheck=False, cdivision=True
"""Parts of the chain of 1987: cheapest insertion, two-edge exchange, and the peephole.

They work on all costs (n, n) of 32 or 64 bits that are the same in both directions.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cellwright.engine.kernels.arrays import Floats, Ints, Longs

Costs = NDArray[Any]  # whole numbers of 32 or 64 bits
NEVER = 1 << 60
INFINITE = float("inf")


def _check(cities: Ints, n: int, width: int, least: int) -> None:
    """Raises ValueError if cities and costs do not fit together: compiled loops do not check
    this.
    """
    tour = np.asarray(cities)
    if n != width or not least <= len(tour) <= n or not 0 <= tour.min() <= tour.max() < n:
        raise ValueError(
            f"at least {least} cities, numbered 0 to {n - 1}, and costs (n, n) were expected"
        )


def _edge(cost: Costs, a: int, b: int) -> int:
    """The cost from one city to another."""
    return int(cost[a, b])


def insert_all(ring: Ints, cost: Costs) -> Ints:
    """A tour of all cities, made from a ring of some by inserting one city after another.

    Each city has a cheapest place: the edge whose replacement adds the least cost. The next city is
    the one whose way through its place is shortest in proportion to that edge (Golden, Bodin, Doyle
    & Stewart 1980, hull insertion). `ring` (m,), m >= 2, `cost` (n, n).
    """
    n, some = cost.shape[0], ring.shape[0]
    _check(ring, n, cost.shape[1], 2)
    after, place, ratio = np.full(n, -1, np.int32), np.full(n, -1, np.int32), np.full(n, INFINITE)
    for index in range(some):
        after[ring[index]] = ring[(index + 1) % some]
    _place(-1, after, place, ratio, cost)
    for _ in range(n - some):
        chosen = _least(ratio)
        a = place[chosen]
        after[chosen], after[a] = after[a], chosen
        ratio[chosen] = INFINITE
        _place(chosen, after, place, ratio, cost)
    made, city = np.empty(n, np.int32), ring[0]
    for index in range(n):
        made[index] = city
        city = after[city]
    return np.asarray(made)


def _place(new: int, after: Ints, place: Ints, ratio: Floats, cost: Costs) -> None:
    """Note each outside city's cheapest place, and the way through the city there in proportion to
    the edge.

    After `new` was inserted, all places are searched again only for cities whose cheapest place was
    cut.
    """
    n = after.shape[0]
    cut = -1
    if new >= 0:
        cut = place[new]
    for city in range(n):
        if after[city] >= 0:
            continue
        old = place[city]
        best = old
        if old == cut:
            best = _cheapest_place(city, after, cost)
        else:
            least = _detour(city, old, after, cost)
            if _detour(city, cut, after, cost) < least:
                best, least = cut, _detour(city, cut, after, cost)
            if _detour(city, new, after, cost) < least:
                best = new
        if best != old or old == cut:
            place[city] = best
            ratio[city] = _ratio(city, best, after, cost)


def _ratio(city: int, a: int, after: Ints, cost: Costs) -> float:
    """The way from `a` by `city` to the next city, in proportion to the edge that it replaces."""
    way = float(
        _edge(cost, a, city) + _edge(cost, city, after[a])
    )  # a float, because C rounds the quotient of whole numbers down
    return way / max(_edge(cost, a, after[a]), 1)


def _least(ratio: Floats) -> int:
    """The first city with the least ratio."""
    chosen = 0
    for city in range(1, ratio.shape[0]):
        if ratio[city] < ratio[chosen]:
            chosen = city
    return chosen


def _detour(city: int, a: int, after: Ints, cost: Costs) -> int:
    """The extra cost of going from `a` by `city` to the next city."""
    b = after[a]
    return _edge(cost, a, city) + _edge(cost, city, b) - _edge(cost, a, b)


def _cheapest_place(city: int, after: Ints, cost: Costs) -> int:
    """The first of the cities after which `city` costs least."""
    chosen, least = -1, 0
    for a in range(after.shape[0]):
        if after[a] >= 0:
            detour = _detour(city, a, after, cost)
            if chosen < 0 or detour < least:
                chosen, least = a, detour
    return chosen


def exchange_edges(tour: Ints, cost: Costs) -> int:
    """Make two-edge exchanges (Croes 1958), each as soon as it is found, until none helps.

    `tour` is changed in place. Returns the number of exchanges.
    """
    _check(tour, cost.shape[0], cost.shape[1], 1)
    n, made, improved = tour.shape[0], 0, True
    while improved:
        improved = False
        for i in range(n - 1):
            for j in range(i + 2, n - 1 if i == 0 else n):
                a, b, c, d = tour[i], tour[i + 1], tour[j], tour[j + 1 if j + 1 < n else 0]
                if _edge(cost, a, c) + _edge(cost, b, d) < _edge(cost, a, b) + _edge(cost, c, d):
                    _reverse(tour, i + 1, j)
                    made, improved = made + 1, True
    return made


def _reverse(tour: Ints, first: int, last: int) -> None:
    """Reverse a stretch of a tour."""
    while first < last:
        tour[first], tour[last] = tour[last], tour[first]
        first, last = first + 1, last - 1


def peephole(tour: Ints, cost: Costs, width: int) -> int:
    """Put each stretch of `width` cities into its best order between its neighbours, until nothing
    changes.

    Needs n >= width + 2. `tour` is changed in place. Returns how many stretches were changed.
    """
    _check(tour, cost.shape[0], cost.shape[1], width + 2)
    inner = np.zeros(width, np.int32)
    value, origin = np.zeros((1 << width, width), np.int64), np.zeros((1 << width, width), np.int32)
    n, made, improved = tour.shape[0], 0, True
    while improved:
        improved = False
        for start in range(n):
            if _reorder(tour, cost, start, inner, value, origin):
                made, improved = made + 1, True
    return made


def _reorder(tour: Ints, cost: Costs, start: int, inner: Ints, value: Longs, origin: Ints) -> bool:
    """Put one stretch into its best order by dynamic programming over subsets (Held & Karp 1962).

    Returns whether it is shorter.
    """
    n, width = tour.shape[0], inner.shape[0]
    full, old = (1 << width) - 1, 0
    for index in range(width):
        inner[index] = tour[(start + 1 + index) % n]
        old += _edge(cost, tour[(start + index) % n], inner[index])
    right = tour[(start + width + 1) % n]
    old += _edge(cost, inner[width - 1], right)
    _subsets(inner, tour[start], cost, value, origin)
    best, least = 0, value[full, 0] + _edge(cost, inner[0], right)
    for last in range(1, width):
        closed = value[full, last] + _edge(cost, inner[last], right)
        if closed < least:
            best, least = last, closed
    if least >= old:
        return False
    for index in range(width - 1, -1, -1):
        tour[(start + 1 + index) % n] = inner[best]
        last, full = best, full & ~(1 << best)
        best = origin[full | 1 << last, last]
    return True


def _subsets(inner: Ints, left: int, cost: Costs, value: Longs, origin: Ints) -> None:
    """Write the cheapest path from `left` through each subset of `inner` to each of its cities, and
    the city before that.

    `value` and `origin` (2 ** width, width) are written.
    """
    width = inner.shape[0]
    value[:, :] = NEVER
    for last in range(width):
        value[1 << last, last] = _edge(cost, left, inner[last])
    for subset in range(1, 1 << width):
        for last in range(width):
            for following in range(width if subset >> last & 1 else 0):
                longer = value[subset, last] + _edge(cost, inner[last], inner[following])
                wider = subset | 1 << following
                if wider != subset and longer < value[wider, following]:
                    value[wider, following], origin[wider, following] = longer, last
