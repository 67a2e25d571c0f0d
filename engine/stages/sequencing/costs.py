"""Symmetric costs between cities: a matrix, or a metric on points that takes no more memory than the points."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cellwright.engine.kernels.arrays import Floats, Ints, Longs
from cellwright.engine.model.metric import Metric

if TYPE_CHECKING:
    from cellwright.engine.stages.sequencing.kernels.distances import Distances

NO_GROUPS, NO_EXTRA, NO_ENDS = np.zeros(0, np.int32), np.zeros((1, 1), np.int64), np.zeros(0, np.int64)
NARROWEST = 2**28  # sums of four smaller costs fit in 32 bits
ROWS = 200  # of a table that are made at once
TABLED = 4_000  # up to this number of cities a table of all costs is worth its memory


@dataclass(frozen=True, slots=True, eq=False)
class Costs:
    """Costs between n cities, by a matrix (n, n) or a metric.

    With a metric, `extra` [group of a, group of b] is added if cities have groups (m,); and a city m that is no point may
    come last: `ends` (m + 1,) has the costs to it.
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
        """The cost from each city of `a` to the city of `b` at the same place; shapes are broadcast."""
        if self.matrix is not None:
            looked_up: Longs = self.matrix[a, b].astype(np.int64)
            return looked_up
        assert self.metric is not None
        last = len(self.metric) - 1
        inner_a, inner_b = np.minimum(a, last), np.minimum(b, last)
        found = self.metric.between(inner_a, inner_b)
        if len(self.group):
            found = found + self.extra[self.group[inner_a], self.group[inner_b]]
        if len(self.ends) > last + 1:
            found = np.where(a > last, self.ends[b], np.where(b > last, self.ends[a], found))
        return found

    def of_tour(self, order: Ints) -> int:
        """The cost of a closed tour."""
        return int(self.between(order, np.roll(order, -1)).sum())

    def part(self, cities: Ints) -> "Costs":
        """The costs between some cities, numbered in this order. A city that is no point must come last."""
        if self.matrix is not None:
            return Costs(np.ascontiguousarray(self.matrix[np.ix_(cities, cities)]))
        assert self.metric is not None
        inner = cities[cities < len(self.metric)]
        group = self.group[inner] if len(self.group) else self.group
        ends = self.ends[cities] if len(inner) < len(cities) else NO_ENDS
        return Costs(None, Metric(self.metric.kind, self.metric.points[inner]), group, self.extra, ends)

    def tabled(self) -> "Costs":
        """The same costs, by a matrix if the cities are not too many."""
        if self.matrix is not None or len(self) > TABLED:
            return self
        every = np.arange(len(self))
        rows = np.array_split(every, len(self) // ROWS + 1)
        return of_matrix(np.concatenate([self.between(some[:, None], every[None]) for some in rows]))

    def kernel(self) -> "Distances":
        """The same for compiled loops."""
        from cellwright.engine.stages.sequencing.kernels.distances import Distances

        if self.matrix is not None:
            return Distances(self.matrix)
        assert self.metric is not None
        points = np.zeros((len(self.metric), 3))
        points[:, : self.metric.points.shape[1]] = self.metric.points
        return Distances(
            metric=self.metric.kind, points=points, group=self.group, extra=self.extra, ends=self.ends
        )

    @property
    def points(self) -> Floats | None:
        """The points of the metric."""
        return None if self.metric is None else self.metric.points


def of_matrix(cost: NDArray[Any]) -> Costs:
    """The costs of a matrix, in 32 bits if sums of four of them fit."""
    narrow = cost.max(initial=0) < NARROWEST
    return Costs(np.ascontiguousarray(cost.astype(np.int32 if narrow else np.int64)))
