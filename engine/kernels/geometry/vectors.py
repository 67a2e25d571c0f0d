"""Vectors as tuples of three floats, and rotations applied to them."""

import math

from engine.kernels.geometry import compiled

V = tuple[float, float, float]


@compiled
def dot(a: V, b: V) -> float:
    """a . b"""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def cross(a: V, b: V) -> V:
    """a x b"""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@compiled
def minus(a: V, b: V) -> V:
    """a - b"""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@compiled
def plus(a: V, b: V) -> V:
    """a + b"""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@compiled
def times(s: float, a: V) -> V:
    """s a"""
    return (s * a[0], s * a[1], s * a[2])


@compiled
def turn(axis: V, angle: float, v: V) -> V:
    """`v` turned about the unit vector `axis` (Rodrigues)."""
    s, c = math.sin(angle), math.cos(angle)
    along = (1.0 - c) * dot(axis, v)
    around = cross(axis, v)
    return (
        c * v[0] + s * around[0] + along * axis[0],
        c * v[1] + s * around[1] + along * axis[1],
        c * v[2] + s * around[2] + along * axis[2],
    )
