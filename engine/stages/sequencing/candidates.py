"""Candidate neighbours: for each city, the few cities that are worth visiting next."""

import numpy as np
from numpy.typing import NDArray

from engine.kernels.arrays import Ints, Longs

COUNT = 6
LIKELY = 64  # among this many nearest cities there is mostly one in each quadrant


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


def quadrant(positions: NDArray[np.floating], cost: NDArray[np.integer], count: int = COUNT) -> Ints:
    """The cheapest city in each quadrant around each city, then the next cheapest: (n, k), cheapest first.

    `positions` (n, 2). Without quadrants, all neighbours of a city in a cluster would lie in this cluster
    (Johnson & McGeoch 1997).
    """
    n = len(cost)
    count = min(count, n - 1)
    found = np.empty((n, count), np.int32)
    for city in range(n):
        far = cost[city].astype(np.int64)
        far[city] = np.iinfo(np.int64).max
        near = _cheapest(far, min(LIKELY, n - 1))
        quarter = _quarters(positions, city, near)
        if (
            len(near) < n - 1 and len(set(quarter)) < 4
        ):  # at the rim, cities in the other quadrants may lie far away
            near = _cheapest(far, n - 1)
            quarter = _quarters(positions, city, near)
        picked = {int(np.argmax(quarter == each)) for each in range(4) if (quarter == each).any()}
        rest = (index for index in range(len(near)) if index not in picked)
        while len(picked) < count:
            picked.add(next(rest))
        found[city] = near[sorted(picked)[:count]]
    return found


def _cheapest(far: Longs, count: int) -> NDArray[np.intp]:
    """The `count` cities of least cost (more if costs are equal), cheapest first, then by number."""
    most = np.partition(far, count - 1)[count - 1]
    among = np.flatnonzero(far <= most)
    return among[np.argsort(far[among], kind="stable")]


def _quarters(positions: NDArray[np.floating], city: int, others: NDArray[np.intp]) -> Longs:
    """The quadrant around a city in which each of the others lies, 0 to 3."""
    step = positions[others] - positions[city]
    return np.asarray(2 * (step[:, 0] >= 0) + (step[:, 1] >= 0), np.int64)
