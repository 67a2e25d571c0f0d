# cython: language_level=3, annotation_typing=False, infer_types=True, boundscheck=False
# cython: wraparound=False, initializedcheck=False, cdivision=True
"""Triangles drawn into a picture of pixels, where the nearest one is seen."""

import math
from typing import Any

import cython
import numpy as np
from numpy.typing import NDArray

from cellwright.engine.kernels.arrays import Floats, Longs

FLAT = 1e-12  # square pixels: twice the area of a triangle that is seen from its edge


def fill(image: NDArray[Any], triangles: Floats, values: NDArray[Any]) -> NDArray[Any]:
    """The image (height, width, ...) after triangles were drawn into it, each with its value (m,
    ...).

    Triangles (m, 3, 3) are in pixels to the right, down and towards the viewer.
    """
    number = nearest(triangles, image.shape[1], image.shape[0])
    drawn = number >= 0
    image[drawn] = np.asarray(values)[number[drawn]]
    return image


def nearest(triangles: Floats, width: int, height: int) -> Longs:
    """The number (height, width) of the triangle that is nearest at the middle of each pixel,
    the first of several; else -1.
    """
    corners = np.ascontiguousarray(triangles, dtype=float).reshape(-1, 3, 3)
    depth, number = np.full((height, width), -np.inf), np.full((height, width), -1)
    _draw(corners, depth, number)
    return number


def _draw(corners: Floats, depth: Floats, number: Longs) -> None:
    with cython.nogil:
        for n in range(corners.shape[0]):
            _fill(corners, n, depth, number)


def _fill(corners: Floats, n: int, depth: Floats, number: Longs) -> None:
    """Take the pixels whose middle lies in a triangle, where it is nearer than what was drawn
    before.
    """
    ax, ay, az = corners[n, 0, 0], corners[n, 0, 1], corners[n, 0, 2]
    bx, by, bz = corners[n, 1, 0], corners[n, 1, 1], corners[n, 1, 2]
    cx, cy, cz = corners[n, 2, 0], corners[n, 2, 1], corners[n, 2, 2]
    area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
    if not abs(area) >= FLAT:
        return
    left, right = _pixels(min(ax, bx, cx), max(ax, bx, cx), depth.shape[1])
    top, bottom = _pixels(min(ay, by, cy), max(ay, by, cy), depth.shape[0])
    for row in range(top, bottom):
        y = row + 0.5
        for column in range(left, right):
            x = column + 0.5
            u = ((bx - x) * (cy - y) - (cx - x) * (by - y)) / area
            v = ((cx - x) * (ay - y) - (ax - x) * (cy - y)) / area
            z = u * az + v * bz + (1.0 - u - v) * cz
            if u >= 0.0 and v >= 0.0 and u + v <= 1.0 and z > depth[row, column]:
                depth[row, column], number[row, column] = z, n


def _pixels(low: float, high: float, count: int) -> tuple[int, int]:
    """The first pixel between two places, and the one after the last, of so many."""
    return (int(max(0.0, math.floor(low))), int(min(count * 1.0, max(0.0, math.ceil(high) + 1.0))))
