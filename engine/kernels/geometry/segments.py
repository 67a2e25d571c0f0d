# cython: language_level=3, annotation_typing=False, infer_types=True, boundscheck=False
# cython: wraparound=False, initializedcheck=False, cdivision=True
"""Distances between points, segments and boxes, by closed formulas.

A piece of one or two vertices is a segment.
"""

from cellwright.engine.kernels.geometry import layout, vectors
from cellwright.engine.kernels.geometry.room import Room
from cellwright.engine.kernels.geometry.vectors import V


def _end(room: Room, i: int, last: bool) -> V:
    """The first or the last vertex of a placed piece."""
    v = room.stretch[i, 0] + (room.stretch[i, 1] - 1 if last else 0)
    return (room.world[v, 0], room.world[v, 1], room.world[v, 2])


def segment_gap(room: Room, i: int, j: int) -> float:
    """The distance between two placed points or segments, squared (Ericson 2005, 5.1.9)."""
    a, b = _end(room, i, False), _end(room, j, False)
    u, w, r = (
        vectors.minus(_end(room, i, True), a),
        vectors.minus(_end(room, j, True), b),
        vectors.minus(a, b),
    )
    uu, ww, uw = vectors.dot(u, u), vectors.dot(w, w), vectors.dot(u, w)
    ur, wr = vectors.dot(u, r), vectors.dot(w, r)
    s = _clamped(uw * wr - ur * ww, uu * ww - uw * uw)
    t = _clamped(uw * s + wr, ww)
    s = _clamped(uw * t - ur, uu)
    gap = vectors.minus(vectors.plus(r, vectors.times(s, u)), vectors.times(t, w))
    return vectors.dot(gap, gap)


def segment_block_gap(room: Room, i: int, j: int) -> float:
    """The distance, squared, between a placed point or segment and the block that a placed piece
    is.

    Along the segment the square is convex and quadratic between the six places where the segment
    passes a side; the slope is followed from place to place until the stretch is found where it
    changes its sign.
    """
    start, half = _in_block(room, _end(room, i, False), j), _entries(room, j, layout.HALF)
    step = vectors.minus(_in_block(room, _end(room, i, True), j), start)
    low, high = 0.0, 1.0
    at_low, at_high = _slope(start, step, half, 0.0), _slope(start, step, half, 1.0)
    if at_low >= 0.0:
        return _square(start, step, half, 0.0)
    if at_high <= 0.0:
        return _square(start, step, half, 1.0)
    for side in range(6):
        axis, sign = side // 2, 1.0 if side % 2 == 1 else -1.0
        along = _axis(step, axis)
        if along != 0.0:
            t = (sign * _axis(half, axis) - _axis(start, axis)) / along
            if low < t < high:
                slope = _slope(start, step, half, t)
                if slope < 0.0:
                    low, at_low = t, slope
                else:
                    high, at_high = t, slope
    return _square(start, step, half, low - at_low * (high - low) / (at_high - at_low))


def _in_block(room: Room, point: V, j: int) -> V:
    """A point in the frame of a block about its middle."""
    away = vectors.minus(point, _entries(room, j, layout.CENTRE))
    return (
        vectors.dot(_entries(room, j, layout.AXES), away),
        vectors.dot(_entries(room, j, layout.AXES + 3), away),
        vectors.dot(_entries(room, j, layout.AXES + 6), away),
    )


def _entries(room: Room, j: int, at: int) -> V:
    """Three entries of the bounds of a placed piece."""
    return (room.bounds[j, at], room.bounds[j, at + 1], room.bounds[j, at + 2])


def _axis(v: V, axis: int) -> float:
    return v[0] if axis == 0 else v[1] if axis == 1 else v[2]


def _beyond(x: float, half: float) -> float:
    """How far a coordinate is outside of a block, with its sign."""
    return x - half if x > half else x + half if x < -half else 0.0


def _slope(start: V, step: V, half: V, t: float) -> float:
    total = step[0] * _beyond(start[0] + t * step[0], half[0])
    total += step[1] * _beyond(start[1] + t * step[1], half[1])
    total += step[2] * _beyond(start[2] + t * step[2], half[2])
    return total


def _square(start: V, step: V, half: V, t: float) -> float:
    x = _beyond(start[0] + t * step[0], half[0])
    y = _beyond(start[1] + t * step[1], half[1])
    z = _beyond(start[2] + t * step[2], half[2])
    return x * x + y * y + z * z


def _clamped(above: float, below: float) -> float:
    return min(1.0, max(0.0, above / below)) if below > 1e-14 else 0.0
