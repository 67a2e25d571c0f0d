"""The convex hull of points in space, as triangles; for small sets (some hundreds of points)."""

import numpy as np

from engine.model.geometry import Floats, Longs


class FlatError(ValueError):
    """The points span no volume."""


def hull_triangles(points: Floats) -> Longs:
    """The hull of points (n, 3) as triangles (m, 3) of indices, counter-clockwise seen from outside.

    The hull grows point by point, the farthest first. Each new point replaces the triangles that it sees (the
    idea of Barber, Dobkin & Huhdanpaa 1996). Raises `FlatError` when all points lie within 1e-9 of their
    extent of one plane.
    """
    scale = float(np.ptp(points, axis=0).max()) if len(points) else 0.0
    tolerance = 1e-9 * scale
    triangles = _tetrahedron(points, tolerance)
    for _ in range(4 * len(points)):  # each round adds a corner; only rounding errors could make more rounds
        normals, offsets = planes(points, triangles)
        above = points @ normals.T - offsets
        highest = above.max(axis=0)
        face = int(np.argmax(highest))
        if highest[face] <= tolerance:
            return triangles
        point = int(np.argmax(above[:, face]))
        seen = above[point] > tolerance * 0.5
        triangles = np.concatenate([triangles[~seen], _cone(triangles[seen], point)])
    return triangles


def planes(points: Floats, triangles: Longs) -> tuple[Floats, Floats]:
    """Outward unit normals (m, 3) and offsets (m,) of triangles.

    A triangle without area has the normal zero; no point sees it.
    """
    a, b, c = points[triangles[:, 0]], points[triangles[:, 1]], points[triangles[:, 2]]
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    unit: Floats = normals / np.where(length > 0, length, 1.0)
    return unit, np.einsum("ij,ij->i", unit, a)


def _tetrahedron(points: Floats, tolerance: float) -> Longs:
    """Four of the points that span a volume, as triangles that face outwards."""
    if len(points) < 4 or tolerance <= 0:
        raise FlatError("fewer than four different points")
    first = int(np.argmin(points[:, int(np.argmax(np.ptp(points, axis=0)))]))
    second = int(np.argmax(np.linalg.norm(points - points[first], axis=1)))
    line = points[second] - points[first]
    third = int(np.argmax(np.linalg.norm(np.cross(points - points[first], line), axis=1)))
    normal = np.cross(line, points[third] - points[first])
    length = float(np.linalg.norm(normal))
    if length <= tolerance * float(np.linalg.norm(line)):
        raise FlatError("the points lie on one line")
    height = (points - points[first]) @ normal / length
    fourth = int(np.argmax(np.abs(height)))
    if abs(height[fourth]) <= tolerance:
        raise FlatError("the points lie in one plane")
    if height[fourth] > 0:
        second, third = third, second
    a, b, c, d = first, second, third, fourth
    return np.array([[a, b, c], [a, d, b], [b, d, c], [c, d, a]])


def _cone(seen: Longs, point: int) -> Longs:
    """Triangles from the new point to the rim of the triangles that it sees."""
    edges = {(int(t[i]), int(t[(i + 1) % 3])) for t in seen for i in range(3)}
    return np.array([(a, b, point) for a, b in sorted(edges) if (b, a) not in edges]).reshape(-1, 3)


def hull_vertices(points: Floats) -> Floats:
    """The points (m, 3) that are corners of the hull of points (n, 3), in the order given."""
    corners: Floats = points[np.unique(hull_triangles(points))]
    return corners
