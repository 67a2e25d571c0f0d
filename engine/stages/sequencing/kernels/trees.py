# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False, initializedcheck=False
# cython: cdivision=True
"""Minimum 1-trees of graphs with few edges (Kruskal 1956), and of all edges without a matrix (Prim 1957).

Weights are costs with penalties. All of them are whole multiples of 1/64, so sums have no rounding error. City 0 is the
one that is no part of the tree and has two edges.
"""

import numpy as np

from engine.kernels.arrays import Floats, Ints
from engine.stages.sequencing.kernels.distances import Distances

INFINITE = float("inf")


def sparse_tree(first: Ints, second: Ints, weight: Floats, degree: Ints, floor: float) -> float:
    """The weight of a minimum 1-tree, whose degrees (n,) are written.

    Edges (m,) between `first` and `second` are sorted by weight. Where edges are lacking or weigh more than `floor`, edges
    of this weight are assumed.
    """
    n, edges, taken, own = len(degree), len(first), 0, 0
    _check(first, second, weight, n)
    root = np.arange(n, dtype=np.int32)
    total = 0.0
    for city in range(n):
        degree[city] = 0
    for edge in range(edges):
        if weight[edge] >= floor or (taken == n - 2 and own == 2):
            break
        a, b = first[edge], second[edge]
        if a == 0 or b == 0:
            if own == 2:
                continue
            own += 1
        elif _joined(root, a, b):
            continue
        else:
            taken += 1
        total += weight[edge]
        degree[a] += 1
        degree[b] += 1
    lacking = n - taken - own
    return total + floor * lacking if lacking else total


def _joined(root: Ints, a: int, b: int) -> bool:
    """Whether two cities are in one part already; else their parts are joined."""
    while root[a] != a:
        root[a] = root[root[a]]
        a = root[a]
    while root[b] != b:
        root[b] = root[root[b]]
        b = root[b]
    if a == b:
        return True
    if a < b:
        root[b] = a
    else:
        root[a] = b
    return False


def full_tree(distances: Distances, penalty: Floats, parent: Ints) -> float:
    """The weight of a minimum 1-tree of all cities, n >= 3.

    The tree's edges go from each city to its `parent` (n,); `parent` of cities 0 and 1 are the two ends of city 0.
    """
    n = distances.n
    if n < 3 or len(penalty) != n or len(parent) != n:
        raise ValueError(f"penalties and parents of {n} cities, three or more, were expected")
    near, outside = np.zeros(n), np.zeros(n, np.int32)
    for city in range(n):
        near[city], outside[city] = INFINITE, city + 2
    total, city = 0.0, 1
    for size in range(n - 2, 0, -1):
        chosen, least = 0, INFINITE
        own = penalty[city]
        for place in range(size):
            other = outside[place]
            weight = distances.between(city, other) + own + penalty[other]
            if weight < near[other]:
                near[other], parent[other] = weight, city
            else:
                weight = near[other]
            if weight < least:
                chosen, least = place, weight
        city = outside[chosen]
        outside[chosen] = outside[size - 1]
        total += least
    return total + _own_edges(distances, penalty, parent)


def _own_edges(distances: Distances, penalty: Floats, parent: Ints) -> float:
    """The weight of the two least edges of city 0."""
    first, second = INFINITE, INFINITE
    for city in range(1, distances.n):
        weight = distances.between(0, city) + penalty[0] + penalty[city]
        if weight < first:
            first, second = weight, first
            parent[0], parent[1] = city, parent[0]
        elif weight < second:
            second = weight
            parent[1] = city
    return first + second


def _check(first: Ints, second: Ints, weight: Floats, n: int) -> None:
    """Raises ValueError if arrays do not fit together: compiled loops do not check this."""
    a, b = np.asarray(first), np.asarray(second)
    if not len(a) or a.shape != b.shape or a.shape != np.asarray(weight).shape:
        raise ValueError("two ends (m,) and a weight (m,) of one edge or more were expected")
    if min(a.min(), b.min()) < 0 or max(a.max(), b.max()) >= n:
        raise ValueError(f"cities are numbered 0 to {n - 1}")
