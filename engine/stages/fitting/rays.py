"""How far measured points lie beyond a shape along their beams, and where each beam meets the shape.

A beam tells one number, its range; its direction is taken as known. So the error lies along the beam, and what depends on where the
beam meets the surface (incidence, slopes by parameters) is taken at the model's surface, not at the measured point. At the measured point
it would depend on the error itself, and curved shapes would be biased by terms of the square of the noise.
"""

from dataclasses import dataclass

import numpy as np

from cellwright.engine.model.fits import Shape
from cellwright.engine.model.geometry import Floats, Truths
from cellwright.engine.stages.fitting.distances import distances, normals

GRAZING = 0.05  # cosine: along a beam flatter than this the range means little


@dataclass(frozen=True, slots=True, eq=False)
class Met:
    """Where beams meet a shape: feet (n, 3), how far the measured points lie behind them (n,), cosines (n,) with the normals.

    A cosine is negative where a beam comes from outside. A beam that misses the shape, or meets it flatter than `GRAZING` (not `hit`),
    has its measured point as its foot; the distance along it is the one to the tangent plane.
    """

    feet: Floats
    behind_m: Floats
    facing: Floats
    hit: Truths


def met(shape: Shape, points: Floats, beams: Floats, radius_m: float, angle_rad: float) -> Met:
    """Where beams (n, 3), unit vectors, through measured points (n, 3) meet a shape with one row of distances, in its own frame.

    Of two places it is the one that is nearer to the measured point.
    """
    half, middle, free = _quadratic(shape, points, beams, radius_m, angle_rad)
    under = middle * middle - half * free
    meets = under >= 0.0
    divisor = middle + np.copysign(np.sqrt(np.where(meets, under, 0.0)), middle)
    behind = free / np.where(divisor == 0.0, np.inf, divisor)
    feet = points - beams * behind[:, None]
    facing = _facing(shape, feet, beams, angle_rad)
    hit = meets & (np.abs(facing) >= GRAZING)
    if shape is Shape.CONE:
        hit &= radius_m + feet[:, 2] * np.tan(angle_rad) > 0.0
    if not hit.all():
        flat = _steep(_facing(shape, points, beams, angle_rad))
        behind = np.where(hit, behind, _off(shape, points, radius_m, angle_rad) / flat)
        feet, facing = np.where(hit[:, None], feet, points), np.where(hit, facing, flat)
    return Met(feet, behind, facing, hit)


def _quadratic(
    shape: Shape, points: Floats, beams: Floats, radius_m: float, angle_rad: float
) -> tuple[Floats, Floats, Floats]:
    """a, b, c (n,) of a s^2 - 2 b s + c = 0, whose s is how far the points lie behind a shape along their beams."""
    if shape is Shape.PLANE:
        return np.zeros(len(points)), 0.5 * beams[:, 2], points[:, 2]
    # The surface is x^2 + y^2 + up z^2 = radius^2 + 2 wider z.
    slope = float(np.tan(angle_rad)) if shape is Shape.CONE else 0.0
    up = {Shape.SPHERE: 1.0, Shape.CYLINDER: 0.0, Shape.CONE: -slope * slope}[shape]
    wider = radius_m * slope
    (x, y, z), (dx, dy, dz) = points.T, beams.T
    half = dx * dx + dy * dy + up * dz * dz
    middle = x * dx + y * dy + up * z * dz - wider * dz
    free = x * x + y * y + up * z * z - radius_m * radius_m - 2.0 * wider * z
    return half, middle, free


def _steep(facing: Floats) -> Floats:
    found: Floats = np.where(np.abs(facing) < GRAZING, np.copysign(GRAZING, facing), facing)
    return found


def _off(shape: Shape, points: Floats, radius_m: float, angle_rad: float) -> Floats:
    found: Floats = distances(shape, points, np.asarray(radius_m), np.asarray(angle_rad))[:, 0]
    return found


def _facing(shape: Shape, points: Floats, beams: Floats, angle_rad: float) -> Floats:
    """The cosines (n,) between beams and the normals at points."""
    found: Floats = (normals(shape, points, angle_rad)[:, 0] * beams).sum(axis=1)
    return found
