"""Edges of a range image (step, roof, crease), by planes fitted through small windows.

On a plane the inverse depth is linear in the picture, whichever way the plane leans. Least squares
over a window beside a pixel tell the inverse depth and its slopes at the pixel itself, and how sure
they are.
"""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from cellwright.engine.kernels.arrays import Floats, Longs, Truths
from cellwright.engine.model.vision import DepthCamera, EdgeImage, EdgeKind, RangeImage

MIN_WINDOW_ANSWERS = 5  # answers in a window: fewer tell no plane
MIN_INCIDENCE_COSINE = 0.1  # cosine: of a surface seen flatter, the lean is not known well
SLOPE_PX = 3  # pixels on either side that tell how a surface leans
ACROSS, ALONG = 0, 1  # axes of the picture: rows follow each other down, columns to the right


@dataclass(frozen=True, slots=True, eq=False)
class WindowPlanes:
    """Inverse depth and its slopes to the right and down (h, w, 3), their covariance (h, w, 3,
    3) for a noise of 1, and where known.
    """

    value: Floats
    covariance: Floats
    known: Truths

    def normals(self, camera: DepthCamera) -> Floats:
        """The normals (h, w, 3) of the planes towards the eye; NaN where there is none."""
        v, u = np.mgrid[: camera.height, : camera.width].astype(float)
        w, right, down = np.moveaxis(self.value, -1, 0)
        (cx, cy), f = camera.centre_px, camera.focal_px
        normal = np.stack([right * f, down * f, w - right * (u - cx) - down * (v - cy)], axis=-1)
        length = np.linalg.norm(normal, axis=-1, keepdims=True)
        normals: Floats = np.where(
            self.known[..., None], -normal / np.where(length > 0, length, 1.0), np.nan
        )
        return normals


def inverse_depths(image: RangeImage) -> tuple[Floats, Floats]:
    """The inverse depth (h, w) of each pixel, 0 without an answer, and the noise (h, w) of it."""
    answered = image.range_m > 0
    axial = image.beams[..., 2]
    inverse = np.where(answered, 1.0 / np.where(answered, image.range_m * axial, 1.0), 0.0)
    noise = np.where(answered, image.noise_m, 0.0) * axial * inverse**2
    return inverse, noise


def incidence_cosines(image: RangeImage) -> Floats:
    """The cosine (h, w) of the incidence of each beam, by the pixels around; 1 where that is
    not known.
    """
    inverse, _ = inverse_depths(image)
    planes = planes_beside(inverse, (-SLOPE_PX, SLOPE_PX), (-SLOPE_PX, SLOPE_PX))
    cosine = np.abs((planes.normals(image.camera) * image.beams).sum(axis=-1))
    cosines_entry: Floats = np.clip(
        np.where(np.isfinite(cosine), cosine, 1.0), MIN_INCIDENCE_COSINE, 1.0
    )
    return cosines_entry


def planes_beside(inverse: Floats, right: tuple[int, int], down: tuple[int, int]) -> WindowPlanes:
    """The planes through the pixels that are right[0] to right[1] columns to the right of each,
    and down[0] to down[1] rows down.
    """
    answered = (inverse > 0).astype(float)
    powers = [(p, q) for p in range(3) for q in range(3 - p)]
    sums = {key: _window_sums(answered, right, down, *key) for key in powers}
    values = [_window_sums(inverse, right, down, *key) for key in ((0, 0), (1, 0), (0, 1))]
    basis = ((0, 0), (1, 0), (0, 1))
    normal = np.stack(
        [np.stack([sums[a + c, b + d] for c, d in basis], axis=-1) for a, b in basis], axis=-2
    )
    scale = np.array([1.0, *(max(1.0, max(map(abs, offsets))) for offsets in (right, down))])
    scaled = normal / np.outer(scale, scale)
    enough = (sums[0, 0] >= MIN_WINDOW_ANSWERS) & (np.linalg.det(scaled) > 1e-3)
    scaled = np.where(enough[..., None, None], scaled, np.eye(3))
    covariance = np.linalg.inv(scaled) / np.outer(scale, scale)
    value = (covariance @ np.stack(values, axis=-1)[..., None])[..., 0]
    return WindowPlanes(value, covariance, enough & (value[..., 0] > 0))


