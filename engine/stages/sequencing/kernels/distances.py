# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False
# cython: initializedcheck=False, cdivision=True
"""Costs between cities: looked up in a matrix, or computed from points.

The figures are those of `cellwright.engine.model.tour_problem`, computed by the same operations in
the same order.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cellwright.engine.kernels.arrays import Floats, Ints, Longs, whole
from cellwright.engine.kernels.arrays import real as reals

NARROW, WIDE, ROUNDED, RAISED, MANHATTAN, LARGEST, PSEUDO, MICROMETRES = range(8)
METRICS = {
    "rounded": ROUNDED,
    "raised": RAISED,
    "manhattan": MANHATTAN,
    "largest": LARGEST,
    "pseudo_euclidean": PSEUDO,
    "micrometres": MICROMETRES,
}
LARGER = 1e6
NONE: NDArray[Any] = np.zeros((1, 1), np.int32)


class Distances:
    """Symmetric costs between `n` cities.

    Either `cost` (n, n) has them, in 32 or 64 bits. Or they are those of `metric` between points
    (m, 3); then `extra` [group of a, group of b] is added. City m, if there is one (n = m + 1), is
    no point: `ends` (n,) has the costs to it.
    """

    def __init__(
        self,
        cost: NDArray[Any] = NONE,
        metric: str = "",
        points: Floats = np.zeros((0, 3)),
        group: Ints = np.zeros(0, np.int32),
        extra: Longs = np.zeros((1, 1), np.int64),
        ends: Longs = np.zeros(0, np.int64),
    ) -> None:
        _check(cost, metric, points, group, extra, ends)
        none: NDArray[Any] = np.zeros((1, 1), np.int64)
        narrow = cost.dtype == np.int32
        self.kind = METRICS[metric] if metric else (NARROW if narrow else WIDE)
        self.n = max(len(points), len(ends)) if metric else len(cost)
        self.dummy = len(points) if metric else -1
        self.grouped = len(group) > 0
        self.narrow, self.wide = whole(cost if narrow else NONE), whole(none if narrow else cost)
        self.points, self.extra = reals(points), whole(extra)
        self.group, self.ends = whole(group), whole(ends)

    def between(self, a: int, b: int) -> int:
        """The cost from one city to another."""
        if self.kind == NARROW:
            return self.narrow[a, b]
        if self.kind == WIDE:
            return self.wide[a, b]
        if a == self.dummy:
            return self.ends[b]
        if b == self.dummy:
            return self.ends[a]
        if self.grouped:
            return self._length(a, b) + self.extra[self.group[a], self.group[b]]
        return self._length(a, b)

    def _length(self, a: int, b: int) -> int:
        """The cost between two points by the metric."""
        x = self.points[a, 0] - self.points[b, 0]
        y = self.points[a, 1] - self.points[b, 1]
        z = self.points[a, 2] - self.points[b, 2]
        if self.kind == ROUNDED:
            return int(math.sqrt(x * x + y * y + z * z) + 0.5)
        if self.kind == RAISED:
            return int(math.ceil(math.sqrt(x * x + y * y + z * z)))  # noqa: RUF046  C's is no whole number
        if self.kind == MICROMETRES:
            return self._even(math.sqrt(x * x + y * y + z * z) * LARGER)
        if self.kind == MANHATTAN:
            return int(abs(x) + abs(y) + abs(z) + 0.5)
        if self.kind == LARGEST:
            return int(max(abs(x), abs(y), abs(z)) + 0.5)
        exact = math.sqrt((x * x + y * y) / 10.0)
        near = int(exact + 0.5)
        return near + 1 if near < exact else near

    def _even(self, value: float) -> int:
        """The nearest whole number; the even one if two are equally near."""
        low = int(value)
        rest = value - low
        if rest > 0.5 or (rest == 0.5 and low % 2 == 1):
            return low + 1
        return low


def _check(
    cost: NDArray[Any], metric: str, points: Floats, group: Ints, extra: Longs, ends: Longs
) -> None:
    """Raises ValueError if arrays do not fit together: compiled loops do not check this."""
    m, kinds = len(points), len(extra)
    square = cost.ndim == 2 and cost.shape[0] == cost.shape[1]
    shaped = points.shape == (m, 3) and len(group) in (0, m) and len(ends) in (0, m, m + 1)
    if not square or not shaped or extra.shape != (kinds, kinds) or bool(metric) == (m == 0):
        shapes = f"{cost.shape}, points {points.shape}, groups {group.shape}, ends {ends.shape}"
        raise ValueError(
            f"costs (n, n), or points (m, 3) with a metric were expected, not {shapes}"
        )
    if len(group) and not 0 <= group.min() <= group.max() < kinds:
        raise ValueError(f"groups are numbered 0 to {kinds - 1}")
