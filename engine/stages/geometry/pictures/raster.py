"""Triangles drawn into a picture of pixels, where the nearest one is seen."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine.model.geometry import Floats


def fill(image: NDArray[Any], triangles: Iterable[Floats], values: Iterable[Any]) -> NDArray[Any]:
    """The image (height, width, ...) after triangles were drawn into it, each with its value.

    Triangles (3, 3) are in pixels to the right, down and towards the viewer.
    """
    depth = np.full(image.shape[:2], -np.inf)
    for corners, value in zip(triangles, values, strict=True):
        _fill(image, depth, corners, value)
    return image


def _fill(image: NDArray[Any], depth: Floats, corners: Floats, value: object) -> None:
    """Sets the pixels whose middle lies in a triangle, where the triangle is nearer than what was drawn before."""
    low = np.maximum(np.floor(corners[:, :2].min(axis=0)).astype(int), 0)
    high = np.minimum(np.ceil(corners[:, :2].max(axis=0)).astype(int) + 1, image.shape[1::-1])
    (ax, ay), (bx, by), (cx, cy) = corners[:, :2]
    area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
    if abs(area) < 1e-12 or (low >= high).any():
        return
    x = np.arange(low[0], high[0])[None] + 0.5
    y = np.arange(low[1], high[1])[:, None] + 0.5
    u = ((bx - x) * (cy - y) - (cx - x) * (by - y)) / area
    v = ((cx - x) * (ay - y) - (ax - x) * (cy - y)) / area
    z = u * corners[0, 2] + v * corners[1, 2] + (1 - u - v) * corners[2, 2]
    window = (slice(low[1], high[1]), slice(low[0], high[0]))
    nearer = (u >= 0) & (v >= 0) & (u + v <= 1) & (z > depth[window])
    depth[window][nearer] = z[nearer]
    image[window][nearer] = value
