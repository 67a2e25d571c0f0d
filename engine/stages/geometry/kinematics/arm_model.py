"""Serial arms: forward kinematics, Jacobian, joint limits, and whole turns of joints."""

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Truths
from cellwright.engine.kernels.linear import matmul
from cellwright.engine.model.geometry import Joints
from cellwright.engine.stages.geometry import transforms
from cellwright.kb.model.cell_model import Arm, JointKind


def joints_of(arm: Arm) -> Joints:
    """The joints of a serial arm as arrays. The arm's base is carrier 0."""
    k = len(arm.joints)
    axes = np.array([joint.axis for joint in arm.joints], dtype=float).reshape(k, 3)
    return Joints(
        parent=np.arange(k),
        T_parent_origin=np.array(
            [transforms.of_offsets(joint.origin) for joint in arm.joints]
        ).reshape(k, 4, 4),
        axis=axes / np.linalg.norm(axes, axis=1, keepdims=True),
        prismatic=np.array([joint.kind is JointKind.PRISMATIC for joint in arm.joints], dtype=bool),
        lower=np.array([joint.lower for joint in arm.joints], dtype=float),
        upper=np.array([joint.upper for joint in arm.joints], dtype=float),
    )


def joint_motion(joints: Joints, index: int, values: Floats) -> Floats:
    """The motion (..., 4, 4) of one joint at values (...), in rad or m."""
    axis = joints.axis[index]
    if joints.prismatic[index]:
        return transforms.transform(
            np.broadcast_to(np.eye(3), (*values.shape, 3, 3)), values[..., None] * axis
        )
    return transforms.transform(transforms.rotation(axis, values), np.zeros(3))


def carrier_poses(joints: Joints, q: Floats) -> Floats:
    """The poses of all carriers, the world first: q (..., k) gives (..., k + 1, 4, 4).

    Raises `ValueError` for another number of joint values.
    """
    if q.shape[-1:] != (joints.count,):
        raise ValueError(f"{joints.count} joints need as many values, not {q.shape}")
    poses = [np.broadcast_to(np.eye(4), (*q.shape[:-1], 4, 4))]
    for index in range(joints.count):
        moved = joint_motion(joints, index, q[..., index])
        poses.append(matmul(poses[joints.parent[index]], joints.T_parent_origin[index], moved))
    return np.stack(poses, axis=-3)


@dataclass(frozen=True, eq=False)
class ArmModel:
    """A serial arm ready for computing; all poses are in its base frame.

    A configuration q is (k,) or a batch (..., k): rad for revolute joints, m for prismatic ones.
    """

    arm: Arm

    @cached_property
    def joints(self) -> Joints:
        """The arm's joints as arrays."""
        return joints_of(self.arm)

    @cached_property
    def T_last_flange(self) -> Floats:
        """The pose of the flange in the frame after the last joint (4, 4)."""
        return transforms.of_offsets(self.arm.flange)

    def flange_pose(self, q: Floats) -> Floats:
        """T_base_flange: q (..., k) gives (..., 4, 4)."""
        pose: Floats = matmul(
            carrier_poses(self.joints, np.asarray(q, dtype=float))[..., -1, :, :],
            self.T_last_flange,
        )
        return pose

    def jacobian(self, q: Floats) -> Floats:
        """Velocity of the flange's origin (m), then angular velocity (rad): (..., k) gives
        (..., 6, k).
        """
        q = np.asarray(q, dtype=float)
        poses = carrier_poses(self.joints, q)
        origin = (matmul(poses[..., -1, :, :], self.T_last_flange))[..., :3, 3]
        columns = []
        for index in range(self.joints.count):
            axis = matmul(poses[..., index + 1, :3, :3], self.joints.axis[index])
            arm = origin - poses[..., index + 1, :3, 3]
            still = np.zeros_like(axis)
            pair = (axis, still) if self.joints.prismatic[index] else (np.cross(axis, arm), axis)
            columns.append(np.concatenate(pair, axis=-1))
        return np.stack(columns, axis=-1)

    def within_limits(self, q: Floats, tolerance: float = 1e-9) -> Truths:
        """Whether each configuration (..., k) is within the joint limits; one that is no number is
        not.

        Raises `ValueError` for another number of joint values.
        """
        if q.shape[-1:] != (self.joints.count,):
            raise ValueError(f"{self.joints.count} joints need as many values, not {q.shape}")
        inside = (q >= self.joints.lower - tolerance) & (q <= self.joints.upper + tolerance)
        return np.asarray(inside.all(axis=-1))

    def within_limits_of(self, joint: int, value: float, tolerance: float = 1e-9) -> bool:
        """Whether a value of one joint is within its limits."""
        return bool(
            self.joints.lower[joint] - tolerance <= value <= self.joints.upper[joint] + tolerance
        )

    def random(self, count: int, rng: "np.random.Generator") -> Floats:
        """Configurations (count, k), drawn uniformly within the limits.

        An unlimited joint takes any angle of one full turn.
        """
        lower = np.maximum(self.joints.lower, -math.pi * 2)
        upper = np.minimum(self.joints.upper, math.pi * 2)
        return rng.uniform(lower, upper, (count, self.joints.count))


def wrap_angles(angles: Floats) -> Floats:
    """The same angles, moved into (-pi, pi] by whole turns."""
    return math.pi - (math.pi - angles) % math.tau


def whole_turns(model: ArmModel, q: Floats) -> Floats:
    """Every configuration within the joint limits that differs from q (k,) by whole turns alone
    (m, k).
    """
    choices = []
    for index, value in enumerate(q):
        shifts = [0.0] if model.joints.prismatic[index] else [-2 * np.pi, 0.0, 2 * np.pi]
        inside = [value + s for s in shifts if model.within_limits_of(index, value + s)]
        choices.append(inside)
    return np.array(list(product(*choices))).reshape(-1, len(q))


def reachable_nearest_turns(model: ArmModel, q: Floats, now: Floats) -> Floats:
    """Configurations (m, k) within the limits: those of `q` (n, k), turned by whole turns to be
    nearest to `now` (k,).

    Those that no turn brings within the limits are left out.
    """
    turned, inside = nearest_by_whole_turns(model, q, now)
    near: Floats = turned[inside]
    return near


def nearest_by_whole_turns(model: ArmModel, q: Floats, now: Floats) -> tuple[Floats, Truths]:
    """Configurations (..., k), turned by whole turns to be nearest to `now` within the limits,
    and which can be within them.
    """
    joints, turn = model.joints, 2 * math.pi
    whole = np.round((now - q) / turn)
    best, least = np.array(q), np.full(q.shape, np.inf)
    for more in (0.0, -1.0, 1.0, -2.0, 2.0):
        values = q + np.where(joints.prismatic, 0.0, (whole + more) * turn)
        within = (values >= joints.lower - 1e-9) & (values <= joints.upper + 1e-9)
        far = np.where(within, np.abs(values - now), np.inf)
        nearer = far < least
        best[nearer], least[nearer] = values[nearer], far[nearer]
    return best, np.isfinite(least).all(axis=-1)
