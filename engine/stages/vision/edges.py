"""Edges of a range image, and what each is: a step, a roof or a crease; and normals between them.

Planes are fitted to the windows on both sides of each pixel, across the picture and down. Where their ranges differ at the pixel, there
is a step: one surface ends, and another one begins behind it. Where they meet but their normals differ, the surface turns: a roof is
convex, a crease is concave. A smooth curve turns as much beside a pixel as at it, so it is no edge.
"""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from cellwright.engine.model.geometry import Floats, Longs, Truths
from cellwright.engine.model.ranging import EdgeKind, Edges, RangeImage
from cellwright.engine.stages.vision.slopes import Planes, inverse_depths, planes_beside

REACH, BESIDE = 4, 2  # pixels of a window: away from the edge, and along it on either side
STEP, TURN = 6.0, 5.0  # standard deviations
LEAST_TURN = np.radians(6.0)
STANDS_OUT = 0.5  # a turn must be so much larger, in its own measure, than those beside it
MEET_PX = 1.5  # two planes that meet so near to a pixel are no step there
FULL = 0.7  # of a window: so much of it must have answers for the surface to be there


@dataclass(frozen=True, slots=True, eq=False)
class _Sides:
    """What differs (h, w) across an edge along one axis: the jump and the turn, each also by its standard deviation.

    `meet` says where the two planes meet at the pixel, `ends` where the surface ends before nothing.
    """

    jump_m: Floats
    jump_by: Floats
    meet: Truths
    turn_rad: Floats
    turn_by: Floats
    convex: Truths
    ends: Truths


def edges_of(image: RangeImage) -> Edges:
    """The edges of an image with whole ranges, and the normals."""
    inverse, noise = inverse_depths(image)
    shape = inverse.shape
    kind, jump, turn = np.zeros(shape, np.int64), np.zeros(shape), np.zeros(shape)
    for axis in (0, 1):
        sides = _sides(image, inverse, noise, axis)
        own = _kinds(sides, axis)
        better = (own == EdgeKind.STEP) & (kind != EdgeKind.STEP) | (own > 0) & (kind == 0)
        better |= (own == kind) & (own > EdgeKind.STEP) & (sides.turn_rad > turn)
        kind = np.where(better, own, kind)
        jump, turn = np.where(better, sides.jump_m, jump), np.where(better, sides.turn_rad, turn)
    near = ndimage.binary_dilation(kind == EdgeKind.STEP, np.ones((2 * REACH + 1,) * 2))
    kind = _lasting(np.where(near & (kind > EdgeKind.STEP), 0, kind))
    around = planes_beside(inverse, (-BESIDE, BESIDE), (-BESIDE, BESIDE))
    return Edges(kind, jump, turn, around.normals(image.camera))


def _sides(image: RangeImage, inverse: Floats, noise: Floats, axis: int) -> _Sides:
    windows = (((-REACH, -1), (-BESIDE, BESIDE)), ((1, REACH), (-BESIDE, BESIDE)))
    before, after = (planes_beside(inverse, *(window if axis == 1 else window[::-1])) for window in windows)
    both = before.known & after.known
    least = np.maximum(before.value[..., 0], after.value[..., 0])
    safe = np.where(both, least, 1.0)
    spread = ndimage.maximum_filter(noise, 3)
    spread = np.where(spread > 0, spread, 1.0)
    apart = before.value - after.value
    covariance = (before.covariance + after.covariance) * spread[..., None, None] ** 2
    jump_by = np.where(both, np.abs(apart[..., 0]) / np.sqrt(covariance[..., 0, 0]), 0.0)
    slope = apart[..., 1:]
    meet = np.abs(apart[..., 0]) <= MEET_PX * np.abs(apart[..., 2 - axis])
    solved = np.linalg.solve(covariance[..., 1:, 1:], slope[..., None])[..., 0]
    turn_by = np.where(both, np.sqrt(np.maximum((slope * solved).sum(axis=-1), 0.0)), 0.0)
    one, other = before.normals(image.camera), after.normals(image.camera)
    sine, cosine = np.linalg.norm(np.cross(one, other), axis=-1), (one * other).sum(axis=-1)
    turn = np.where(both, np.arctan2(sine, cosine), 0.0)
    convex = np.where(both, (other - one)[..., 1 - axis], 0.0) > 0
    jump = np.where(both, np.abs(apart[..., 0]) / safe**2 / image.beams[..., 2], 0.0)
    return _Sides(jump, jump_by, meet, turn, turn_by, convex, _ends(inverse, before, after, axis))


def _ends(inverse: Floats, before: Planes, after: Planes, axis: int) -> Truths:
    """Where a surface is on one side (h, w), and nothing answers on the other: the last pixel of it."""
    known = (inverse > 0).astype(float)
    found = np.zeros(inverse.shape, dtype=bool)
    for side, towards in ((before, 1), (after, -1)):
        found |= side.known & (_filled(known, axis, -towards) > FULL) & (_filled(known, axis, towards) == 0.0)
    return found & (inverse > 0)


def _filled(known: Floats, axis: int, towards: int) -> Floats:
    """The share (h, w) of the window beside each pixel that has answers; what lies beyond the picture counts as if it had."""
    steps = np.arange(-REACH, REACH + 1) * towards
    weights = ((steps >= 1) & (steps <= REACH)) / REACH
    along = ndimage.correlate1d(known, weights, axis=axis, mode="constant", cval=1.0)
    found: Floats = ndimage.uniform_filter1d(along, 2 * BESIDE + 1, axis=1 - axis, mode="nearest")
    return np.where(found < 1e-9, 0.0, found)


def _kinds(sides: _Sides, axis: int) -> Longs:
    """The kind of edge (h, w) that each pixel is on along an axis: where the difference is greatest."""
    apart = (sides.jump_by > STEP) & ~sides.meet
    step = apart & _greatest(sides.jump_m, axis, REACH)
    # Beside a step one window already reaches across it: its range differs less there, but its slope more.
    beside = np.maximum(_shifted(sides.turn_rad, REACH + 1, axis), _shifted(sides.turn_rad, -REACH - 1, axis))
    stands_out = sides.turn_rad - beside > STANDS_OUT * sides.turn_rad
    turn = (sides.turn_by > TURN) & (sides.turn_rad > LEAST_TURN) & stands_out
    turn &= _greatest(sides.turn_rad, axis, REACH // 2) & ~apart
    kinds = np.where(sides.convex, int(EdgeKind.ROOF), int(EdgeKind.CREASE))
    found: Longs = np.where(step | sides.ends, int(EdgeKind.STEP), np.where(turn, kinds, 0))
    return found


def _greatest(each: Floats, axis: int, beside: int) -> Truths:
    """Where no value that is at most `beside` pixels away along an axis is greater."""
    found: Truths = each >= ndimage.maximum_filter1d(each, 2 * beside + 1, axis=axis)
    return found


def _shifted(each: Floats, by: int, axis: int) -> Floats:
    found: Floats = np.take(each, np.clip(np.arange(each.shape[axis]) + by, 0, each.shape[axis] - 1), axis)
    return found


def _lasting(kind: Longs) -> Longs:
    """The edges without single pixels, which noise makes."""
    kept = np.zeros_like(kind)
    for each in (EdgeKind.STEP, EdgeKind.ROOF, EdgeKind.CREASE):
        near = ndimage.convolve((kind == each).astype(int), np.ones((3, 3), int), mode="constant")
        kept = np.where((kind == each) & (near >= 3), int(each), kept)
    return kept
