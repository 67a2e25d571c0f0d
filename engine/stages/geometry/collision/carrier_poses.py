"""Poses of the links and moved bodies (carriers) of a collision scene for a batch of
configurations.
"""

import math
from functools import lru_cache

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Truths
from cellwright.engine.kernels.geometry.mechanism import Mechanism, place_batch
from cellwright.engine.model.geometry import CollisionScene, Joints


def pose_batch(scene: CollisionScene, where: Floats) -> Floats:
    """The carrier poses (n, k + 1, 3, 4) of configurations (n, k) or, in a free scene, of poses (n,
    4, 4).

    Raises `ValueError` for an array of another shape.
    """
    return checked_poses(scene, as_batch(scene, where))


def checked_poses(scene: CollisionScene, where: Floats) -> Floats:
    """`pose_batch` for what `as_batch` or `split_batch` has given back."""
    poses = np.empty((len(where), scene.carriers, 3, 4))
    if scene.free:
        poses[:, 0] = np.eye(4)[:3]
        poses[:, 1] = where[:, :3]
    else:
        place_batch(mechanism_of(scene.joints), where, poses)
    return poses


@lru_cache(64)
def mechanism_of(joints: Joints) -> Mechanism:
    """The joints as kernels read them; joints are one value for each scene, so they are checked
    once.
    """
    origins, axes = np.ascontiguousarray(joints.T_parent_origin), np.ascontiguousarray(joints.axis)
    return Mechanism(joints.parent, origins, axes, joints.prismatic)


def as_batch(scene: CollisionScene, where: Floats) -> Floats:
    """The configurations (n, k) or poses (n, 4, 4) as an array.

    Raises `ValueError` for another shape.
    """
    where, count = np.ascontiguousarray(where, dtype=float), scene.joints.count
    if where.shape[1:] != ((4, 4) if scene.free else (count,)):
        kind = "poses" if scene.free else "configurations"
        expected_shape = "(n, 4, 4)" if scene.free else f"(n, {count}), a value for each joint"
        raise ValueError(f"{kind} must be {expected_shape}, not {where.shape}")
    return where


def split_batch(scene: CollisionScene, where: Floats) -> tuple[Floats, Truths]:
    """The batch with zeros for what is no number, and which of it (n,) has such entries: nothing is
    known about these.

    Raises as `as_batch` does.
    """
    where = as_batch(scene, where)
    if is_finite(where):
        return where, np.zeros(len(where), dtype=bool)
    endless: Truths = np.asarray(~np.isfinite(where).all(axis=tuple(range(1, where.ndim))))
    if endless.any():
        where = where.copy()
        where[endless] = np.eye(4) if scene.free else 0.0
    return where, endless


def is_finite(where: Floats) -> bool:
    """Whether a batch has numbers alone, seen quickly; a batch of great numbers may also get
    False.
    """
    return math.isfinite(np.vdot(where, where))


def batch_of_one(scene: CollisionScene, configuration: Floats) -> Floats:
    """A batch of one configuration (k,) or pose (4, 4).

    Raises `ValueError` if it is no number, or of another shape.
    """
    where, endless = split_batch(scene, np.asarray(configuration, dtype=float)[None])
    if endless.any():
        raise ValueError("a configuration or pose has an entry that is not a finite number")
    return where
