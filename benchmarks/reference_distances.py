"""Reference distances of convex pieces in plain NumPy, which tests compare the backends with.

This is slow and meant to be obviously right. The compiled kernels are tested against it.
"""

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.stages.geometry.shapes.hulls import FlatError, hull_planes, hull_triangles


def signed_distance(first: Floats, second: Floats) -> float:
    """The distance of the hulls of points (n, 3) and (m, 3), or minus the least move that
    separates them.
    """
    difference = (first[:, None, :] - second[None, :, :]).reshape(-1, 3)
    try:
        triangles = hull_triangles(difference)
    except FlatError:
        return _flat_distance(difference)
    _, offsets = hull_planes(difference, triangles)
    if offsets.min() >= 0:
        return -float(offsets.min())
    return float(min(_triangle_distance(difference[triangle]) for triangle in triangles))


def _flat_distance(points: Floats) -> float:
    """The distance of the origin from the hull of points in one plane.

    The hull is the union of all triangles of the points.
    """
    count = len(points)
    triples = [(i, j, k) for i in range(count) for j in range(i, count) for k in range(j, count)]
    return float(min(_triangle_distance(points[list(triple)]) for triple in triples))


def _triangle_distance(corners: Floats) -> float:
    """The distance of the origin from a triangle: its height if it projects into the triangle, else
    the distance from the nearest edge.
    """
    a, b, c = corners
    normal = np.cross(b - a, c - a)
    length = float(np.linalg.norm(normal))
    if length > 1e-14:
        foot = normal / length * ((normal / length) @ a)
        sides = [np.cross(q - p, foot - p) @ normal for p, q in ((a, b), (b, c), (c, a))]
        if min(sides) >= 0:
            return float(np.linalg.norm(foot))
    return min(_segment_distance(p, q) for p, q in ((a, b), (b, c), (c, a)))


def _segment_distance(p: Floats, q: Floats) -> float:
    along = q - p
    square = float(along @ along)
    t = min(1.0, max(0.0, float(-(p @ along)) / square)) if square > 0 else 0.0
    return float(np.linalg.norm(p + t * along))
