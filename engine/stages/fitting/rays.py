"""How far measured points lie beyond a shape along their beams, and where each beam meets the shape.

A beam tells one number, its range; its direction is taken as known. So the error lies along the beam, and what depends on where the
beam meets the surface (incidence, slopes by parameters) is taken at the model's surface, not at the measured point. At the measured point
it would depend on the error itself, and curved shapes would be biased by terms of the square of the noise.
"""

from dataclasses import dataclass

import numpy as np

from engine.model.fits import Shape
from engine.model.geometry import Floats, Truths
from engine.stages.fitting.distances import distances, normals

GRAZING = 0.05  # cosine: along a beam flatter than this the range means little
STEPS = 4  # of Newton, along a beam
MET_M = 1e-8  # from the surface: the beam has met it


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
    """Where beams (n, 3), unit vectors, through measured points (n, 3) meet a shape with one row of distances, in its own frame."""
    first = behind = _step(shape, points, beams, radius_m, angle_rad)
    for _ in range(STEPS - 1):
        behind = behind + _step(shape, points - beams * behind[:, None], beams, radius_m, angle_rad)
    feet = points - beams * behind[:, None]
    facing = _facing(shape, feet, beams, angle_rad)
    left = np.abs(_off(shape, feet, radius_m, angle_rad))
    hit = (left <= MET_M) & (np.abs(facing) >= GRAZING)
    flat = _steep(_facing(shape, points, beams, angle_rad))
    return Met(
        np.where(hit[:, None], feet, points), np.where(hit, behind, first), np.where(hit, facing, flat), hit
    )


def _step(shape: Shape, points: Floats, beams: Floats, radius_m: float, angle_rad: float) -> Floats:
    """How far (n,) points lie behind the tangent plane beside them, along their beams."""
    found: Floats = _off(shape, points, radius_m, angle_rad) / _steep(
        _facing(shape, points, beams, angle_rad)
    )
    return found


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
