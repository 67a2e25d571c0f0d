"""Rigid transforms as homogeneous matrices (..., 4, 4): `T_a_b` is the pose of b in a.

The same numbers give the same bits on every processor.
"""

import math

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.geometry.angles import angles_of, sines_cosines
from cellwright.engine.kernels.linear import matmul


def translation(x: float, y: float, z: float) -> Floats:
    """A displacement in metres (4, 4)."""
    T = np.eye(4)
    T[:3, 3] = x, y, z
    return T


def rotation(axis: tuple[float, float, float] | Floats, angle_rad: float | Floats) -> Floats:
    """Rotation matrices (..., 3, 3) about a unit vector (3,) by angles (...), by the formula of
    Rodrigues.
    """
    s, c = sines_cosines(np.asarray(angle_rad, dtype=float)[..., None, None])
    x, y, z = np.asarray(axis, dtype=float)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turned: Floats = np.eye(3) + s * cross + (1.0 - c) * matmul(cross, cross)
    return turned


def transform(R: Floats, p: Floats | tuple[float, float, float]) -> Floats:
    """Homogeneous matrices (..., 4, 4) from rotations (..., 3, 3) and positions (..., 3)."""
    T = np.zeros((*R.shape[:-2], 4, 4))
    T[..., :3, :3], T[..., :3, 3], T[..., 3, 3] = R, p, 1.0
    return T


def inverse(T: Floats) -> Floats:
    """T_b_a from T_a_b (..., 4, 4)."""
    R_t = np.swapaxes(T[..., :3, :3], -1, -2)
    return transform(R_t, -matmul(R_t, T[..., :3, 3:])[..., 0])


def apply(T: Floats, points: Floats) -> Floats:
    """Points (n, 3) of frame b in frame a, by T_a_b (..., 4, 4). Returns (..., n, 3)."""
    moved: Floats = matmul(points, np.swapaxes(T[..., :3, :3], -1, -2)) + T[..., None, :3, 3]
    return moved


def difference(T_a_b: Floats, T_a_c: Floats) -> tuple[Floats, Floats]:
    """How far poses (..., 4, 4) are apart: in metres (...) and in radians (...)."""
    metres: Floats = np.linalg.norm(T_a_b[..., :3, 3] - T_a_c[..., :3, 3], axis=-1)
    vector = rotation_vector(matmul(np.swapaxes(T_a_b[..., :3, :3], -1, -2), T_a_c[..., :3, :3]))
    radians: Floats = np.linalg.norm(vector, axis=-1)
    return metres, radians


def rotation_vector(R: Floats) -> Floats:
    """Axis times angle (..., 3) of rotations (..., 3, 3); exact to rounding for small and
    moderate angles.
    """
    skew = np.stack(
        [R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]],
        axis=-1,
    )
    sine = np.linalg.norm(skew, axis=-1) / 2.0
    cosine = (np.trace(R, axis1=-2, axis2=-1) - 1.0) / 2.0
    angle = angles_of(sine, cosine)
    near = sine < 1e-12
    scale = np.where(near, 0.5, angle / np.where(near, 1.0, 2.0 * sine))
    vector: Floats = skew * scale[..., None]
    return np.where((near & (cosine < 0))[..., None], _half_turn(R), vector)


def _half_turn(R: Floats) -> Floats:
    """The rotation vector when the angle is pi: the column of (R + 1) / 2 with the largest
    diagonal, normalised.
    """
    square = (R + np.eye(3)) / 2.0
    largest = np.argmax(np.diagonal(square, axis1=-2, axis2=-1), axis=-1)
    column = np.take_along_axis(square, largest[..., None, None], axis=-1)[..., 0]
    length = np.linalg.norm(column, axis=-1, keepdims=True)
    axis: Floats = column / np.where(length > 0, length, 1.0)
    return axis * math.pi


def rotation_by_vector(vector: Floats) -> Floats:
    """The rotations (..., 3, 3) by vectors (..., 3): axis times angle."""
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    cross = skew(vector)
    near = angle < 1e-9
    safe = np.where(near, 1.0, angle)
    s, c = sines_cosines(safe)
    sine, versine = np.where(near, 1.0, s / safe), np.where(near, 0.5, (1.0 - c) / safe**2)
    R: Floats = np.eye(3) + sine * cross + versine * matmul(cross, cross)
    return R


def skew(vector: Floats) -> Floats:
    """The matrices (..., 3, 3) that multiply like the cross product with vectors (..., 3)."""
    x, y, z = np.moveaxis(vector, -1, 0)
    zero = np.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    crosses: Floats = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    return crosses
