# cython: language_level=3, annotation_typing=False, infer_types=True, boundscheck=False
# cython: wraparound=False, initializedcheck=False, cdivision=True
"""Plane regions of a depth image.

In a picture, the inverse depth w of a plane is linear in the pixel: w = a u + b v + c. So a plane
is fitted to pixels as a line is to points, and a region grows over the neighbours whose inverse
depth is near its plane.
"""

import math

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs, refuse_unless

DOUBT = 1e30  # how badly a block without enough pixels fits


class Grower:
    """An image of inverse depths (h, w), 0 where nothing is known, and the number of each pixel's
    region (h, w): 0 if none.

    Pixels with a negative number are left alone. `plane` (3,) and `size` are those of the region
    that grew last.
    """

    def __init__(self, inverse: Floats, label: Longs) -> None:
        self.height, self.width = inverse.shape
        refuse_unless("inverse depths", inverse, np.float64, inverse.shape)
        refuse_unless("regions", label, np.int64, inverse.shape)
        self.inverse, self.label = inverse, label
        self.queue = np.zeros(inverse.size, dtype=np.int64)
        self.plane, self.sums = np.zeros(3), np.zeros(9)
        self.size, self.u0, self.v0, self.w0 = 0, 0, 0, 0.0


def fit(g: Grower) -> bool:
    """Set the plane from the sums over pixels; false if these lie on a line."""
    n = g.sums[0]
    if n < 3.0:
        return False
    uu, uv = g.sums[4] - g.sums[1] * g.sums[1] / n, g.sums[5] - g.sums[1] * g.sums[2] / n
    vv, uw = g.sums[6] - g.sums[2] * g.sums[2] / n, g.sums[7] - g.sums[1] * g.sums[3] / n
    vw = g.sums[8] - g.sums[2] * g.sums[3] / n
    determinant = uu * vv - uv * uv
    if determinant <= 1e-9 * n * n:
        return False
    a, b = (uw * vv - vw * uv) / determinant, (vw * uu - uw * uv) / determinant
    g.plane[0], g.plane[1] = a, b
    g.plane[2] = g.w0 + (g.sums[3] - a * g.sums[1] - b * g.sums[2]) / n - a * g.u0 - b * g.v0
    return True


def _begin(g: Grower, u: int, v: int) -> None:
    g.u0, g.v0, g.w0 = u, v, g.inverse[v, u]
    for i in range(9):
        g.sums[i] = 0.0


def _add(g: Grower, u: int, v: int) -> None:
    x, y, w = 1.0 * u - g.u0, 1.0 * v - g.v0, g.inverse[v, u] - g.w0
    g.sums[0] += 1.0
    g.sums[1] += x
    g.sums[2] += y
    g.sums[3] += w
    g.sums[4] += x * x
    g.sums[5] += x * y
    g.sums[6] += y * y
    g.sums[7] += x * w
    g.sums[8] += y * w


def _free(g: Grower, u: int, v: int) -> bool:
    """Whether a pixel is known and in no region."""
    return bool(g.inverse[v, u] > 0.0 and g.label[v, u] == 0)


def block(g: Grower, u: int, v: int, side: int) -> float:
    """How far the pixels of a block from (v, u) are from the plane fitted to them, in metres (root
    of the mean square).

    The plane is that of `g`. A block with fewer than three quarters of its pixels free fits badly.
    """
    _begin(g, u + side // 2, v + side // 2)
    if not _free(g, g.u0, g.v0):
        return DOUBT
    for y in range(v, v + side):
        for x in range(u, u + side):
            if _free(g, x, y):
                _add(g, x, y)
    if 4.0 * g.sums[0] < 3.0 * side * side or not fit(g):
        return DOUBT
    return float(math.sqrt(_square(g, u, v, side) / g.sums[0]) / (g.w0 * g.w0))


def _square(g: Grower, u: int, v: int, side: int) -> float:
    """The sum of the squares by which a block's free pixels deviate from the plane."""
    square = 0.0
    for y in range(v, v + side):
        for x in range(u, u + side):
            if _free(g, x, y):
                apart = g.inverse[y, x] - (g.plane[0] * x + g.plane[1] * y + g.plane[2])
                square += apart * apart
    return square


def blocks(g: Grower, side: int, stride: int) -> Floats:
    """For blocks on a grid (rows, columns), how badly each fits its plane, in metres."""
    rows, columns = (g.height - side) // stride + 1, (g.width - side) // stride + 1
    found = np.full((max(rows, 0), max(columns, 0)), DOUBT)
    out = found
    for row in range(rows):
        for column in range(columns):
            out[row, column] = block(g, column * stride, row * stride, side)
    return found


def grow(g: Grower, number: int, tolerance_m: float) -> int:
    """Let region `number` grow from the last block's middle, over pixels within `tolerance_m` of
    its plane; its size.

    The plane is fitted anew each time that the region has doubled.
    """
    return _grow(g, number, tolerance_m)


def _grow(g: Grower, number: int, tolerance_m: float) -> int:
    first, last, due = 0, 1, 128
    u, v = g.u0, g.v0
    if g.label[v, u] != 0:
        return 0
    _begin(g, u, v)
    g.queue[0], g.label[v, u] = v * g.width + u, number
    while first < last:
        v, u = g.queue[first] // g.width, g.queue[first] % g.width
        first += 1
        _add(g, u, v)
        if first >= due and fit(g):
            due = 2 * first
        for side in range(4):
            x = u + (1 if side == 0 else -1 if side == 1 else 0)
            y = v + (1 if side == 2 else -1 if side == 3 else 0)
            if x < 0 or y < 0 or x >= g.width or y >= g.height:
                continue
            if not _free(g, x, y):
                continue
            w = g.plane[0] * x + g.plane[1] * y + g.plane[2]
            if abs(g.inverse[y, x] - w) <= tolerance_m * w * w:
                g.label[y, x] = number
                g.queue[last] = y * g.width + x
                last += 1
    fit(g)
    g.size = last
    return last


def release(g: Grower, number: int) -> None:
    """Give the last region's pixels another number."""
    for i in range(g.size):
        g.label[g.queue[i] // g.width, g.queue[i] % g.width] = number
