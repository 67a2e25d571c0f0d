"""Gaps between simple volumes: balls, blocks, points and segments. They decide most pairs without any iteration."""

import numpy as np

from engine.kernels.arrays import Floats
from engine.kernels.geometry import compiled, inlined
from engine.kernels.geometry.layout import AXES, BALL, BALL_ITSELF, BLOCK_ITSELF, HALF, KIND, RADIUS

APART, TOUCHING, UNDECIDED = 0, 1, 2


@inlined
def place_bounds(T: Floats, own: Floats, i: int, placed: Floats) -> None:
    """Row `i` of bounds (n, 18), given in a carrier at T (3, 4), as a row of bounds in the world."""
    for r in range(3):
        placed[i, r] = T[r, 0] * own[i, 0] + T[r, 1] * own[i, 1] + T[r, 2] * own[i, 2] + T[r, 3]
    if own[i, KIND] != BALL_ITSELF:
        for a in range(AXES, HALF, 3):
            x, y, z = own[i, a], own[i, a + 1], own[i, a + 2]
            for r in range(3):
                placed[i, a + r] = T[r, 0] * x + T[r, 1] * y + T[r, 2] * z


@inlined
def block_gap(bounds: Floats, j: int, x: float, y: float, z: float) -> float:
    """How far a point, given from the middle of block `j`, is from it, squared."""
    total = 0.0
    for a in range(3):
        along = (
            bounds[j, AXES + 3 * a] * x + bounds[j, AXES + 1 + 3 * a] * y + bounds[j, AXES + 2 + 3 * a] * z
        )
        beyond = abs(along) - bounds[j, HALF + a]
        if beyond > 0.0:
            total += beyond * beyond
    return total


@inlined
def verdict(bounds: Floats, i: int, j: int, by: float) -> int:
    """What bounds in the world tell of two pieces: APART by more than `by`, TOUCHING (within `by`), or UNDECIDED.

    Of two balls, and of a ball and a block, the bounds are the pieces, so that nothing is left undecided.
    """
    x, y, z = bounds[i, 0] - bounds[j, 0], bounds[i, 1] - bounds[j, 1], bounds[i, 2] - bounds[j, 2]
    reach = bounds[i, BALL] + bounds[j, BALL] + by
    if reach < 0.0 or x * x + y * y + z * z > reach * reach:
        return APART
    one, other = bounds[i, KIND], bounds[j, KIND]
    if one == BALL_ITSELF and other == BALL_ITSELF:
        return TOUCHING
    if other != BALL_ITSELF and _off_block(bounds, i, j, x, y, z, by):
        return APART
    if one != BALL_ITSELF and _off_block(bounds, j, i, -x, -y, -z, by):
        return APART
    return TOUCHING if one + other == BALL_ITSELF + BLOCK_ITSELF else UNDECIDED


@inlined
def _off_block(bounds: Floats, i: int, j: int, x: float, y: float, z: float, by: float) -> bool:
    """Whether the ball of `i` is more than `by` from the block of `j`."""
    reach = bounds[i, BALL] + bounds[j, RADIUS] + by
    return bool(block_gap(bounds, j, x, y, z) > reach * reach)


@compiled
def segment_gap(v: Floats, a: int, na: int, b: int, nb: int) -> float:
    """The distance between two points or segments, squared (Ericson 2005, 5.1.9)."""
    ux, uy, uz = v[a + na - 1, 0] - v[a, 0], v[a + na - 1, 1] - v[a, 1], v[a + na - 1, 2] - v[a, 2]
    wx, wy, wz = v[b + nb - 1, 0] - v[b, 0], v[b + nb - 1, 1] - v[b, 1], v[b + nb - 1, 2] - v[b, 2]
    rx, ry, rz = v[a, 0] - v[b, 0], v[a, 1] - v[b, 1], v[a, 2] - v[b, 2]
    uu, ww, uw = ux * ux + uy * uy + uz * uz, wx * wx + wy * wy + wz * wz, ux * wx + uy * wy + uz * wz
    ur, wr = ux * rx + uy * ry + uz * rz, wx * rx + wy * ry + wz * rz
    s = _clamped(uw * wr - ur * ww, uu * ww - uw * uw)
    t = _clamped(uw * s + wr, ww)
    s = _clamped(uw * t - ur, uu)
    x, y, z = rx + s * ux - t * wx, ry + s * uy - t * wy, rz + s * uz - t * wz
    return float(x * x + y * y + z * z)


@compiled
def segment_block_gap(v: Floats, a: int, na: int, bounds: Floats, j: int) -> float:
    """The distance, squared, between a point or segment and the block of row `j` of bounds in the world.

    Along the segment the square is convex and quadratic between the six places where the segment passes a side; the
    slope is followed from place to place until the stretch is found where it changes its sign.
    """
    start, step, half = np.empty(3), np.empty(3), bounds[j, HALF:RADIUS]
    _in_block(v, a, bounds, j, start)
    _in_block(v, a + na - 1, bounds, j, step)
    step -= start
    low, high = 0.0, 1.0
    at_low, at_high = _slope(start, step, half, 0.0), _slope(start, step, half, 1.0)
    if at_low >= 0.0:
        return _square(start, step, half, 0.0)
    if at_high <= 0.0:
        return _square(start, step, half, 1.0)
    for side in range(6):
        axis, sign = side // 2, 1.0 if side % 2 else -1.0
        if step[axis] != 0.0:
            t = (sign * half[axis] - start[axis]) / step[axis]
            if low < t < high:
                slope = _slope(start, step, half, t)
                if slope < 0.0:
                    low, at_low = t, slope
                else:
                    high, at_high = t, slope
    return _square(start, step, half, low - at_low * (high - low) / (at_high - at_low))


@compiled
def _in_block(v: Floats, row: int, bounds: Floats, j: int, out: Floats) -> None:
    """A point in the frame of a block about its middle."""
    x, y, z = v[row, 0] - bounds[j, 0], v[row, 1] - bounds[j, 1], v[row, 2] - bounds[j, 2]
    for c in range(3):
        a = AXES + 3 * c
        out[c] = bounds[j, a] * x + bounds[j, a + 1] * y + bounds[j, a + 2] * z


@compiled
def _beyond(start: Floats, step: Floats, half: Floats, t: float, axis: int) -> float:
    """How far the point at t is outside of the block along an axis, with its sign."""
    x, half = start[axis] + t * step[axis], half[axis]
    return float(x - half if x > half else x + half if x < -half else 0.0)


@compiled
def _slope(start: Floats, step: Floats, half: Floats, t: float) -> float:
    total = 0.0
    for axis in range(3):
        total += step[axis] * _beyond(start, step, half, t, axis)
    return total


@compiled
def _square(start: Floats, step: Floats, half: Floats, t: float) -> float:
    total = 0.0
    for axis in range(3):
        total += _beyond(start, step, half, t, axis) ** 2
    return total


@compiled
def _clamped(above: float, below: float) -> float:
    return min(1.0, max(0.0, above / below)) if below > 1e-14 else 0.0
