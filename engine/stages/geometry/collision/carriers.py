"""Where the carriers of a scene are in many configurations at once."""

import numpy as np

from engine.model.geometry import Floats, Scene


def pose_batch(scene: Scene, where: Floats) -> Floats:
    """The carrier poses (n, k + 1, 3, 4) of configurations (n, k) or, in a free scene, of poses (n, 4, 4).

    Raises `ValueError` for an array of another shape.
    """
    from engine.kernels.geometry.forward import carriers

    where, joints = np.ascontiguousarray(where, dtype=float), scene.joints
    wanted = (4, 4) if scene.free else (joints.count,)
    if where.shape[1:] != wanted:
        kind = "poses" if scene.free else "configurations"
        said = "(n, 4, 4)" if scene.free else f"(n, {joints.count}), a value for each joint"
        raise ValueError(f"{kind} must be {said}, not {where.shape}")
    poses = np.empty((len(where), scene.carriers, 3, 4))
    if scene.free:
        poses[:, 0] = np.eye(4)[:3]
        poses[:, 1] = where[:, :3]
    else:
        carriers(joints.parent, joints.T_parent_origin, joints.axis, joints.prismatic, where, poses)
    return poses
