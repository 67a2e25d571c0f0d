"""Regions of a plane between closed polygons: what lies inside, and points spread over it.

A point lies inside if a ray from it crosses an odd number of sides (Shimrat 1962).
"""

from collections.abc import Sequence

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Truths

MAX_PAIRS_AT_ONCE = 4_000_000  # pairs of points and sides looked at together


def polygon_sides(polygons: Sequence[Floats]) -> tuple[Floats, Floats]:
    """Where the sides of closed polygons begin and end: two arrays (m, 2)."""
    starts = [polygon for polygon in polygons if len(polygon)]
    if not starts:
        return np.zeros((0, 2)), np.zeros((0, 2))
    return np.concatenate(starts), np.concatenate([np.roll(start, -1, axis=0) for start in starts])


def points_inside(polygons: Sequence[Floats], points: Floats) -> Truths:
    """Whether each of the points (n, 2) lies inside the polygons taken together."""
    a, b = polygon_sides(polygons)
    step = max(1, MAX_PAIRS_AT_ONCE // max(1, len(a)))
    parts = [_crosses_odd(a, b, points[i : i + step]) for i in range(0, len(points), step)]
    return np.concatenate(parts) if parts else np.zeros(0, bool)


def _crosses_odd(a: Floats, b: Floats, points: Floats) -> Truths:
    """Where a ray to the right from each point crosses an odd number of sides.

    Few sides are as high as a point.
    """
    y = points[:, 1:]
    point_number, side = np.nonzero((a[:, 1] > y) != (b[:, 1] > y))
    p, q, (x, y) = a[side], b[side], points[point_number].T
    right = x < p[:, 0] + (y - p[:, 1]) * (q[:, 0] - p[:, 0]) / (q[:, 1] - p[:, 1])
    odd: Truths = np.bincount(point_number[right], minlength=len(points)) % 2 == 1
    return odd


def row_points(polygons: Sequence[Floats], count: int) -> tuple[Floats, Floats]:
    """Points (n, 2) inside polygons, on `count` rows of equal height, and the area (n,) that each
    stands for.

    On each stretch of a row there is at least one point, so that narrow regions get points, too.
    """
    a, b = polygon_sides(polygons)
    if not len(a):
        return np.zeros((0, 2)), np.zeros(0)
    low, high = np.minimum(a, b).min(axis=0), np.maximum(a, b).max(axis=0)
    height, step = (high[1] - low[1]) / count, (high[0] - low[0]) / count
    ys = low[1] + height * (np.arange(count) + 0.5)
    row, side = np.nonzero((a[:, 1] > ys[:, None]) != (b[:, 1] > ys[:, None]))
    p, q = a[side], b[side]
    xs = p[:, 0] + (ys[row] - p[:, 1]) * (q[:, 0] - p[:, 0]) / (q[:, 1] - p[:, 1])
    order = np.lexsort((xs, row))
    first, last, row = (
        xs[order[::2]],
        xs[order[1::2]],
        row[order[::2]],
    )  # closed polygons cross a row an even number of times
    wide = last > first
    first, length, row = first[wide], (last - first)[wide], row[wide]
    number = np.maximum(1, np.rint(length / step)).astype(int)
    stretch = np.repeat(np.arange(len(number)), number)
    place = np.arange(len(stretch)) - (np.cumsum(number) - number)[stretch] + 0.5
    x = first[stretch] + length[stretch] * place / number[stretch]
    return np.stack([x, ys[row[stretch]]], axis=1), (length / number * height)[stretch]


def spread_points(candidates: Floats, count: int, taken: Floats | None = None) -> list[int]:
    """`count` of the candidates (n, k), each as far as possible from those before and those
    taken (Gonzalez 1985).
    """
    if not len(candidates) or count <= 0:
        return []
    if taken is not None and len(taken):
        near = np.min([((candidates - place) ** 2).sum(axis=1) for place in taken], axis=0)
        chosen: list[int] = []
    else:
        middle = candidates[
            int(np.argmin(((candidates - candidates.mean(axis=0)) ** 2).sum(axis=1)))
        ]
        chosen = [int(np.argmax(((candidates - middle) ** 2).sum(axis=1)))]
        near = ((candidates - candidates[chosen[0]]) ** 2).sum(axis=1)
    while len(chosen) < min(count, len(candidates)):
        chosen.append(int(np.argmax(near)))
        near = np.minimum(near, ((candidates - candidates[chosen[-1]]) ** 2).sum(axis=1))
    return chosen
