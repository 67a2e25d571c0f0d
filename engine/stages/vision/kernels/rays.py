# cython: language_level=3, annotation_typing=False, infer_types=True, boundscheck=False
# cython: wraparound=False, initializedcheck=False, cdivision=True
"""The rays of a camera's pixels on triangles: how deep the first one hit lies, and which it is.

A ray meets a triangle where it passes all three planes through the eye and an edge on the same
side. These tests are linear in the pixel, so each triangle is tried, in each row of the box around
its picture, on one stretch of pixels only.
"""

import math

import cython
import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs, refuse_unless

NEAR = 1e-6  # metres: what is nearer to the eye's plane is not seen
NONE = -1


class Range:
    """What the pixels (height, width) see: the depth along the optical axis, 0 for nothing, and
    the number of the owner.
    """

    def __init__(
        self, shape: tuple[int, int], focal_px: float, centre_px: tuple[float, float]
    ) -> None:
        """An empty picture: pixel (v, u) looks along ((u - cx) / focal, (v - cy) / focal, 1)."""
        self.depth, self.owner = np.zeros(shape), np.full(shape, NONE, dtype=np.int64)
        self._depth, self._owner = self.depth, self.owner
        self.height, self.width = shape
        self.focal, (self.cx, self.cy) = focal_px, centre_px
        # the normals of a triangle's edge planes, and of its own plane
        self.plane = np.zeros((4, 3))


def draw(r: Range, corners: Floats, owners: Longs) -> None:
    """Look at triangles (m, 3, 3) in the camera's frame, each with its owner (m,).

    The nearest is kept, also of earlier calls.
    """
    count = len(corners)
    refuse_unless("corners", corners, np.float64, (count, 3, 3))
    refuse_unless("owners", owners, np.int64, (count,))
    triangles, numbers = corners, owners
    with cython.nogil:
        for t in range(count):
            _draw(r, triangles, t, numbers[t])


def _draw(r: Range, corners: Floats, t: int, owner: int) -> None:
    left, right, top, bottom = 0, r.width - 1, 0, r.height - 1
    low = min(corners[t, 0, 2], corners[t, 1, 2], corners[t, 2, 2])
    high = max(corners[t, 0, 2], corners[t, 1, 2], corners[t, 2, 2])
    if high <= NEAR:
        return
    if low > NEAR:
        u0 = u1 = r.focal * corners[t, 0, 0] / corners[t, 0, 2]
        v0 = v1 = r.focal * corners[t, 0, 1] / corners[t, 0, 2]
        for i in range(1, 3):
            across = r.focal * corners[t, i, 0] / corners[t, i, 2]
            down = r.focal * corners[t, i, 1] / corners[t, i, 2]
            u0, u1, v0, v1 = min(u0, across), max(u1, across), min(v0, down), max(v1, down)
        if u1 + r.cx < left or u0 + r.cx > right or v1 + r.cy < top or v0 + r.cy > bottom:
            return
        left, right = _least(u0 + r.cx, left), _most(u1 + r.cx, right)
        top, bottom = _least(v0 + r.cy, top), _most(v1 + r.cy, bottom)
    offset = _planes(r, corners, t)
    if offset == 0.0:
        return
    for v in range(top, bottom + 1):
        y = (v - r.cy) / r.focal
        first, last = _span(r, y, 1.0 if offset > 0.0 else -1.0, left, right)
        for u in range(first, last + 1):
            _look(r, owner, u, v, y, offset)


def _span(r: Range, y: float, side: float, left: int, right: int) -> tuple[int, int]:
    """The first and the last pixel of a row that may be on the inner side of all three edges; the
    last is before the first if none is.

    One pixel more on each side, as the row's ends are rounded.
    """
    low, high = 1.0 * left, 1.0 * right
    for i in range(3):
        rise, height = side * r.plane[i, 0] / r.focal, side * (r.plane[i, 1] * y + r.plane[i, 2])
        if rise > 0.0:
            low = max(low, r.cx - height / rise - 1.0)
        elif rise < 0.0:
            high = min(high, r.cx - height / rise + 1.0)
        elif height < 0.0:
            high = low - 1.0
    if low > high:
        return (left, left - 1)
    first, last = math.floor(low), min(math.ceil(high), 1.0 * right)
    return (int(first), int(last))


def _look(r: Range, owner: int, u: int, v: int, y: float, offset: float) -> None:
    """Let one pixel see the triangle whose planes are set, if its ray meets it before anything
    else.
    """
    x = (u - r.cx) / r.focal
    a = r.plane[0, 0] * x + r.plane[0, 1] * y + r.plane[0, 2]
    b = r.plane[1, 0] * x + r.plane[1, 1] * y + r.plane[1, 2]
    c = r.plane[2, 0] * x + r.plane[2, 1] * y + r.plane[2, 2]
    slope = a + b + c
    if slope == 0.0 or min(a, b, c) * max(a, b, c) < 0.0:
        return
    z = offset / slope
    if z > NEAR and (r._owner[v, u] == NONE or z < r._depth[v, u]):
        r._depth[v, u], r._owner[v, u] = z, owner


def _least(pixel: float, low: int) -> int:
    """The first whole pixel from `low` on that is not before a place."""
    while low < pixel:
        low += 1
    return low


def _most(pixel: float, high: int) -> int:
    """The last whole pixel up to `high` that is not after a place."""
    while high > pixel:
        high -= 1
    return high


def _planes(r: Range, corners: Floats, t: int) -> float:
    """Set the normals of the planes through the eye and the edges, and of the triangle's plane,
    their sum; its offset.
    """
    for x in range(3):
        r.plane[3, x] = 0.0
    for i in range(3):
        j = (i + 1) % 3
        for x in range(3):
            y, z = (x + 1) % 3, (x + 2) % 3
            r.plane[i, x] = (
                corners[t, i, y] * corners[t, j, z] - corners[t, i, z] * corners[t, j, y]
            )
            r.plane[3, x] += r.plane[i, x]
    return float(
        r.plane[3, 0] * corners[t, 0, 0]
        + r.plane[3, 1] * corners[t, 0, 1]
        + r.plane[3, 2] * corners[t, 0, 2]
    )
