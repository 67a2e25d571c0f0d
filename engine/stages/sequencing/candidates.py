"""Candidate neighbours: for each city, the few cities that are worth visiting next."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cellwright.engine.kernels.arrays import Floats, Ints, Longs
from cellwright.engine.kernels.cancellation import Interrupted, never
from cellwright.engine.stages.sequencing.costs import Costs

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

COUNT = 6
LIKELY = 48  # among this many nearest cities there is mostly one in each quadrant
FURTHEST = 400  # at the rim, cities in the other quadrants may lie far away
FEW = 1_500  # points of which each is compared with all others
CHUNK = 400_000  # candidates that are weighed at once


def nearest(cost: NDArray[np.integer], count: int = COUNT) -> Ints:
    """The cheapest cities from each city (n, k), cheapest first; k is at most `count`."""
    n = len(cost)
    count = min(count, n - 1)
    far = cost.astype(np.int64)
    np.fill_diagonal(far, np.iinfo(np.int64).max)
    chosen = np.argpartition(far, count - 1, axis=1)[:, :count]
    chosen.sort(axis=1)
    order = np.argsort(np.take_along_axis(far, chosen, 1), axis=1, kind="stable")
    return np.take_along_axis(chosen, order, 1).astype(np.int32)


def quadrant(
    positions: NDArray[np.floating], costs: Costs, count: int = COUNT, interrupted: Interrupted = never
) -> Ints:
    """The cheapest city in each quadrant around each city, then the next cheapest: (n, k), cheapest first.

    `positions` (m, d) are those of the first m cities; d is 2, or 3 for points near a plane. Without quadrants, all
    neighbours of a city in a cluster would lie in this cluster (Johnson & McGeoch 1997). If there is one more city that
    is no point (n = m + 1), each city is its candidate, and it is the last candidate of each. Only the `FURTHEST` nearest
    cities are looked at. What is not found when it is interrupted is city 0.
    """
    n, m = len(costs), len(positions)
    found = np.zeros((m, min(count, m - 1)), np.int32)
    plane, lacking = _plane(positions), np.arange(m)
    tree = _Rows(positions) if m <= FEW else _tree(positions)
    for width in sorted({min(LIKELY, m - 1), min(FURTHEST, m - 1)}):
        again = []
        for part in np.array_split(lacking, len(lacking) * width // CHUNK + 1):
            if interrupted():
                break
            near = _sorted(tree, positions, part, width, costs)
            found[part], whole = _picked(plane, part, near, found.shape[1])
            again.append(part[~whole])
        lacking = np.concatenate(again) if again else lacking[:0]
        if not len(lacking) or interrupted():
            break
    return found if n == m else _with_the_other(found, costs)


def _plane(positions: NDArray[np.floating]) -> Floats:
    """Coordinates in the plane in which the points lie widest (m, 2)."""
    middle = np.asarray(positions, float) - positions.mean(axis=0)
    if middle.shape[1] == 2:
        return np.asarray(middle, np.float64)
    _, _, axes = np.linalg.svd(middle.T @ middle)
    found: Floats = middle @ axes[:2].T
    return found


@dataclass(frozen=True, slots=True, eq=False)
class _Rows:
    """Points (m, d), few enough to look at all of them for each: that takes less time than to import a tree."""

    points: NDArray[np.floating]

    def query(self, points: NDArray[np.floating], count: int) -> tuple[Floats, Longs]:
        """The nearest points of each of some points (p, count), and how far they are; in any order."""
        way: Floats = sum(
            (one[:, None] - other[None]) ** 2 for one, other in zip(points.T, self.points.T, strict=True)
        )
        near = np.argpartition(way, count - 1, axis=1)[:, :count]
        return np.sqrt(np.take_along_axis(way, near, 1)), near


def _tree(positions: NDArray[np.floating]) -> "cKDTree":
    from scipy.spatial import cKDTree as KDTree  # slow to import

    return KDTree(positions)


def _sorted(
    tree: "cKDTree | _Rows", positions: NDArray[np.floating], part: NDArray[np.intp], width: int, costs: Costs
) -> Longs:
    """The nearest cities of each city of `part` without itself (p, width), cheapest first, then by number."""
    _, near = tree.query(positions[part], width + 1)
    near = np.sort(near.reshape(len(part), -1), axis=1)
    cost = costs.between(part[:, None], near)
    cost[near == part[:, None]] = np.iinfo(np.int64).max
    order = np.argsort(cost, axis=1, kind="stable")
    return np.take_along_axis(near, order, 1)[:, :width]


def _picked(plane: Floats, part: NDArray[np.intp], near: Longs, count: int) -> tuple[Ints, NDArray[np.bool_]]:
    """`count` of the near cities, first in each quadrant, then in order; and whether all quadrants were found."""
    step = plane[near] - plane[part][:, None]
    quarter = 2 * (step[..., 0] >= 0) + (step[..., 1] >= 0)
    firsts, whole = np.zeros(near.shape, bool), np.ones(len(part), bool)
    for each in range(4):
        inside = quarter == each
        some = inside.any(axis=1)
        whole &= some
        firsts[some, inside.argmax(axis=1)[some]] = True
    chosen = np.sort(np.argsort(~firsts, axis=1, kind="stable")[:, :count], axis=1)
    return np.take_along_axis(near, chosen, 1).astype(np.int32), whole


def _with_the_other(found: Ints, costs: Costs) -> Ints:
    """The candidates with those of one more city, to which and from which the costs are its `ends`."""
    m, count = found.shape
    cheapest = np.argsort(costs.ends[:m], kind="stable")[: count + 1].astype(np.int32)
    own = np.resize(cheapest, count + 1)
    return np.concatenate((np.hstack((found, np.full((m, 1), m, np.int32))), own[None]))
