"""Poses of files as homogeneous matrices (..., 4, 4), and back."""

import functools
import math

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.geometry.angles import angle_of
from cellwright.engine.kernels.linear import matmul
from cellwright.engine.kernels.rigid import apply as apply
from cellwright.engine.kernels.rigid import difference as difference
from cellwright.engine.kernels.rigid import inverse as inverse
from cellwright.engine.kernels.rigid import rotation as rotation
from cellwright.engine.kernels.rigid import rotation_vector as rotation_vector
from cellwright.engine.kernels.rigid import transform as transform
from cellwright.engine.kernels.rigid import translation as translation
from cellwright.kb.model.body_shapes import Offsets, Pose


def of_pose(pose: Pose) -> Floats:
    """The matrix (4, 4) of a pose: R = Rz(yaw) Ry(pitch) Rx(roll)."""
    return _pose_matrix(pose).copy()


@functools.lru_cache(4096)
def _pose_matrix(pose: Pose) -> Floats:
    """The same matrix, made once: a cell has few poses, and every scene of it asks for all of
    them.
    """
    roll, pitch, yaw = pose.rpy_rad
    R = matmul(rotation((0, 0, 1), yaw), rotation((0, 1, 0), pitch), rotation((1, 0, 0), roll))
    return transform(R, pose.position_m)


def of_offsets(offsets: Offsets) -> Floats:
    """The matrix (4, 4) of poses taken one after the other: their product."""
    T = np.eye(4)
    for pose in offsets:
        T = matmul(T, of_pose(pose))
    return T


def to_pose(T: Floats) -> Pose:
    """The pose with this matrix (4, 4). If the pitch is a right angle, the roll is set to 0."""
    R = T[:3, :3]
    level = math.sqrt(R[0, 0] ** 2 + R[1, 0] ** 2)
    pitch = angle_of(-R[2, 0], level)
    if level > 1e-12:
        roll, yaw = angle_of(R[2, 1], R[2, 2]), angle_of(R[1, 0], R[0, 0])
    else:
        roll, yaw = 0.0, angle_of(-R[0, 1], R[1, 1])
    x, y, z = map(float, T[:3, 3])
    return Pose((x, y, z), (roll, pitch, yaw))
