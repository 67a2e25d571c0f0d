"""What the width of a beam does to ranges on a curved surface, and points without it.

A beam of some width tells the mean of the ranges that it meets, by the strength of what each part returns. To second order this is off by
the variance of the beam times, for two directions across it: half the second derivative of the range, and the slope of the range times
the relative slope of the strength, which is that of the cosine of the incidence. A beam that points a little beside its direction tells,
in the mean, a range that is off by the first of these terms, too.
"""

from dataclasses import replace

import numpy as np

from engine.kernels.rigid import apply, inverse
from engine.model.fits import Cloud, Shape
from engine.model.geometry import Floats, Truths
from engine.stages.fitting.distances import distances, normals
from engine.stages.fitting.rays import met
from engine.stages.fitting.starts import Guess

TURNING = 0.05  # by this share the cosine of the incidence may change over a beam; with more, the second order is not enough
PLAIN = (Shape.PLANE, Shape.CIRCLE)


def narrowed(shape: Shape, cloud: Cloud, at: Guess) -> tuple[Cloud, Truths]:
    """The cloud as thin beams would have told it, for points on a shape near `at`, and the points (n,) for which that is known.

    The cloud is the same without beams, or on a plane. Which points are known follows from the directions of their beams, not from their
    ranges, so leaving the others out does not bias a fit.
    """
    if cloud.directions is None or cloud.beam_m is None or shape in PLAIN:
        return cloud, np.ones(len(cloud.points), bool)
    beams = cloud.directions @ at.T[:3, :3]
    there = met(shape, apply(inverse(at.T), cloud.points), beams, float(at.radius_m), float(at.angle_rad))
    points, facing = there.feet, there.facing
    outward = normals(shape, points, float(at.angle_rad))[:, 0]
    wide_m = cloud.beam_m if cloud.pointing_m is None else np.hypot(cloud.beam_m, cloud.pointing_m)
    longer, turned, here = np.zeros(len(points)), np.zeros(len(points)), _off(shape, points, at)
    for across in _across(beams):
        lean = -(across * outward).sum(axis=1) / facing
        step = across + beams * lean[:, None]
        by = cloud.beam_m[:, None] * step
        stronger = (_facing(shape, points + by, at, beams) - _facing(shape, points - by, at, beams)) / 2.0
        by = wide_m[:, None] * step
        bulge = (_off(shape, points + by, at) + _off(shape, points - by, at)) / 2.0 - here
        longer += (cloud.beam_m * lean * stronger - bulge) / facing
        turned += (stronger * wide_m / cloud.beam_m / facing) ** 2
    known = there.hit & (np.sqrt(turned) <= TURNING)
    return replace(cloud, points=cloud.points - cloud.directions * longer[:, None]), known


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
