"""Held-Karp lower bound for many cities: penalties rise over few edges, and one tree over all edges
proves it.

Held & Karp 1970, 1971; steps as in Helsgaun 2000 and Barahona & Anbil 2000. An ascent over few
edges can give a figure that is too high. So what is returned is always the weight of a tree of all
edges under the penalties that were found. Its edges that were lacking are added, and the ascent
goes on.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cellwright.engine.kernels.arrays import Floats, Ints, Longs
from cellwright.engine.kernels.cancellation import Interrupted, never
from cellwright.engine.stages.sequencing.city_costs import MAX_TABLED_CITIES, CityCosts

if TYPE_CHECKING:
    from cellwright.engine.stages.sequencing.kernels.graphs import Graph

PENALTY_GRAIN = 64.0  # penalties are whole multiples of 1 / GRAIN
# Rounds of the ascent: how many steps as a share of those that suit the cities, and the share of
# what is lacking that a step makes up for, at its beginning and its end. After each round edges
# that are lacking are added.
CLUSTERED = 1.5  # the same share for the ascent over clusters, which comes first
ASCENT_ROUNDS = (
    (0.0, 1.0, 1.0),
    (1.0, 1.0, 0.01),
    (0.5, 0.03, 0.001),
    (0.25, 0.003, 0.0003),
    (0.1, 0.001, 0.0003),
)
SINGLE_ASCENT_ROUNDS = (
    (1.0, 0.1, 0.0001),
)  # the rounds for so many cities that nobody looks for lacking edges
AIM, LITTLE = (
    0.03,
    0.001,
    # of the tour: how far above the best bound a step aims at the most, and the least that is made
    # up for
)
DEGREE_MEMORY = 0.97  # of the average, at each step
STEPS, EFFORT = 4000, 1_500_000  # steps of the ascent: at most so many, or so many cities looked at
MAX_DENSE_CITIES = 12_000  # up to this number of cities all edges are counted one by one
# up to this number of cities there is always a bound, soon after an interrupt
MAX_QUICK_CITIES = 8_000
NEAR_EDGES_COUNTED = 60  # of more cities, on average so many near ones are counted
QUANTILES = (1.0, 0.9999, 0.999, 0.99, 0.95, 0.9, 0.75, 0.5)  # of the weights of a tree
# a city of more edges is turned no more than by so many: one that all are near would leap out of
# reach
STEEPEST = 4.0
LIGHTEST = 5  # so many edges of each city are looked for where there is a table
WEIGHT_CHUNK = 2_000_000  # weights at once
FEWER, LEAST = 4, 3  # each time as many clusters; the fewest
NO_FLOOR = 1e300
SHRINK = {
    "rounded": 1.0,
    "raised": 1.0,
    "manhattan": 1.0,
    "micrometres": 1e6,
    "pseudo_euclidean": 0.1**0.5,
}


@dataclass(frozen=True, slots=True, eq=False)
class _EdgeList:
    """Edges (m,) of a graph of n cities."""

    first: Ints
    second: Ints
    cost: Floats
    graph: "Graph"

    def weigh(self, penalty: Floats, degree: Ints, floor: float = NO_FLOOR) -> float:
        """The weight of a minimum 1-tree, less twice the penalties; `degree` (n,) is written."""
        return self.graph.weigh(penalty, degree, floor)

    def tree(self, penalty: Floats, cities: int = 0) -> tuple[Ints, Floats]:
        """The edges of a shortest tree of all cities, or of the first so many, with their
        weights, the lightest first.
        """
        tree_degrees = np.zeros(len(penalty), np.int32)
        tree = tree_degrees[: self.graph.span(penalty, cities or len(penalty), tree_degrees)]
        return tree, self.cost[tree] + penalty[self.first[tree]] + penalty[self.second[tree]]

    def floors(self, penalty: Floats) -> Floats:
        """Some weights of edges in a shortest tree, the greatest first."""
        _, weight = self.tree(penalty)
        floor_weights: Floats = (
            np.floor(np.quantile(weight, QUANTILES) * PENALTY_GRAIN) / PENALTY_GRAIN
        )
        return floor_weights


def sparse_lower_bound(
    costs: CityCosts,
    near: Ints,
    tour: Ints,
    interrupted: Interrupted = never,
    effort: int = EFFORT,
    opened: bool = False,
) -> tuple[int, Floats]:
    """A lower bound on all closed tours of n >= 8 cities, and penalties (n,) that were found last.

    `near` (n, k) are candidates, `tour` is a good tour. The last city of an `opened` tour is no
    place: it stands for its ends. `effort` is the number of cities that are looked at. If it is
    interrupted, it has no time for a bound on many cities: 0.
    """
    n, upper = len(costs), costs.of_tour(tour)
    costs = costs.tabled()
    if n > MAX_QUICK_CITIES and interrupted():
        return 0, np.zeros(n)
    cities = np.repeat(np.arange(n, dtype=np.int64), near.shape[1])
    first = _edge_codes(cities, near.ravel(), n), _edge_codes(tour, np.roll(tour, -1), n)
    edges = _edge_list(costs, np.concatenate(first))
    steps = max(20, min(STEPS, effort // n))
    places = n - opened
    whole = n <= MAX_DENSE_CITIES or costs.metric is None
    first_steps = int(steps * CLUSTERED) if whole else steps
    kept: Floats = np.zeros(n)
    best, _ = _of_all(
        costs, kept, edges
    )  # few edges mislead the ascent where points lie on a line, so this may remain
    penalty = _raise_clusters(edges, kept, places, float(upper), first_steps, interrupted)
    for part, *shares in ASCENT_ROUNDS if whole else SINGLE_ASCENT_ROUNDS:
        penalty = _averaged_ascent(
            edges, penalty, float(upper), int(steps * part), shares, interrupted
        )
        if interrupted() and (n > MAX_QUICK_CITIES or np.isfinite(best)):
            break
        value, codes = _of_all(costs, penalty, edges)
        if value > best:
            best, kept = value, penalty
        known_codes = _edge_codes(edges.first, edges.second, n)
        fresh = np.setdiff1d(codes, known_codes)
        if interrupted() or best > upper - 1:
            break
        if len(fresh):
            edges = _edge_list(
                costs, np.concatenate((known_codes, fresh, _promising_edges(costs, penalty)))
            )
    return min(upper, int(np.ceil(best))) if np.isfinite(best) else 0, kept


def _edge_codes(a: NDArray[np.integer], b: NDArray[np.integer], n: int) -> Longs:
    """A number for each edge, the same in both directions."""
    codes: Longs = np.minimum(a, b).astype(np.int64) * n + np.maximum(a, b)
    return codes


def _edge_list(costs: CityCosts, codes: Longs) -> _EdgeList:
    n = len(costs)
    single = np.unique(codes)
    single = single[single // n != single % n]
    a, b = (single // n).astype(np.int32), (single % n).astype(np.int32)
    from cellwright.engine.stages.sequencing.kernels.graphs import Graph

    cost: Floats = costs.between(a, b).astype(float)
    return _EdgeList(a, b, cost, Graph(a, b, cost, n))


def _promising_edges(costs: CityCosts, penalty: Floats) -> Longs:
    """The few lightest edges of each city under the penalties; none of many cities, which have
    too many edges to look at.
    """
    n = len(costs)
    if costs.matrix is None or n > MAX_TABLED_CITIES:
        return np.zeros(0, np.int64)
    code_parts = list[Longs]()
    for rows in np.array_split(np.arange(n), n * n // WEIGHT_CHUNK + 1):
        weight = costs.matrix[rows] + penalty
        weight[rows - rows[0], rows] = np.inf
        light = np.argpartition(weight, LIGHTEST, axis=1)[:, :LIGHTEST]
        code_parts.append(_edge_codes(np.repeat(rows, LIGHTEST), light.ravel(), n))
    return np.concatenate(code_parts)


def _raise_clusters(
    edges: _EdgeList,
    penalty: Floats,
    places: int,
    upper: float,
    steps: int,
    interrupted: Interrupted,
) -> Floats:
    """Penalties (n,) that are raised for whole clusters of the first `places` cities, at first for
    the few largest.

    What one city says about its cluster is little against what it says about itself. So an ascent
    over single cities takes very long until all cities of a cluster have moved.
    """
    n, cluster = len(penalty), np.zeros(len(penalty), np.int32)
    tree, weight = edges.tree(penalty, places)
    counts = [n // FEWER**level for level in range(1, 20) if n // FEWER**level >= LEAST][::-1]
    for count in counts:
        if interrupted():
            break
        dropped = weight[1 - count :]
        edges.graph.clusters(tree[weight < dropped[0]], cluster)
        size = float(dropped.mean()) / 8
        penalty = _periodic_ascent(
            edges, penalty, upper, steps // (2 * len(counts)), interrupted, max(size, 1.0), cluster
        )
    return penalty


def _averaged_ascent(
    edges: _EdgeList,
    penalty: Floats,
    upper: float,
    steps: int,
    shares: Sequence[float],
    interrupted: Interrupted,
) -> Floats:
    """The penalties (n,) of the best bound, by steps along an average of what the last trees say
    (Barahona & Anbil 2000).

    A single tree says too much: from one step to the next its edges leap to and fro between
    clusters. A step is a share of what is lacking (Held & Karp 1971), which falls from the first of
    the `shares` to the last, as in annealing. What is lacking is not told by `upper` alone, as the
    tour may be poor: nobody aims far above the best bound so far.
    """
    degree, best_penalty, best = np.zeros(len(penalty), np.int32), penalty, -np.inf
    average: Floats = np.zeros(len(penalty))
    for share in np.geomspace(shares[0], shares[1], steps).tolist():
        value = edges.weigh(penalty, degree)
        turn = degree.astype(np.float64) - 2.0
        if value > best:
            best, best_penalty = value, penalty
        if not turn.any() or best > upper - 1 or interrupted():
            break
        average = DEGREE_MEMORY * average + (1 - DEGREE_MEMORY) * turn
        square = float(np.cumsum(average * average)[-1])  # the same figure on every processor
        lacking = min(upper, best + AIM * upper) - value
        size = min(share * max(lacking, LITTLE * upper) / square, upper / len(penalty))
        penalty = penalty + np.rint(PENALTY_GRAIN * size * average) / PENALTY_GRAIN
    return best_penalty


def _periodic_ascent(
    edges: _EdgeList,
    penalty: Floats,
    upper: float,
    steps: int,
    interrupted: Interrupted,
    size: float,
    cluster: Ints,
) -> Floats:
    """The penalties (n,) of the best bound, by periods of steps of one size (Helsgaun 2000).

    Size and period are shortened again and again. The cities of a `cluster` (n,) move together.
    """
    degree = np.zeros(len(penalty), np.int32)
    last: Floats = np.zeros(len(penalty))
    best_penalty, best, period = penalty, -np.inf, max(10, steps // 3)
    while period > 2 and size >= 0.5 / PENALTY_GRAIN:
        for _ in range(period):
            value = edges.weigh(penalty, degree)
            turn = degree.astype(np.float64) - 2.0
            if value > best:
                best, best_penalty = value, penalty
            if not turn.any() or best > upper - 1 or interrupted():
                return best_penalty
            turn = np.clip(
                np.asarray(np.bincount(cluster, turn), np.float64)[cluster], -STEEPEST, STEEPEST
            )
            penalty = (
                penalty + np.rint(PENALTY_GRAIN * size * (0.7 * turn + 0.3 * last)) / PENALTY_GRAIN
            )
            last = turn
        period, size, penalty = period * 2 // 3, size / 2, best_penalty
    return best_penalty


def _of_all(costs: CityCosts, penalty: Floats, edges: _EdgeList) -> tuple[float, Longs]:
    """The weight of a minimum 1-tree of all edges, less twice the penalties, or a little less;
    and its edges if known.
    """
    n = len(costs)
    if n > MAX_DENSE_CITIES and costs.metric is not None:
        return _at_least(costs, penalty, edges), np.zeros(0, np.int64)
    from cellwright.engine.stages.sequencing.kernels.trees import full_tree

    parent = np.zeros(n, np.int32)
    value = full_tree(costs.kernel(), penalty, parent) - 2 * float(penalty.sum())
    own, other_cities = _edge_codes(np.zeros(2, np.int64), parent[:2], n), np.arange(2, n)
    return value, np.concatenate((own, _edge_codes(other_cities, parent[2:], n)))


def _at_least(costs: CityCosts, penalty: Floats, edges: _EdgeList) -> float:
    """A bound from the cities that are near each city: all other edges weigh at least a floor.

    Two cities a and b that are farther from each other than the radius of each have an edge of at
    least half the cost of the one radius and half the cost of the other. The radius of a city
    depends on its penalty, so that half the cost and the penalty make half the floor.
    """
    from scipy.spatial import cKDTree  # slow to import

    assert costs.metric is not None
    points, n = costs.metric.points, len(costs)
    m, tree = len(points), cKDTree(points)
    shrink = SHRINK.get(costs.metric.kind, points.shape[1] ** -0.5)
    for floor in edges.floors(penalty):
        radius = np.maximum((floor - 2 * penalty[:m] + 1.0) / shrink * (1 + 1e-9), 0.0)
        if (
            int(tree.query_ball_point(points, radius, return_length=True).sum())
            <= NEAR_EDGES_COUNTED * m
        ):
            break
    else:
        return 0.0
    near = tree.query_ball_point(points, radius)
    a, b = (
        np.repeat(np.arange(m), [len(near_cities) for near_cities in near]),
        np.concatenate(near).astype(np.int64),
    )
    codes = _edge_codes(a, b, n)
    if n > m:
        codes = np.concatenate((codes, _edge_codes(np.arange(m), np.full(m, m), n)))
    return _edge_list(costs, codes).weigh(penalty, np.zeros(n, np.int32), floor)
