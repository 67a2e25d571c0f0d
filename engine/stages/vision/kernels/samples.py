# cython: language_level=3, annotation_typing=False, infer_types=True, boundscheck=False
# cython: wraparound=False, initializedcheck=False, cdivision=True
"""Counts how many points of a surface a depth image confirms, for each of many poses."""

import math

import numpy as np

from cellwright.engine.kernels.arrays import Floats, refuse_unless


class Samples:
    """An image and points of a surface that are looked for in it.

    Depths (height, width), 0 where nothing is known; `optics` (3,): focal length and middle, in
    pixels; `points` (s, 3) and their outward unit normals (s, 3). A point whose normal's cosine
    with its ray is less than `facing` is not asked for.
    """

    def __init__(
        self, depth: Floats, optics: Floats, points: Floats, normals: Floats, facing: float
    ) -> None:
        refuse_unless("depths", depth, np.float64, depth.shape)
        refuse_unless("optics", optics, np.float64, (3,))
        for what, array in (("points", points), ("normals", normals)):
            refuse_unless(what, array, np.float64, (len(points), 3))
        self.depth, self.optics, self.points, self.normals = depth, optics, points, normals
        self.facing = facing


def seen(s: Samples, poses: Floats, tolerance_m: float) -> tuple[Floats, Floats]:
    """For poses T_camera_surface (h, 4, 4), how many points are seen where they should be, and
    how many are seen through.
    """
    count = len(poses)
    refuse_unless("poses", poses, np.float64, (count, 4, 4))
    agree, through = np.zeros(count), np.zeros(count)
    _seen(s, poses, tolerance_m, agree, through)
    return agree, through


def _seen(s: Samples, poses: Floats, tolerance_m: float, agree: Floats, through: Floats) -> None:
    for h in range(poses.shape[0]):
        for n in range(s.points.shape[0]):
            x, nx = _row(s.points, s.normals, poses, h, n, 0)
            y, ny = _row(s.points, s.normals, poses, h, n, 1)
            z, nz = _row(s.points, s.normals, poses, h, n, 2)
            if z <= 0.0 or x * nx + y * ny + z * nz >= -s.facing * math.sqrt(x * x + y * y + z * z):
                continue
            u = math.floor(s.optics[0] * x / z + s.optics[1] + 0.5)
            v = math.floor(s.optics[0] * y / z + s.optics[2] + 0.5)
            if u < 0.0 or v < 0.0 or u >= s.depth.shape[1] or v >= s.depth.shape[0]:
                continue
            row, column = int(v), int(u)
            depth = s.depth[row, column]
            if depth > 0.0 and depth - z > tolerance_m:
                through[h] += 1.0
            elif depth > 0.0 and depth - z >= -tolerance_m:
                agree[h] += 1.0


def _row(
    points: Floats, normals: Floats, poses: Floats, h: int, n: int, i: int
) -> tuple[float, float]:
    """One coordinate of a point and of its normal at a pose."""
    a, b, c = poses[h, i, 0], poses[h, i, 1], poses[h, i, 2]
    return (
        a * points[n, 0] + b * points[n, 1] + c * points[n, 2] + poses[h, i, 3],
        a * normals[n, 0] + b * normals[n, 1] + c * normals[n, 2],
    )
