# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False
# cython: initializedcheck=False, cdivision=True
"""Minimum 1-trees of graphs with few edges, again and again under other penalties (Kruskal 1956).

Weights are costs with penalties. All of them are whole multiples of 1 / GRAIN, so sums have no
rounding error, and edges are sorted by the digits of whole numbers. City 0 is the one that is no
part of the tree and has two edges.
"""

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Ints

GRAIN = 64.0
DIGIT = 11  # bits of a number that are sorted by at once


class Graph:
    """Edges (m,) between n cities, and their order by weight under the last penalties."""

    def __init__(self, first: Ints, second: Ints, cost: Floats, n: int) -> None:
        _check(first, second, cost, n)
        self.first, self.second, self.cost, self.n, self.edges = first, second, cost, n, len(first)
        self.weight, self.key = np.zeros(self.edges), np.zeros(self.edges, np.int64)
        self.order, self.spare = np.zeros(self.edges, np.int32), np.zeros(self.edges, np.int32)
        self.root, self.places = np.zeros(n, np.int32), np.zeros((1 << DIGIT) + 1, np.int32)

    def weigh(self, penalty: Floats, degree: Ints, floor: float) -> float:
        """The weight of a minimum 1-tree, less twice the penalties (n,); its degrees (n,) are
        written.

        Where edges are lacking or weigh more than `floor`, edges of this weight are assumed.
        """
        if len(penalty) != self.n or len(degree) != self.n:
            raise ValueError(f"penalties and degrees of {self.n} cities were expected")
        self._sort(self._weights(penalty))
        total = self._tree(degree, floor)
        for city in range(self.n):
            total -= 2.0 * penalty[city]
        return total

    def span(self, penalty: Floats, cities: int, found: Ints) -> int:
        """Write the edges of a shortest tree of the first `cities`, the lightest first; returns
        how many they are.
        """
        if len(penalty) != self.n or not 0 < cities <= self.n or len(found) < cities:
            raise ValueError(f"penalties of {self.n} cities and room for a tree were expected")
        self._sort(self._weights(penalty))
        count = 0
        for city in range(self.n):
            self.root[city] = city
        for place in range(self.edges):
            edge = self.order[place]
            a, b = self.first[edge], self.second[edge]
            if a < cities and b < cities and not self._joined(a, b):
                found[count] = edge
                count += 1
        return count

    def clusters(self, joining: Ints, cluster: Ints) -> None:
        """Write for each city (n,) a city of its cluster, the same for all of them, if some
        edges join cities.
        """
        _check_edges(joining, self.edges)
        if len(cluster) != self.n:
            raise ValueError(f"room for {self.n} cities was expected")
        for city in range(self.n):
            self.root[city] = city
        for place in range(len(joining)):
            self._joined(self.first[joining[place]], self.second[joining[place]])
        for city in range(self.n):
            at = city
            while self.root[at] != at:
                at = self.root[at]
            cluster[city] = at

    def _weights(self, penalty: Floats) -> int:
        """Write weights and keys, which are whole numbers of the same order.

        Returns the greatest key.
        """
        least, greatest = 0.0, 0.0
        for edge in range(self.edges):
            weight = self.cost[edge] + penalty[self.first[edge]] + penalty[self.second[edge]]
            self.weight[edge] = weight
            if edge == 0 or weight < least:
                least = weight
            if edge == 0 or weight > greatest:
                greatest = weight
        for edge in range(self.edges):
            self.key[edge] = int((self.weight[edge] - least) * GRAIN)
        return int((greatest - least) * GRAIN)

    def _sort(self, greatest: int) -> None:
        """Sort the edges by their keys, digit by digit from the last; equal ones stay in their
        order.
        """
        for edge in range(self.edges):
            self.order[edge] = edge
        shift = 0
        while greatest >> shift > 0:
            self._sort_by(shift)
            self.order, self.spare = self.spare, self.order
            shift += DIGIT

    def _sort_by(self, shift: int) -> None:
        """Write the edges in the order of one digit into `spare`."""
        digits = 1 << DIGIT
        for digit in range(digits + 1):
            self.places[digit] = 0
        for edge in range(self.edges):
            self.places[((self.key[edge] >> shift) & (digits - 1)) + 1] += 1
        for digit in range(digits):
            self.places[digit + 1] += self.places[digit]
        for place in range(self.edges):
            edge = self.order[place]
            digit = (self.key[edge] >> shift) & (digits - 1)
            self.spare[self.places[digit]] = edge
            self.places[digit] += 1

    def _tree(self, degree: Ints, floor: float) -> float:
        """The weight of a minimum 1-tree."""
        taken, own, total, wanted = 0, 0, 0.0, self.n - 2
        for city in range(self.n):
            degree[city], self.root[city] = 0, city
        for place in range(self.edges):
            edge = self.order[place]
            if self.weight[edge] >= floor or (taken == wanted and own == 2):
                break
            a, b = self.first[edge], self.second[edge]
            if a == 0 or b == 0:
                if own == 2:
                    continue
                own += 1
            elif self._joined(a, b):
                continue
            else:
                taken += 1
            total += self.weight[edge]
            degree[a] += 1
            degree[b] += 1
        lacking = self.n - taken - own
        return total + floor * lacking if lacking else total

    def _joined(self, a: int, b: int) -> bool:
        """Whether two cities are in one part already; else their parts are joined."""
        while self.root[a] != a:
            self.root[a] = self.root[self.root[a]]
            a = self.root[a]
        while self.root[b] != b:
            self.root[b] = self.root[self.root[b]]
            b = self.root[b]
        if a == b:
            return True
        if a < b:
            self.root[b] = a
        else:
            self.root[a] = b
        return False


def _check(first: Ints, second: Ints, cost: Floats, n: int) -> None:
    """Raises ValueError if arrays do not fit together: compiled loops do not check this."""
    a, b = np.asarray(first), np.asarray(second)
    if not len(a) or a.shape != b.shape or a.shape != np.asarray(cost).shape:
        raise ValueError("two ends (m,) and a cost (m,) of one edge or more were expected")
    if min(a.min(), b.min()) < 0 or max(a.max(), b.max()) >= n:
        raise ValueError(f"cities are numbered 0 to {n - 1}")


def _check_edges(numbers: Ints, count: int) -> None:
    """Raises ValueError if some numbers are not those of edges."""
    given = np.asarray(numbers)
    if len(given) and (given.min() < 0 or given.max() >= count):
        raise ValueError(f"edges are numbered 0 to {count - 1}")
