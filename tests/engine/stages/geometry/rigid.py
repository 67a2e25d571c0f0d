"""What makes matrices rigid."""

import numpy as np

from cellwright.engine.kernels.arrays import Floats


def is_rigid(T: Floats, tolerance: float = 1e-9) -> bool:
    """Whether every matrix (..., 4, 4) is a rotation (without reflection) and a displacement."""
    R = T[..., :3, :3]
    orthogonal = np.abs(R @ np.swapaxes(R, -1, -2) - np.eye(3)).max() <= tolerance
    return bool(
        orthogonal
        and np.all(np.linalg.det(R) > 0)
        and np.abs(T[..., 3, :] - [0, 0, 0, 1]).max() <= tolerance
    )
