# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False
# cython: initializedcheck=False, cdivision=True
"""Minimum 1-trees of all edges without a matrix (Prim 1957).

Weights are costs with penalties. All of them are whole multiples of 1/64, so sums have no rounding
error. City 0 is the one that is no part of the tree and has two edges.
"""

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Ints
from cellwright.engine.stages.sequencing.kernels.distances import Distances

INFINITE = float("inf")


def full_tree(distances: Distances, penalty: Floats, parent: Ints) -> float:
    """The weight of a minimum 1-tree of all cities, n >= 3.

    The tree's edges go from each city to its `parent` (n,); `parent` of cities 0 and 1 are the two
    ends of city 0.
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
