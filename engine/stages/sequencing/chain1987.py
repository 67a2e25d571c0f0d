"""The chain of 1987: convex hull insertion, two-edge exchange, peephole.

It is a baseline, and a quick answer.
"""

import numpy as np
from numpy.typing import NDArray

from cellwright.engine.stages.sequencing.symmetric import Matrix, Order

WINDOW = 6


def chain(cost: Matrix, positions: NDArray[np.floating] | None = None) -> Order:
    """A closed tour (n,) under symmetric costs, n >= 3.

    It grows from the convex hull of `positions` (n, 2), or without them from the dearest edge.
    """
    from cellwright.engine.stages.sequencing.kernels.chain import exchange_edges, insert_all, peephole

    tour: Order = insert_all(_ring(cost, positions), cost)
    exchange_edges(tour, cost)
    if len(tour) >= WINDOW + 2:
        peephole(tour, cost, WINDOW)
    return tour


def _ring(cost: Matrix, positions: NDArray[np.floating] | None) -> Order:
    if positions is not None and len(hull := convex_hull(positions)) >= 3:
        return hull
    a, b = divmod(int(np.argmax(cost)), len(cost))
    return np.array((a, b) if a != b else (0, 1), np.int32)


def convex_hull(positions: NDArray[np.floating]) -> Order:
    """The corners of the convex hull of points (n, 2), counter-clockwise (Andrew 1979).

    They are at most two if all points lie on one line.
    """
    order = np.lexsort((positions[:, 1], positions[:, 0]))
    lower, upper = _half(positions, order), _half(positions, order[::-1])
    return np.array(lower[:-1] + upper[:-1], np.int32)


def _half(positions: NDArray[np.floating], order: NDArray[np.intp]) -> list[int]:
    half: list[int] = []
    for index in order:
        while len(half) > 1 and _turn(positions, half[-2], half[-1], int(index)) <= 0:
            half.pop()
        half.append(int(index))
    return half


def _turn(positions: NDArray[np.floating], a: int, b: int, c: int) -> float:
    u, v = positions[b] - positions[a], positions[c] - positions[a]
    return float(u[0] * v[1] - u[1] * v[0])
