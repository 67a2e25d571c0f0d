"""Rigid transforms as homogeneous matrices (..., 4, 4). `T_a_b` is the pose of b in a: x_a = T_a_b x_b."""

import functools
import math

import numpy as np

from engine.model.geometry import Floats
from kb.model.shapes import Offsets, Pose, Vector


def identity() -> Floats:
    """The pose of a frame in itself (4, 4)."""
    return np.eye(4)


def translation(x: float, y: float, z: float) -> Floats:
    """A displacement in metres (4, 4)."""
    T = np.eye(4)
    T[:3, 3] = x, y, z
    return T


def rotation(axis: Vector | Floats, angle_rad: float | Floats) -> Floats:
    """Rotation matrices (..., 3, 3) about a unit vector (3,) by angles (...), by the formula of Rodrigues."""
    angle = np.asarray(angle_rad, dtype=float)[..., None, None]
    x, y, z = np.asarray(axis, dtype=float)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turned: Floats = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)
    return turned


def transform(R: Floats, p: Floats | Vector) -> Floats:
    """Homogeneous matrices (..., 4, 4) from rotations (..., 3, 3) and positions (..., 3)."""
    T = np.zeros((*R.shape[:-2], 4, 4))
    T[..., :3, :3], T[..., :3, 3], T[..., 3, 3] = R, p, 1.0
    return T


def of_pose(pose: Pose) -> Floats:
    """The matrix (4, 4) of a pose: R = Rz(yaw) Ry(pitch) Rx(roll)."""
    return _matrix(pose).copy()


@functools.lru_cache(4096)
def _matrix(pose: Pose) -> Floats:
    """The same matrix, made once: a cell has few poses, and every scene of it asks for all of them."""
    roll, pitch, yaw = pose.rpy_rad
    R = rotation((0, 0, 1), yaw) @ rotation((0, 1, 0), pitch) @ rotation((1, 0, 0), roll)
    return transform(R, pose.position_m)


def of_offsets(offsets: Offsets) -> Floats:
    """The matrix (4, 4) of poses taken one after the other: their product."""
    T = np.eye(4)
    for pose in offsets:
        T = T @ of_pose(pose)
    return T


def to_pose(T: Floats) -> Pose:
    """The pose with this matrix (4, 4). If the pitch is a right angle, the roll is set to 0."""
    R = T[:3, :3]
    pitch = math.atan2(-R[2, 0], math.hypot(R[0, 0], R[1, 0]))
    if math.hypot(R[0, 0], R[1, 0]) > 1e-12:
        roll, yaw = math.atan2(R[2, 1], R[2, 2]), math.atan2(R[1, 0], R[0, 0])
    else:
        roll, yaw = 0.0, math.atan2(-R[0, 1], R[1, 1])
    x, y, z = map(float, T[:3, 3])
    return Pose((x, y, z), (roll, pitch, yaw))


def inverse(T: Floats) -> Floats:
    """T_b_a from T_a_b (..., 4, 4)."""
    R_t = np.swapaxes(T[..., :3, :3], -1, -2)
    return transform(R_t, -(R_t @ T[..., :3, 3:])[..., 0])


def apply(T: Floats, points: Floats) -> Floats:
    """Points (n, 3) of frame b in frame a, by T_a_b (..., 4, 4). Returns (..., n, 3)."""
    moved: Floats = points @ np.swapaxes(T[..., :3, :3], -1, -2) + T[..., None, :3, 3]
    return moved


def is_rigid(T: Floats, tolerance: float = 1e-9) -> bool:
    """Whether every matrix (..., 4, 4) is a rotation (without reflection) and a displacement."""
    R = T[..., :3, :3]
    orthogonal = np.abs(R @ np.swapaxes(R, -1, -2) - np.eye(3)).max() <= tolerance
    return bool(
        orthogonal and np.all(np.linalg.det(R) > 0) and np.abs(T[..., 3, :] - [0, 0, 0, 1]).max() <= tolerance
    )


def difference(T_a_b: Floats, T_a_c: Floats) -> tuple[Floats, Floats]:
    """How far poses (..., 4, 4) are apart: in metres (...) and in radians (...)."""
    metres: Floats = np.linalg.norm(T_a_b[..., :3, 3] - T_a_c[..., :3, 3], axis=-1)
    vector = rotation_vector(np.swapaxes(T_a_b[..., :3, :3], -1, -2) @ T_a_c[..., :3, :3])
    radians: Floats = np.linalg.norm(vector, axis=-1)
    return metres, radians


def rotation_vector(R: Floats) -> Floats:
    """Axis times angle (..., 3) of rotations (..., 3, 3); exact to rounding for small and moderate angles."""
    skew = np.stack(
        [R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], axis=-1
    )
    sine = np.linalg.norm(skew, axis=-1) / 2.0
    cosine = (np.trace(R, axis1=-2, axis2=-1) - 1.0) / 2.0
    angle = np.arctan2(sine, cosine)
    near = sine < 1e-12
    scale = np.where(near, 0.5, angle / np.where(near, 1.0, 2.0 * sine))
    vector: Floats = skew * scale[..., None]
    return np.where((near & (cosine < 0))[..., None], _half_turn(R), vector)


def _half_turn(R: Floats) -> Floats:
    """The rotation vector when the angle is pi: the column of (R + 1) / 2 with the largest diagonal, normalised."""
    square = (R + np.eye(3)) / 2.0
    largest = np.argmax(np.diagonal(square, axis1=-2, axis2=-1), axis=-1)
    column = np.take_along_axis(square, largest[..., None, None], axis=-1)[..., 0]
    length = np.linalg.norm(column, axis=-1, keepdims=True)
    axis: Floats = column / np.where(length > 0, length, 1.0)
    return axis * math.pi
