"""First tours: the chain of 1987 (hull insertion, exchange, peephole), and a Hilbert curve.

It is a baseline, and a quick answer.
"""

import numpy as np
from numpy.typing import NDArray

from cellwright.engine.kernels.arrays import Floats, Ints
from cellwright.engine.stages.sequencing.symmetric_tours import Matrix, Order

PEEPHOLE_WINDOW = 6


def chain_tour(cost: Matrix, positions: NDArray[np.floating] | None = None) -> Order:
    """A closed tour (n,) under symmetric costs, n >= 3.

    It grows from the convex hull of `positions` (n, 2), or without them from the dearest edge.
    """
    from cellwright.engine.stages.sequencing.kernels.chain import (
        exchange_edges,
        insert_all,
        peephole,
    )

    tour: Order = insert_all(_first_ring(cost, positions), cost)
    exchange_edges(tour, cost)
    if len(tour) >= PEEPHOLE_WINDOW + 2:
        peephole(tour, cost, PEEPHOLE_WINDOW)
    return tour


def _first_ring(cost: Matrix, positions: NDArray[np.floating] | None) -> Order:
    if positions is not None and len(hull := convex_hull(positions)) >= 3:
        return hull
    a, b = divmod(int(np.argmax(cost)), len(cost))
    return np.array((a, b) if a != b else (0, 1), np.int32)


def convex_hull(positions: NDArray[np.floating]) -> Order:
    """The corners of the convex hull of points (n, 2), counter-clockwise (Andrew 1979).

    They are at most two if all points lie on one line.
    """
    order = np.lexsort((positions[:, 1], positions[:, 0]))
    lower, upper = _hull_half(positions, order), _hull_half(positions, order[::-1])
    return np.array(lower[:-1] + upper[:-1], np.int32)


def _hull_half(positions: NDArray[np.floating], order: NDArray[np.intp]) -> list[int]:
    half: list[int] = []
    for index in order:
        while len(half) > 1 and _turn_area(positions, half[-2], half[-1], int(index)) <= 0:
            half.pop()
        half.append(int(index))
    return half


def _turn_area(positions: NDArray[np.floating], a: int, b: int, c: int) -> float:
    u, v = positions[b] - positions[a], positions[c] - positions[a]
    return float(u[0] * v[1] - u[1] * v[0])


HILBERT_BITS = 16


def along_hilbert(points: Floats) -> Ints:
    """The order (n,) of points (n, d) along a Hilbert curve (Skilling 2004, transposed
    coordinates).
    """
    low = points.min(axis=0)
    width = max(float((points.max(axis=0) - low).max()), 1e-300)
    axes = ((points - low) / width * (2**HILBERT_BITS - 1)).astype(np.int64).T.copy()
    _untangle_axes(axes)
    code = np.zeros(len(points), np.int64)
    for bit in range(HILBERT_BITS - 1, -1, -1):
        for axis in axes:
            code = (code << 1) | ((axis >> bit) & 1)
    return np.argsort(code, kind="stable").astype(np.int32)


def _untangle_axes(axes: NDArray[np.int64]) -> None:
    """Turn coordinates (d, n) into the transposed index on the curve, in place."""
    for bit in range(HILBERT_BITS - 1, 0, -1):
        mask, below = 1 << bit, (1 << bit) - 1
        for axis in range(len(axes)):
            is_set = (axes[axis] & mask) != 0
            swapped = np.where(is_set, 0, (axes[0] ^ axes[axis]) & below)
            axes[0] ^= np.where(is_set, below, swapped)
            axes[axis] ^= swapped
    for axis in range(1, len(axes)):
        axes[axis] ^= axes[axis - 1]
    turned = np.zeros_like(axes[0])
    for bit in range(HILBERT_BITS - 1, 0, -1):
        turned ^= np.where((axes[-1] & (1 << bit)) != 0, (1 << bit) - 1, 0)
    axes ^= turned


def nearest_first_tour(cost: NDArray[np.integer]) -> Order:
    """A tour that always goes to the nearest city not yet visited."""
    n, at = len(cost), 0
    order, unvisited = np.zeros(n, np.int32), np.ones(n, bool)
    for index in range(1, n):
        unvisited[at] = False
        row = np.where(unvisited, cost[at], np.iinfo(cost.dtype).max)
        at = int(np.argmin(row))
        order[index] = at
    return order
