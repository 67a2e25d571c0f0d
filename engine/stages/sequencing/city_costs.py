"""Symmetric costs between cities, by matrix or metric, and the neighbours worth visiting next."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cellwright.engine.kernels.arrays import Floats, Ints, Longs
from cellwright.engine.kernels.cancellation import Interrupted, never
from cellwright.engine.model.tour_problem import Metric

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

    from cellwright.engine.stages.sequencing.kernels.distances import Distances

NO_GROUPS, NO_EXTRA, NO_ENDS = (
    np.zeros(0, np.int32),
    np.zeros((1, 1), np.int64),
    np.zeros(0, np.int64),
)
MAX_NARROW_COST = 2**28  # sums of four smaller costs fit in 32 bits
TABLE_ROWS = 200  # of a table that are made at once
MAX_TABLED_CITIES = 4_000  # up to this number of cities a table of all costs is worth its memory


@dataclass(frozen=True, slots=True, eq=False)
class CityCosts:
    """Costs between n cities, by a matrix (n, n) or a metric.

    With a metric, `extra` [group of a, group of b] is added if cities have groups (m,); and a city
    m that is no point may come last: `ends` (m + 1,) has the costs to it.
    """

    matrix: NDArray[Any] | None = None
    metric: Metric | None = None
    group: Ints = field(default_factory=lambda: NO_GROUPS)
    extra: Longs = field(default_factory=lambda: NO_EXTRA)
    ends: Longs = field(default_factory=lambda: NO_ENDS)

    def __len__(self) -> int:
        if self.matrix is not None:
            return len(self.matrix)
        assert self.metric is not None
        return max(len(self.metric), len(self.ends))

    def between(self, a: NDArray[Any], b: NDArray[Any]) -> Longs:
        """The cost from each city of `a` to the city of `b` at the same place; shapes are
        broadcast.
        """
        if self.matrix is not None:
            looked_up: Longs = self.matrix[a, b].astype(np.int64)
            return looked_up
        assert self.metric is not None
        last = len(self.metric) - 1
        inner_a, inner_b = np.minimum(a, last), np.minimum(b, last)
        inner_costs = self.metric.between(inner_a, inner_b)
        if len(self.group):
            inner_costs = inner_costs + self.extra[self.group[inner_a], self.group[inner_b]]
        if len(self.ends) > last + 1:
            inner_costs = np.where(
                a > last, self.ends[b], np.where(b > last, self.ends[a], inner_costs)
            )
        return inner_costs

    def of_tour(self, order: Ints) -> int:
        """The cost of a closed tour."""
        return int(self.between(order, np.roll(order, -1)).sum())

    def part(self, cities: Ints) -> "CityCosts":
        """The costs between some cities, numbered in this order.

        A city that is no point must come last.
        """
        if self.matrix is not None:
            return CityCosts(np.ascontiguousarray(self.matrix[np.ix_(cities, cities)]))
        assert self.metric is not None
        inner = cities[cities < len(self.metric)]
        group = self.group[inner] if len(self.group) else self.group
        ends = self.ends[cities] if len(inner) < len(cities) else NO_ENDS
        return CityCosts(
            None, Metric(self.metric.kind, self.metric.points[inner]), group, self.extra, ends
        )

    def tabled(self) -> "CityCosts":
        """The same costs, by a matrix if the cities are not too many."""
        if self.matrix is not None or len(self) > MAX_TABLED_CITIES:
            return self
        every = np.arange(len(self))
        rows = np.array_split(every, len(self) // TABLE_ROWS + 1)
        return of_matrix(
            np.concatenate([self.between(some[:, None], every[None]) for some in rows])
        )

    def kernel(self) -> "Distances":
        """The same for compiled loops."""
        from cellwright.engine.stages.sequencing.kernels.distances import Distances

        if self.matrix is not None:
            return Distances(self.matrix)
        assert self.metric is not None
        points = np.zeros((len(self.metric), 3))
        points[:, : self.metric.points.shape[1]] = self.metric.points
        return Distances(
            metric=self.metric.kind,
            points=points,
            group=self.group,
            extra=self.extra,
            ends=self.ends,
        )

    @property
    def points(self) -> Floats | None:
        """The points of the metric."""
        return None if self.metric is None else self.metric.points


def of_matrix(cost: NDArray[Any]) -> CityCosts:
    """The costs of a matrix, in 32 bits if sums of four of them fit."""
    narrow = cost.max(initial=0) < MAX_NARROW_COST
    return CityCosts(np.ascontiguousarray(cost.astype(np.int32 if narrow else np.int64)))


CANDIDATE_COUNT = 6
LIKELY = 48  # among this many nearest cities there is mostly one in each quadrant
FURTHEST = 400  # at the rim, cities in the other quadrants may lie far away
MAX_COMPARED_POINTS = 1_500  # points of which each is compared with all others
CANDIDATE_CHUNK = 400_000  # candidates that are weighed at once


def nearest_cities(cost: NDArray[np.integer], count: int = CANDIDATE_COUNT) -> Ints:
    """The cheapest cities from each city (n, k), cheapest first; k is at most `count`."""
    n = len(cost)
    count = min(count, n - 1)
    far = cost.astype(np.int64)
    np.fill_diagonal(far, np.iinfo(np.int64).max)
    chosen = np.argpartition(far, count - 1, axis=1)[:, :count]
    chosen.sort(axis=1)
    order = np.argsort(np.take_along_axis(far, chosen, 1), axis=1, kind="stable")
    return np.take_along_axis(chosen, order, 1).astype(np.int32)


def quadrant_cities(
    positions: NDArray[np.floating],
    costs: CityCosts,
    count: int = CANDIDATE_COUNT,
    interrupted: Interrupted = never,
) -> Ints:
    """The cheapest city in each quadrant around each city, then the next cheapest: (n, k), cheapest
    first.

    `positions` (m, d) are those of the first m cities; d is 2, or 3 for points near a plane.
    Without quadrants, all neighbours of a city in a cluster would lie in this cluster (Johnson &
    McGeoch 1997). If there is one more city that is no point (n = m + 1), each city is its
    candidate, and it is the last candidate of each. Only the `FURTHEST` nearest cities are looked
    at. What is not found when it is interrupted is city 0.
    """
    n, m = len(costs), len(positions)
    neighbours = np.zeros((m, min(count, m - 1)), np.int32)
    plane, lacking = _widest_plane(positions), np.arange(m)
    tree = _PointRows(positions) if m <= MAX_COMPARED_POINTS else _nearest_tree(positions)
    for width in sorted({min(LIKELY, m - 1), min(FURTHEST, m - 1)}):
        again = []
        for part in np.array_split(lacking, len(lacking) * width // CANDIDATE_CHUNK + 1):
            if interrupted():
                break
            near = _sort_nearest(tree, positions, part, width, costs)
            neighbours[part], whole = _pick_quadrants(plane, part, near, neighbours.shape[1])
            again.append(part[~whole])
        lacking = np.concatenate(again) if again else lacking[:0]
        if not len(lacking) or interrupted():
            break
    return neighbours if n == m else _with_the_other(neighbours, costs)


def _widest_plane(positions: NDArray[np.floating]) -> Floats:
    """Coordinates in the plane in which the points lie widest (m, 2)."""
    middle = np.asarray(positions, float) - positions.mean(axis=0)
    if middle.shape[1] == 2:
        return np.asarray(middle, np.float64)
    _, _, axes = np.linalg.svd(middle.T @ middle)
    plane_coordinates: Floats = middle @ axes[:2].T
    return plane_coordinates


@dataclass(frozen=True, slots=True, eq=False)
class _PointRows:
    """Points (m, d), few enough to look at all of them for each: that takes less time than to
    import a tree.
    """

    points: NDArray[np.floating]

    def query(self, points: NDArray[np.floating], count: int) -> tuple[Floats, Longs]:
        """The nearest points of each of some points (p, count), and how far they are; in any
        order.
        """
        squared_distance: Floats = sum(
            (query_axis[:, None] - point_axis[None]) ** 2
            for query_axis, point_axis in zip(points.T, self.points.T, strict=True)
        )
        near = np.argpartition(squared_distance, count - 1, axis=1)[:, :count]
        return np.sqrt(np.take_along_axis(squared_distance, near, 1)), near


def _nearest_tree(positions: NDArray[np.floating]) -> "cKDTree":
    from scipy.spatial import cKDTree as KDTree  # slow to import

    return KDTree(positions)


def _sort_nearest(
    tree: "cKDTree | _PointRows",
    positions: NDArray[np.floating],
    part: NDArray[np.intp],
    width: int,
    costs: CityCosts,
) -> Longs:
    """The nearest cities of each city of `part` without itself (p, width), cheapest first, then
    by number.
    """
    _, near = tree.query(positions[part], width + 1)
    near = np.sort(near.reshape(len(part), -1), axis=1)
    cost = costs.between(part[:, None], near)
    cost[near == part[:, None]] = np.iinfo(np.int64).max
    order = np.argsort(cost, axis=1, kind="stable")
    return np.take_along_axis(near, order, 1)[:, :width]


def _pick_quadrants(
    plane: Floats, part: NDArray[np.intp], near: Longs, count: int
) -> tuple[Ints, NDArray[np.bool_]]:
    """`count` of the near cities, first in each quadrant, then in order; and whether all
    quadrants were found.
    """
    step = plane[near] - plane[part][:, None]
    quarter = 2 * (step[..., 0] >= 0) + (step[..., 1] >= 0)
    firsts, whole = np.zeros(near.shape, bool), np.ones(len(part), bool)
    for quadrant_number in range(4):
        inside = quarter == quadrant_number
        some = inside.any(axis=1)
        whole &= some
        firsts[some, inside.argmax(axis=1)[some]] = True
    chosen = np.sort(np.argsort(~firsts, axis=1, kind="stable")[:, :count], axis=1)
    return np.take_along_axis(near, chosen, 1).astype(np.int32), whole


def _with_the_other(neighbours: Ints, costs: CityCosts) -> Ints:
    """The candidates with those of one more city, to which and from which the costs are its
    `ends`.
    """
    m, count = neighbours.shape
    cheapest = np.argsort(costs.ends[:m], kind="stable")[: count + 1].astype(np.int32)
    own = np.resize(cheapest, count + 1)
    return np.concatenate((np.hstack((neighbours, np.full((m, 1), m, np.int32))), own[None]))
