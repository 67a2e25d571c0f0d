# cython: language_level=3, annotation_typing=False, infer_types=True, boundscheck=False
# cython: wraparound=False, initializedcheck=False, cdivision=True
"""Forward kinematics of one joint: the pose of its carrier (the link behind it)."""

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.geometry import angles


def stand(out: Floats, n: int) -> None:
    """Put the world where it is in pose `n` of the batch."""
    for r in range(3):
        for c in range(4):
            out[n, 0, r, c] = 1.0 if r == c else 0.0


def place_joint(
    origin: Floats,
    axis: Floats,
    prismatic: bool,
    parent: int,
    j: int,
    value: float,
    n: int,
    out: Floats,
) -> None:
    """Put the carrier of joint `j` where it is: its origin, turned about the axis (Rodrigues)
    or moved along it.
    """
    angle, slide = value, 0.0
    if prismatic:
        angle, slide = 0.0, value
    s, c = angles.sine_cosine(angle)
    a0, a1, a2, t = axis[j, 0], axis[j, 1], axis[j, 2], 1.0 - c
    m00, m01, m02 = c + t * a0 * a0, t * a0 * a1 - s * a2, t * a0 * a2 + s * a1
    m10, m11, m12 = t * a0 * a1 + s * a2, c + t * a1 * a1, t * a1 * a2 - s * a0
    m20, m21, m22 = t * a0 * a2 - s * a1, t * a1 * a2 + s * a0, c + t * a2 * a2
    for r in range(3):
        u, v, w = out[n, parent, r, 0], out[n, parent, r, 1], out[n, parent, r, 2]
        x = u * origin[j, 0, 0] + v * origin[j, 1, 0] + w * origin[j, 2, 0]
        y = u * origin[j, 0, 1] + v * origin[j, 1, 1] + w * origin[j, 2, 1]
        z = u * origin[j, 0, 2] + v * origin[j, 1, 2] + w * origin[j, 2, 2]
        p = u * origin[j, 0, 3] + v * origin[j, 1, 3] + w * origin[j, 2, 3] + out[n, parent, r, 3]
        out[n, j + 1, r, 0] = x * m00 + y * m10 + z * m20
        out[n, j + 1, r, 1] = x * m01 + y * m11 + z * m21
        out[n, j + 1, r, 2] = x * m02 + y * m12 + z * m22
        out[n, j + 1, r, 3] = p + slide * (x * a0 + y * a1 + z * a2)
