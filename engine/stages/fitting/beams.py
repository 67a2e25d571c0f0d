"""What the width of a beam does to ranges on a surface, and points without it.

A beam of some width tells the mean of the ranges that it meets, by the strength of what each part returns: the cosine of the incidence over
the square of the range. A beam that points a little beside its direction tells, in the mean over many, a range that is off as well, but for
the strength. Both means are taken over seven beams each, by a rule that is exact to the fifth order for a normal distribution
(Abramowitz & Stegun 1964, 25.4.61; Stroud 1971). On a leaning plane they are off, too, because beams spread.
"""

from dataclasses import dataclass, replace

import numpy as np

from cellwright.engine.kernels.rigid import apply, inverse
from cellwright.engine.model.fits import Cloud, Shape
from cellwright.engine.model.geometry import Floats, Truths
from cellwright.engine.stages.fitting.rays import Met, met
from cellwright.engine.stages.fitting.starts import Guess

TURNING = 0.05  # by this share the cosine of the incidence may change over a beam; with more, the fifth order is not enough
AROUND = np.pi / 3.0 * np.arange(6)
NODES = np.concatenate([[[0.0, 0.0]], 2.0 * np.stack([np.cos(AROUND), np.sin(AROUND)], axis=1)])
WEIGHTS = np.array([0.5, *[1.0 / 12.0] * 6])


@dataclass(frozen=True, slots=True, eq=False)
class _Fan:
    """What beams (7, n) about each direction meet: ranges beyond the middle one's, strengths by the middle one's, and whether all hit (n,).

    `turned` (n,) is by how much, in the mean square, the cosine of the incidence differs from the middle one's.
    """

    longer_m: Floats
    strength: Floats
    turned: Floats
    hit: Truths


def narrowed(shape: Shape, cloud: Cloud, at: Guess) -> tuple[Cloud, Truths]:
    """The cloud as thin beams would have told it, for points on a shape near `at`, and the points (n,) for which that is known.

    The cloud is the same without beams, or for the rim of a hole. Which points are known follows from the directions of their beams, not
    from their ranges, so leaving the others out does not bias a fit.
    """
    if cloud.directions is None or cloud.beam_m is None or shape is Shape.CIRCLE:
        return cloud, np.ones(len(cloud.points), bool)
    beams = cloud.directions @ at.T[:3, :3]
    points = apply(inverse(at.T), cloud.points)
    middle = met(shape, points, beams, float(at.radius_m), float(at.angle_rad))
    own = _fanned(shape, cloud, at, beams, middle, cloud.beam_m)
    wide_m = cloud.beam_m if cloud.pointing_m is None else np.hypot(cloud.beam_m, cloud.pointing_m)
    wide = own if cloud.pointing_m is None else _fanned(shape, cloud, at, beams, middle, wide_m)
    share = WEIGHTS[:, None] * own.strength
    by_strength = (share * own.longer_m).sum(axis=0) / share.sum(axis=0) - WEIGHTS @ own.longer_m
    longer = WEIGHTS @ wide.longer_m + by_strength
    known = middle.hit & own.hit & wide.hit & (wide.turned <= TURNING)
    longer = np.where(known, longer, 0.0)
    return replace(cloud, points=cloud.points - cloud.directions * longer[:, None]), known


def _fanned(shape: Shape, cloud: Cloud, at: Guess, beams: Floats, middle: Met, wide_m: Floats) -> _Fan:
    """Beams about each direction, whose places across it have a standard deviation of `wide_m` (n,) where the shape is met."""
    count = len(beams)
    one, other = _across(beams)
    aside = wide_m[:, None] * (NODES[:, :1, None] * one + NODES[:, 1:, None] * other)
    through = middle.feet + aside
    away = np.full(count, np.inf) if cloud.range_m is None else cloud.range_m - middle.behind_m
    rays = beams + aside / away[:, None]
    length = np.sqrt((rays * rays).sum(axis=-1, keepdims=True))
    rays = rays / length
    there = met(shape, through.reshape(-1, 3), rays.reshape(-1, 3), float(at.radius_m), float(at.angle_rad))
    behind, facing, hit = (
        each.reshape(len(NODES), count) for each in (there.behind_m, there.facing, there.hit)
    )
    # A beam beside the middle one is longer from the eye to the same plane across.
    spread = 0.0 if cloud.range_m is None else away * (length[..., 0] - 1.0)
    longer = spread - behind
    strength = np.maximum(facing / middle.facing, 0.0) / (1.0 + longer / away) ** 2
    turned = np.sqrt(WEIGHTS @ (facing / middle.facing - 1.0) ** 2)
    return _Fan(np.asarray(longer, float), strength, turned, np.asarray(hit.all(axis=0)))


def _across(beams: Floats) -> tuple[Floats, Floats]:
    """Two unit vectors (n, 3) square to each beam and to each other."""
    other = np.eye(3)[np.argmin(np.abs(beams), axis=1)]
    one = np.cross(beams, other)
    one = one / np.linalg.norm(one, axis=1, keepdims=True)
    return one, np.cross(beams, one)
