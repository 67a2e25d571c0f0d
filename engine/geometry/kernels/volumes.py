"""Gaps between simple volumes: balls, blocks, points and segments. They decide most pairs without any iteration."""

import math

import numpy as np

from engine.geometry.kernels import compiled
from engine.geometry.packing import Pieces
from engine.model.geometry import Floats


@compiled
def block_gap(pose: Floats, block: Floats, centre: Floats) -> float:
    """How far a point (3,) is from a block (15,: axes as rows 0:9, middle 9:12, half sizes 12:15) in a carrier."""
    x, y, z = centre[0] - pose[0, 3], centre[1] - pose[1, 3], centre[2] - pose[2, 3]
    u = pose[0, 0] * x + pose[1, 0] * y + pose[2, 0] * z - block[9]
    v = pose[0, 1] * x + pose[1, 1] * y + pose[2, 1] * z - block[10]
    w = pose[0, 2] * x + pose[1, 2] * y + pose[2, 2] * z - block[11]
    total = 0.0
    for a in range(3):
        beyond = abs(block[3 * a] * u + block[3 * a + 1] * v + block[3 * a + 2] * w) - block[12 + a]
        if beyond > 0.0:
            total += beyond * beyond
    return math.sqrt(total)


@compiled
def far_apart(pose: Floats, p: Pieces, centres: Floats, i: int, j: int, by: float) -> bool:
    """Whether the bounding volumes of two pieces are more than `by` apart; `centres` (n, 3) of the balls are placed."""
    x, y, z = centres[i, 0] - centres[j, 0], centres[i, 1] - centres[j, 1], centres[i, 2] - centres[j, 2]
    reach = p.ball[i, 3] + p.ball[j, 3] + by
    if reach < 0.0 or x * x + y * y + z * z > reach * reach:
        return True
    if block_gap(pose[p.carrier[j]], p.block[j], centres[i]) > p.ball[i, 3] + p.radius[j] + by:
        return True
    return bool(block_gap(pose[p.carrier[i]], p.block[i], centres[j]) > p.ball[j, 3] + p.radius[i] + by)


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
def segment_block_gap(v: Floats, a: int, na: int, pose: Floats, block: Floats) -> float:
    """The distance, squared, between a point or segment in the world and a block in a carrier.

    Along the segment the square is convex and quadratic between the six places where the segment passes a side; the
    slope is followed from place to place until the stretch is found where it changes its sign.
    """
    start, step = np.empty(3), np.empty(3)
    _in_block(v, a, pose, block, start)
    _in_block(v, a + na - 1, pose, block, step)
    step -= start
    low, high = 0.0, 1.0
    at_low, at_high = _slope(start, step, block, 0.0), _slope(start, step, block, 1.0)
    if at_low >= 0.0:
        return _square(start, step, block, 0.0)
    if at_high <= 0.0:
        return _square(start, step, block, 1.0)
    for side in range(6):
        axis, sign = side // 2, 1.0 if side % 2 else -1.0
        if step[axis] != 0.0:
            t = (sign * block[12 + axis] - start[axis]) / step[axis]
            if low < t < high:
                slope = _slope(start, step, block, t)
                if slope < 0.0:
                    low, at_low = t, slope
                else:
                    high, at_high = t, slope
    return _square(start, step, block, low - at_low * (high - low) / (at_high - at_low))


@compiled
def _in_block(v: Floats, row: int, pose: Floats, block: Floats, out: Floats) -> None:
    """A point in the frame of a block about its middle."""
    x, y, z = v[row, 0] - pose[0, 3], v[row, 1] - pose[1, 3], v[row, 2] - pose[2, 3]
    p = pose[0, 0] * x + pose[1, 0] * y + pose[2, 0] * z - block[9]
    q = pose[0, 1] * x + pose[1, 1] * y + pose[2, 1] * z - block[10]
    r = pose[0, 2] * x + pose[1, 2] * y + pose[2, 2] * z - block[11]
    for c in range(3):
        out[c] = block[3 * c] * p + block[3 * c + 1] * q + block[3 * c + 2] * r


@compiled
def _beyond(start: Floats, step: Floats, block: Floats, t: float, axis: int) -> float:
    """How far the point at t is outside of the block along an axis, with its sign."""
    x, half = start[axis] + t * step[axis], block[12 + axis]
    return float(x - half if x > half else x + half if x < -half else 0.0)


@compiled
def _slope(start: Floats, step: Floats, block: Floats, t: float) -> float:
    total = 0.0
    for axis in range(3):
        total += step[axis] * _beyond(start, step, block, t, axis)
    return total


@compiled
def _square(start: Floats, step: Floats, block: Floats, t: float) -> float:
    total = 0.0
    for axis in range(3):
        total += _beyond(start, step, block, t, axis) ** 2
    return total


@compiled
def _clamped(above: float, below: float) -> float:
    return min(1.0, max(0.0, above / below)) if below > 1e-14 else 0.0