def _window_sums(
    values: Floats, right: tuple[int, int], down: tuple[int, int], p: int, q: int
) -> Floats:
    """The sums (h, w), over a window beside each pixel, of values times powers of the steps to
    the right and down.
    """
    sums = values
    for (first, last), power, axis in ((right, p, ALONG), (down, q, ACROSS)):
        reach = max(abs(first), abs(last))
        steps = np.arange(-reach, reach + 1)
        weights = np.where((steps >= first) & (steps <= last), steps.astype(float) ** power, 0.0)
        sums = ndimage.correlate1d(sums, weights, axis=axis, mode="constant")
    return sums


WINDOW_REACH_PX, WINDOW_BESIDE_PX = (
    4,
    2,
)  # pixels of a window: away from the edge, and along it on either side
STEP_EDGE_SIGMAS, TURN_EDGE_SIGMAS = 6.0, 5.0  # standard deviations
LEAST_TURN = np.radians(6.0)
STANDS_OUT = 0.5  # a turn must be so much larger, in its own measure, than those beside it
MEET_PX = 1.5  # two planes that meet so near to a pixel are no step there
FULL_WINDOW_SHARE = 0.7  # of a window: so much of it must have answers for the surface to be there


@dataclass(frozen=True, slots=True, eq=False)
class _EdgeSides:
    """What differs (h, w) across an edge along one axis: the jump and the turn, each also by its
    standard deviation.

    `meet` says where the two planes meet at the pixel, `ends` where the surface ends before
    nothing.
    """

    jump_m: Floats
    jump_by: Floats
    meet: Truths
    turn_rad: Floats
    turn_by: Floats
    convex: Truths
    ends: Truths


def find_edges(image: RangeImage) -> EdgeImage:
    """The edges of an image with whole ranges, and the normals."""
    inverse, noise = inverse_depths(image)
    shape = inverse.shape
    kind, jump, turn = np.zeros(shape, np.int64), np.zeros(shape), np.zeros(shape)
    for axis in (0, 1):
        sides = _compare_sides(image, inverse, noise, axis)
        own = _edge_kinds(sides, axis)
        better = (own == EdgeKind.STEP) & (kind != EdgeKind.STEP) | (own > 0) & (kind == 0)
        better |= (own == kind) & (own > EdgeKind.STEP) & (sides.turn_rad > turn)
        kind = np.where(better, own, kind)
        jump, turn = np.where(better, sides.jump_m, jump), np.where(better, sides.turn_rad, turn)
    near = ndimage.binary_dilation(kind == EdgeKind.STEP, np.ones((2 * WINDOW_REACH_PX + 1,) * 2))
    kind = _drop_single_pixels(np.where(near & (kind > EdgeKind.STEP), 0, kind))
    around = planes_beside(
        inverse, (-WINDOW_BESIDE_PX, WINDOW_BESIDE_PX), (-WINDOW_BESIDE_PX, WINDOW_BESIDE_PX)
    )
    return EdgeImage(kind, jump, turn, around.normals(image.camera))


def _compare_sides(image: RangeImage, inverse: Floats, noise: Floats, axis: int) -> _EdgeSides:
    windows = (
        ((-WINDOW_REACH_PX, -1), (-WINDOW_BESIDE_PX, WINDOW_BESIDE_PX)),
        ((1, WINDOW_REACH_PX), (-WINDOW_BESIDE_PX, WINDOW_BESIDE_PX)),
    )
    before, after = (
        planes_beside(inverse, *(window if axis == 1 else window[::-1])) for window in windows
    )
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
    normals_before, normals_after = before.normals(image.camera), after.normals(image.camera)
    sine, cosine = (
        np.linalg.norm(np.cross(normals_before, normals_after), axis=-1),
        (normals_before * normals_after).sum(axis=-1),
    )
    turn = np.where(both, np.arctan2(sine, cosine), 0.0)
    convex = np.where(both, (normals_after - normals_before)[..., 1 - axis], 0.0) > 0
    jump = np.where(both, np.abs(apart[..., 0]) / safe**2 / image.beams[..., 2], 0.0)
    return _EdgeSides(
        jump, jump_by, meet, turn, turn_by, convex, _surface_ends(inverse, before, after, axis)
    )


