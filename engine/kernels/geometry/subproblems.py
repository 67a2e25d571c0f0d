# cython: language_level=3, annotation_typing=False, infer_types=True, boundscheck=False
# cython: wraparound=False, initializedcheck=False, cdivision=True
"""Subproblems of inverse kinematics: the angles by which a vector turns about an axis to reach
another vector, a plane or an angle.

Turning a vector onto another is subproblem 1 of Paden (1986); turning it until it meets a plane is
subproblem 4 of Elias & Wen (2022), and the distance problem, 3, is the same equation.
"""

import math

from cellwright.engine.kernels.geometry import angles, vectors
from cellwright.engine.kernels.geometry.vectors import V

ALONG = 1e-26  # of a vector along an axis, the part across it, squared: less is rounding
# how far beyond a limit a cosine may lie; Newton's method repairs or the residual rejects it
SLACK = 1e-7


def angle_onto(axis: V, start: V, end: V) -> float:
    """The angle that turns `start` onto `end` about `axis`, as nearly as it can; 0 when either
    lies along the axis.
    """
    p = vectors.minus(start, vectors.times(vectors.dot(axis, start), axis))
    q = vectors.minus(end, vectors.times(vectors.dot(axis, end), axis))
    if vectors.dot(p, p) < ALONG * vectors.dot(start, start) or vectors.dot(
        q, q
    ) < ALONG * vectors.dot(end, end):
        return 0.0
    return angles.angle_of(vectors.dot(axis, vectors.cross(p, q)), vectors.dot(p, q))


def angles_to_plane(normal: V, axis: V, start: V, offset: float) -> V:
    """Both angles at which `start`, turned about `axis`, has `normal . start == offset`, then 1
    if there are any, or 0.
    """
    along = vectors.dot(normal, axis) * vectors.dot(axis, start)
    a = vectors.dot(normal, start) - along
    b = vectors.dot(normal, vectors.cross(axis, start))
    amplitude = math.sqrt(a * a + b * b)
    if amplitude < 1e-14:
        return (0.0, 0.0, 1.0 if abs(offset - along) < 1e-9 else 0.0)
    cosine = (offset - along) / amplitude
    if abs(cosine) > 1.0 + SLACK:
        return (0.0, 0.0, 0.0)
    spread = angles.arc_cosine(min(1.0, max(-1.0, cosine)))
    middle = angles.angle_of(b, a)
    return (middle + spread, middle - spread, 1.0)


def angles_to_angle(normal: V, axis: V, start: V, target: V) -> V:
    """The same for unit vectors: `start` makes the angle with `normal` that `target` makes.

    The angles are found from sines, so that those near 0 are exact, too: there a cosine tells
    nothing.
    """
    a, b, c = _between(normal, axis), _between(axis, start), _between(normal, target)
    square = (
        4.0 * angles.sine_cosine((c + a - b) / 2.0)[0] * angles.sine_cosine((c - a + b) / 2.0)[0]
    )
    square *= angles.sine_cosine((a + b + c) / 2.0)[0] * angles.sine_cosine((a + b - c) / 2.0)[0]
    amplitude = angles.sine_cosine(a)[0] * angles.sine_cosine(b)[0]
    if amplitude < 1e-14:
        return (0.0, 0.0, 1.0 if abs(square) < 1e-18 else 0.0)
    if square < -2.0 * SLACK * amplitude * amplitude:
        return (0.0, 0.0, 0.0)
    along = vectors.dot(normal, axis) * vectors.dot(axis, start)
    spread = angles.angle_of(math.sqrt(max(0.0, square)), vectors.dot(normal, target) - along)
    middle = angles.angle_of(
        vectors.dot(normal, vectors.cross(axis, start)), vectors.dot(normal, start) - along
    )
    return (middle + spread, middle - spread, 1.0)


def _between(a: V, b: V) -> float:
    """The angle between two vectors."""
    across = vectors.cross(a, b)
    return angles.angle_of(math.sqrt(vectors.dot(across, across)), vectors.dot(a, b))
