"""The convex hull of points in space, as triangles, by Qhull (Barber, Dobkin & Huhdanpaa 1996)."""

import numpy as np

from cellwright.engine.kernels.linear import matmul, norm
from cellwright.engine.model.geometry import Floats, Longs


class FlatError(ValueError):
    """The points span no volume."""


def hull_triangles(points: Floats) -> Longs:
    """The hull of points (n, 3) as triangles (m, 3) of indices, counter-clockwise seen from outside.

    Raises `FlatError` when all points lie within 1e-9 of their extent of one plane.
    """
    from scipy.spatial import ConvexHull, QhullError

    _refuse_flat(points)
    try:
        hull = ConvexHull(points - points.mean(axis=0))
    except QhullError:
        raise FlatError("the points are too near to one plane") from None
    triangles: Longs = hull.simplices.astype(np.int64)
    normals, _ = planes(points, triangles)
    inwards = np.einsum("ij,ij->i", normals, hull.equations[:, :3]) < 0
    triangles[inwards] = triangles[inwards][:, ::-1]
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


def _refuse_flat(points: Floats) -> None:
    """Raise `FlatError` unless some four of the points span a volume."""
    scale = float(np.ptp(points, axis=0).max()) if len(points) else 0.0
    if len(points) < 4 or scale <= 0:
        raise FlatError("fewer than four different points")
    first = points[int(np.argmin(points[:, int(np.argmax(np.ptp(points, axis=0)))]))]
    line = points[int(np.argmax(np.linalg.norm(points - first, axis=1)))] - first
    across = np.cross(points - first, line)
    normal = np.cross(line, points[int(np.argmax(np.linalg.norm(across, axis=1)))] - first)
    length = norm(normal)
    if length <= 1e-9 * scale * norm(line):
        raise FlatError("the points lie on one line")
    if np.abs(matmul(points - first, normal)).max() <= 1e-9 * scale * length:
        raise FlatError("the points lie in one plane")


def hull_vertices(points: Floats) -> Floats:
    """The points (m, 3) that are corners of the hull of points (n, 3), in the order given."""
    corners: Floats = points[np.unique(hull_triangles(points))]
    return corners