def _surface_ends(inverse: Floats, before: WindowPlanes, after: WindowPlanes, axis: int) -> Truths:
    """Where a surface is on one side (h, w), and nothing answers on the other: the last pixel
    of it.
    """
    answered = (inverse > 0).astype(float)
    ends = np.zeros(inverse.shape, dtype=bool)
    for side, towards in ((before, 1), (after, -1)):
        ends |= (
            side.known
            & (_answer_share(answered, axis, -towards) > FULL_WINDOW_SHARE)
            & (_answer_share(answered, axis, towards) == 0.0)
        )
    return ends & (inverse > 0)


def _answer_share(known: Floats, axis: int, towards: int) -> Floats:
    """The share (h, w) of the window beside each pixel that has answers; what lies beyond the
    picture counts as if it had.
    """
    steps = np.arange(-WINDOW_REACH_PX, WINDOW_REACH_PX + 1) * towards
    weights = ((steps >= 1) & (steps <= WINDOW_REACH_PX)) / WINDOW_REACH_PX
    along = ndimage.correlate1d(known, weights, axis=axis, mode="constant", cval=1.0)
    share: Floats = ndimage.uniform_filter1d(
        along, 2 * WINDOW_BESIDE_PX + 1, axis=1 - axis, mode="nearest"
    )
    return np.where(share < 1e-9, 0.0, share)


def _edge_kinds(sides: _EdgeSides, axis: int) -> Longs:
    """The kind of edge (h, w) that each pixel is on along an axis: where the difference is
    greatest.
    """
    apart = (sides.jump_by > STEP_EDGE_SIGMAS) & ~sides.meet
    step = apart & _is_greatest(sides.jump_m, axis, WINDOW_REACH_PX)
    # Beside a step one window already reaches across it: its range differs less there, but its
    # slope more.
    beside = np.maximum(
        _shift_pixels(sides.turn_rad, WINDOW_REACH_PX + 1, axis),
        _shift_pixels(sides.turn_rad, -WINDOW_REACH_PX - 1, axis),
    )
    stands_out = sides.turn_rad - beside > STANDS_OUT * sides.turn_rad
    turn = (sides.turn_by > TURN_EDGE_SIGMAS) & (sides.turn_rad > LEAST_TURN) & stands_out
    turn &= _is_greatest(sides.turn_rad, axis, WINDOW_REACH_PX // 2) & ~apart
    kinds = np.where(sides.convex, int(EdgeKind.ROOF), int(EdgeKind.CREASE))
    edge_kinds: Longs = np.where(step | sides.ends, int(EdgeKind.STEP), np.where(turn, kinds, 0))
    return edge_kinds


def _is_greatest(values: Floats, axis: int, beside: int) -> Truths:
    """Where no value that is at most `beside` pixels away along an axis is greater."""
    is_peak: Truths = values >= ndimage.maximum_filter1d(values, 2 * beside + 1, axis=axis)
    return is_peak


def _shift_pixels(values: Floats, by: int, axis: int) -> Floats:
    shifted_values: Floats = np.take(
        values, np.clip(np.arange(values.shape[axis]) + by, 0, values.shape[axis] - 1), axis
    )
    return shifted_values


def _drop_single_pixels(kind: Longs) -> Longs:
    """The edges without single pixels, which noise makes."""
    lasting = np.zeros_like(kind)
    for edge_kind in (EdgeKind.STEP, EdgeKind.ROOF, EdgeKind.CREASE):
        near = ndimage.convolve(
            (kind == edge_kind).astype(int), np.ones((3, 3), int), mode="constant"
        )
        lasting = np.where((kind == edge_kind) & (near >= 3), int(edge_kind), lasting)
    return lasting
