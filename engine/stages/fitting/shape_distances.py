"""Distances of points from a shape, square to it or along beams, with their derivatives.

Everything is in the frame of the shape: z is the normal or the axis. A slope (a, b) leans the z
axis by a towards x and by b towards y. Signs: above a plane, outside a sphere, cylinder, cone or
circle is positive.
"""

from dataclasses import dataclass

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Truths
from cellwright.engine.model.shape_fits import FitShape

MIN_AXIS_DISTANCE_M = 1e-12  # to an axis: there no direction away from it is known


def shape_distances(shape: FitShape, points: Floats, radius_m: Floats, angle_rad: Floats) -> Floats:
    """Signed distances (..., n, rows) of points (..., n, 3); a circle has two rows: off its plane,
    and off its line.

    `radius_m` and `angle_rad` (...) are those of as many shapes.
    """
    x, y, z = (points[..., axis] for axis in range(3))
    radius, angle = radius_m[..., None], angle_rad[..., None]
    if shape is FitShape.PLANE:
        return z[..., None]
    if shape is FitShape.SPHERE:
        return (np.sqrt(x * x + y * y + z * z) - radius)[..., None]
    out = np.sqrt(x * x + y * y) - radius
    if shape is FitShape.CIRCLE:
        return np.stack([z, out], axis=-1)
    return (out * np.cos(angle) - z * np.sin(angle))[..., None]


def distance_slopes(shape: FitShape, points: Floats, radius_m: float, angle_rad: float) -> Floats:
    """The derivatives (n, rows, p) of the distances of points (n, 3) by the shape's parameters."""
    x, y, z = points.T
    zero, unit = np.zeros_like(x), np.ones_like(x)
    if shape is FitShape.PLANE:
        return np.stack([-unit, x, y], axis=-1)[:, None]
    if shape is FitShape.SPHERE:
        length = np.maximum(np.sqrt(x * x + y * y + z * z), MIN_AXIS_DISTANCE_M)
        return np.stack([-x / length, -y / length, -z / length, -unit], axis=-1)[:, None]
    away = np.maximum(np.sqrt(x * x + y * y), MIN_AXIS_DISTANCE_M)
    cos_x, sin_x = x / away, y / away
    if shape is FitShape.CIRCLE:
        off = np.stack([zero, zero, -unit, x, y, zero], axis=-1)
        out = np.stack([-cos_x, -sin_x, zero, -z * cos_x, -z * sin_x, -unit], axis=-1)
        return np.stack([off, out], axis=1)
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    lean = [-(z * c * cos_x + s * x), -(z * c * sin_x + s * y)]
    columns = [-c * cos_x, -c * sin_x, *lean, -c * unit]
    if shape is FitShape.CONE:
        columns.append(-(away - radius_m) * s - z * c)
    return np.stack(columns, axis=-1)[:, None]


def distance_normals(shape: FitShape, points: Floats, angle_rad: float) -> Floats:
    """The directions (n, rows, 3) in which the distances of points (n, 3) grow, unit vectors."""
    x, y, _ = points.T
    zero, unit = np.zeros_like(x), np.ones_like(x)
    up = np.stack([zero, zero, unit], axis=-1)
    if shape is FitShape.PLANE:
        return up[:, None]
    if shape is FitShape.SPHERE:
        from_centre: Floats = (
            points / np.maximum(np.linalg.norm(points, axis=1), MIN_AXIS_DISTANCE_M)[:, None]
        )
        return from_centre[:, None]
    away = np.maximum(np.sqrt(x * x + y * y), MIN_AXIS_DISTANCE_M)
    out = np.stack([x / away, y / away, zero], axis=-1)
    if shape is FitShape.CIRCLE:
        return np.stack([up, out], axis=1)
    slanted: Floats = np.cos(angle_rad) * out - np.sin(angle_rad) * up
    return slanted[:, None]


GRAZING_COSINE = 0.05  # cosine: along a beam flatter than this the range means little


@dataclass(frozen=True, slots=True, eq=False)
class BeamHits:
    """Where beams meet a shape: feet (n, 3), how far the measured points lie behind them (n,),
    cosines (n,) with the normals.

    A cosine is negative where a beam comes from outside. A beam that misses the shape, or meets it
    flatter than `GRAZING` (not `hit`), has its measured point as its foot; the distance along it is
    the one to the tangent plane.
    """

    feet: Floats
    behind_m: Floats
    facing: Floats
    hit: Truths


def beam_hits(
    shape: FitShape, points: Floats, beams: Floats, radius_m: float, angle_rad: float
) -> BeamHits:
    """Where beams (n, 3), unit vectors, through measured points (n, 3) meet a shape with one row of
    distances, in its own frame.

    Of two places it is the one that is nearer to the measured point.
    """
    half, middle, free = _beam_quadratic(shape, points, beams, radius_m, angle_rad)
    under = middle * middle - half * free
    meets = under >= 0.0
    divisor = middle + np.copysign(np.sqrt(np.where(meets, under, 0.0)), middle)
    behind = free / np.where(divisor == 0.0, np.inf, divisor)
    feet = points - beams * behind[:, None]
    facing = _incidence_cosines(shape, feet, beams, angle_rad)
    hit = meets & (np.abs(facing) >= GRAZING_COSINE)
    if shape is FitShape.CONE:
        hit &= radius_m + feet[:, 2] * np.tan(angle_rad) > 0.0
    if not hit.all():
        flat = _limit_cosine(_incidence_cosines(shape, points, beams, angle_rad))
        behind = np.where(hit, behind, _distance_off(shape, points, radius_m, angle_rad) / flat)
        feet, facing = np.where(hit[:, None], feet, points), np.where(hit, facing, flat)
    return BeamHits(feet, behind, facing, hit)


def _beam_quadratic(
    shape: FitShape, points: Floats, beams: Floats, radius_m: float, angle_rad: float
) -> tuple[Floats, Floats, Floats]:
    """a, b, c (n,) of a s^2 - 2 b s + c = 0, whose s is how far the points lie behind a shape
    along their beams.
    """
    if shape is FitShape.PLANE:
        return np.zeros(len(points)), 0.5 * beams[:, 2], points[:, 2]
    # The surface is x^2 + y^2 + up z^2 = radius^2 + 2 wider z.
    slope = float(np.tan(angle_rad)) if shape is FitShape.CONE else 0.0
    up = {FitShape.SPHERE: 1.0, FitShape.CYLINDER: 0.0, FitShape.CONE: -slope * slope}[shape]
    wider = radius_m * slope
    (x, y, z), (dx, dy, dz) = points.T, beams.T
    half = dx * dx + dy * dy + up * dz * dz
    middle = x * dx + y * dy + up * z * dz - wider * dz
    free = x * x + y * y + up * z * z - radius_m * radius_m - 2.0 * wider * z
    return half, middle, free


def _limit_cosine(facing: Floats) -> Floats:
    limited: Floats = np.where(
        np.abs(facing) < GRAZING_COSINE, np.copysign(GRAZING_COSINE, facing), facing
    )
    return limited


def _distance_off(shape: FitShape, points: Floats, radius_m: float, angle_rad: float) -> Floats:
    distances_off: Floats = shape_distances(
        shape, points, np.asarray(radius_m), np.asarray(angle_rad)
    )[:, 0]
    return distances_off


def _incidence_cosines(shape: FitShape, points: Floats, beams: Floats, angle_rad: float) -> Floats:
    """The cosines (n,) between beams and the normals at points."""
    cosines: Floats = (distance_normals(shape, points, angle_rad)[:, 0] * beams).sum(axis=1)
    return cosines
