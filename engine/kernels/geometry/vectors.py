# cython: language_level=3, annotation_typing=False
"""Vectors as tuples of three floats, and rotations applied to them.

`vectors.pxd` has the same lines once more: Cython copies into other modules only what stands there.
The modules that use them are tested compiled and as they stand, to the last bit, which holds both
together.
"""

import cython

from cellwright.engine.kernels.geometry import angles

V = tuple[float, float, float]

if not cython.compiled:

    def vector(x: float, y: float, z: float) -> V:
        """(x, y, z), which Cython takes for a Python object when all three are numbers written
        out.
        """
        return (x, y, z)

    def dot(a: V, b: V) -> float:
        """a . b"""
        return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]

    def cross(a: V, b: V) -> V:
        """a x b"""
        return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])

    def minus(a: V, b: V) -> V:
        """a - b"""
        return (a[0] - b[0], a[1] - b[1], a[2] - b[2])

    def plus(a: V, b: V) -> V:
        """a + b"""
        return (a[0] + b[0], a[1] + b[1], a[2] + b[2])

    def times(s: float, a: V) -> V:
        """s a"""
        return (s * a[0], s * a[1], s * a[2])

    def turn(axis: V, angle: float, v: V) -> V:
        """`v` turned about the unit vector `axis` (Rodrigues)."""
        s, c = angles.sine_cosine(angle)
        return turn_by(axis, s, c, v)

    def turn_by(axis: V, s: float, c: float, v: V) -> V:
        """The same by the sine and the cosine of the angle."""
        along = (1.0 - c) * dot(axis, v)
        around = cross(axis, v)
        return (
            c * v[0] + s * around[0] + along * axis[0],
            c * v[1] + s * around[1] + along * axis[1],
            c * v[2] + s * around[2] + along * axis[2],
        )
