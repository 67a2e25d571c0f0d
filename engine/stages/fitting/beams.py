"""What the width of a beam does to ranges on a curved surface, and points without it.

A beam of some width tells the mean of the ranges that it meets, by the strength of what each part returns. To second order this is off by
the variance of the beam times, for two directions across it: half the second derivative of the range, and the slope of the range times
the relative slope of the strength, which is that of the cosine of the incidence.
"""

from dataclasses import replace

import numpy as np

from engine.kernels.rigid import apply, inverse
from engine.model.fits import Cloud, Shape
from engine.model.geometry import Floats
from engine.stages.fitting.distances import distances, normals
from engine.stages.fitting.starts import Guess

GRAZING = 0.1  # cosine: of a surface seen flatter, too much of it is met at once
PLAIN = (Shape.PLANE, Shape.CIRCLE)


def narrowed(shape: Shape, cloud: Cloud, at: Guess) -> Cloud:
    """The cloud as a thin beam would have told it, for points on a shape near `at`; the same without beams, or on a plane."""
    if cloud.directions is None or cloud.beam_m is None or shape in PLAIN:
        return cloud
    T = inverse(at.T)
    points, beams = apply(T, cloud.points), cloud.directions @ at.T[:3, :3]
    outward = normals(shape, points, float(at.angle_rad))[:, 0]
    facing = (outward * beams).sum(axis=1)
    facing = np.where(np.abs(facing) < GRAZING, np.copysign(GRAZING, facing), facing)
    longer = np.zeros(len(points))
    here = _off(shape, points, at)
    for across in _across(beams):
        lean = -(across * outward).sum(axis=1) / facing
        step = cloud.beam_m[:, None] * (across + beams * lean[:, None])
        bulge = (_off(shape, points + step, at) + _off(shape, points - step, at)) / 2.0 - here
        stronger = (_facing(shape, points + step, at, beams) - _facing(shape, points - step, at, beams)) / 2.0
        longer += (cloud.beam_m * lean * stronger - bulge) / facing
    moved = cloud.points - cloud.directions * longer[:, None]
    return replace(cloud, points=moved)


def _facing(shape: Shape, points: Floats, at: Guess, beams: Floats) -> Floats:
    """The cosines (n,) between beams and the normals at points."""
    found: Floats = (normals(shape, points, float(at.angle_rad))[:, 0] * beams).sum(axis=1)
    return found


def _off(shape: Shape, points: Floats, at: Guess) -> Floats:
    found: Floats = distances(shape, points, np.asarray(at.radius_m), np.asarray(at.angle_rad))[:, 0]
    return found


def _across(beams: Floats) -> tuple[Floats, Floats]:
    """Two unit vectors (n, 3) square to each beam and to each other."""
    other = np.eye(3)[np.argmin(np.abs(beams), axis=1)]
    one = np.cross(beams, other)
    one = one / np.linalg.norm(one, axis=1, keepdims=True)
    return one, np.cross(beams, one)
