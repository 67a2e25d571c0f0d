"""A first tour through many points: along a Hilbert curve, so that points near each other mostly stay together."""

import numpy as np
from numpy.typing import NDArray

from cellwright.engine.kernels.arrays import Floats, Ints

BITS = 16


def along_hilbert(points: Floats) -> Ints:
    """The order (n,) of points (n, d) along a Hilbert curve (Skilling 2004, transposed coordinates)."""
    low = points.min(axis=0)
    width = max(float((points.max(axis=0) - low).max()), 1e-300)
    axes = ((points - low) / width * (2**BITS - 1)).astype(np.int64).T.copy()
    _untangle(axes)
    code = np.zeros(len(points), np.int64)
    for bit in range(BITS - 1, -1, -1):
        for axis in axes:
            code = (code << 1) | ((axis >> bit) & 1)
    return np.argsort(code, kind="stable").astype(np.int32)


def _untangle(axes: NDArray[np.int64]) -> None:
    """Turn coordinates (d, n) into the transposed index on the curve, in place."""
    for bit in range(BITS - 1, 0, -1):
        mask, below = 1 << bit, (1 << bit) - 1
        for axis in range(len(axes)):
            is_set = (axes[axis] & mask) != 0
            swapped = np.where(is_set, 0, (axes[0] ^ axes[axis]) & below)
            axes[0] ^= np.where(is_set, below, swapped)
            axes[axis] ^= swapped
    for axis in range(1, len(axes)):
        axes[axis] ^= axes[axis - 1]
    turned = np.zeros_like(axes[0])
    for bit in range(BITS - 1, 0, -1):
        turned ^= np.where((axes[-1] & (1 << bit)) != 0, (1 << bit) - 1, 0)
    axes ^= turned
