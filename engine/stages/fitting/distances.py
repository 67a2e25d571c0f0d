"""How far points lie from a shape, square to it, and how that changes with the shape's parameters.

Everything is in the frame of the shape: z is the normal or the axis. A slope (a, b) leans the z axis by a towards x and by b
towards y. Signs: above a plane, outside a sphere, cylinder, cone or circle is positive.
"""

import numpy as np

from cellwright.engine.model.fits import Shape
from cellwright.engine.model.geometry import Floats

NEAREST_M = 1e-12  # to an axis: there no direction away from it is known


def distances(shape: Shape, points: Floats, radius_m: Floats, angle_rad: Floats) -> Floats:
    """Signed distances (..., n, rows) of points (..., n, 3); a circle has two rows: off its plane, and off its line.

    `radius_m` and `angle_rad` (...) are those of as many shapes.
    """
    x, y, z = (points[..., axis] for axis in range(3))
    radius, angle = radius_m[..., None], angle_rad[..., None]
    if shape is Shape.PLANE:
        return z[..., None]
    if shape is Shape.SPHERE:
        return (np.sqrt(x * x + y * y + z * z) - radius)[..., None]
    out = np.sqrt(x * x + y * y) - radius
    if shape is Shape.CIRCLE:
        return np.stack([z, out], axis=-1)
    return (out * np.cos(angle) - z * np.sin(angle))[..., None]


def slopes(shape: Shape, points: Floats, radius_m: float, angle_rad: float) -> Floats:
    """The derivatives (n, rows, p) of the distances of points (n, 3) by the shape's parameters."""
    x, y, z = points.T
    zero, one = np.zeros_like(x), np.ones_like(x)
    if shape is Shape.PLANE:
        return np.stack([-one, x, y], axis=-1)[:, None]
    if shape is Shape.SPHERE:
        length = np.maximum(np.sqrt(x * x + y * y + z * z), NEAREST_M)
        return np.stack([-x / length, -y / length, -z / length, -one], axis=-1)[:, None]
    away = np.maximum(np.sqrt(x * x + y * y), NEAREST_M)
    cos_x, sin_x = x / away, y / away
    if shape is Shape.CIRCLE:
        off = np.stack([zero, zero, -one, x, y, zero], axis=-1)
        out = np.stack([-cos_x, -sin_x, zero, -z * cos_x, -z * sin_x, -one], axis=-1)
        return np.stack([off, out], axis=1)
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    lean = [-(z * c * cos_x + s * x), -(z * c * sin_x + s * y)]
    columns = [-c * cos_x, -c * sin_x, *lean, -c * one]
    if shape is Shape.CONE:
        columns.append(-(away - radius_m) * s - z * c)
    return np.stack(columns, axis=-1)[:, None]


def normals(shape: Shape, points: Floats, angle_rad: float) -> Floats:
    """The directions (n, rows, 3) in which the distances of points (n, 3) grow, unit vectors."""
    x, y, _ = points.T
    zero, one = np.zeros_like(x), np.ones_like(x)
    up = np.stack([zero, zero, one], axis=-1)
    if shape is Shape.PLANE:
        return up[:, None]
    if shape is Shape.SPHERE:
        from_centre: Floats = points / np.maximum(np.linalg.norm(points, axis=1), NEAREST_M)[:, None]
        return from_centre[:, None]
    away = np.maximum(np.sqrt(x * x + y * y), NEAREST_M)
    out = np.stack([x / away, y / away, zero], axis=-1)
    if shape is Shape.CIRCLE:
        return np.stack([up, out], axis=1)
    found: Floats = np.cos(angle_rad) * out - np.sin(angle_rad) * up
    return found[:, None]
