"""Surfaces whose form is known exactly, as triangles that are small beside a pixel or lie as
much outside of them as inside.
"""

import math

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.geometry import Solid


def surface(corners: Floats) -> Solid:
    """A surface of triangles (m, 3, 3) without facets."""
    return Solid("patch", corners, np.zeros(len(corners), dtype=np.int64), ())


def woven(grid: Floats) -> Solid:
    """The surface through a grid of points (a, b, 3)."""
    a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
    quads = np.concatenate([np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)])
    return surface(quads.reshape(-1, 3, 3))


def plate(half_x: float = 0.05, half_y: float = 0.05) -> Solid:
    """A rectangle about the origin, across z."""
    x, y = np.array([-half_x, half_x]), np.array([-half_y, half_y])
    return woven(np.stack(np.broadcast_arrays(x[:, None], y[None], 0.0), axis=-1))


def holed(radius: float) -> Solid:
    """A plate with a round hole about the origin."""
    angle = np.linspace(0.0, 2 * np.pi, 1501)
    ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    far = 0.05 / np.abs(ring).max(axis=1, keepdims=True)
    return woven(np.stack([radius * ring, far * ring]))


def turning(radius: float, angle: float) -> Solid:
    """A cylinder or cone about z that widens by the tangent of an angle; the side towards -x."""
    around = np.linspace(0.5 * np.pi, 1.5 * np.pi, 1201)
    low, high = max(-0.03, -radius / math.tan(angle) if angle else -0.03), 0.03
    z = np.array([low, high])[:, None]
    out = radius + z * math.tan(angle)
    return woven(np.stack([out * np.cos(around), out * np.sin(around), z + 0 * around], axis=-1))


def ball(radius: float) -> Solid:
    """The half of a ball towards -z. Its facets lie outside as much as inside."""
    polar, around = np.linspace(1e-4, 0.5 * np.pi, 90)[:, None], np.linspace(0, 2 * np.pi, 181)
    # In the mean a chord lies inside its arc by a twelfth of the square of its angle.
    wider = 1.0 + ((polar[1, 0] - polar[0, 0]) ** 2 + (around[1] * np.sin(polar)) ** 2) / 12.0
    out = radius * wider * np.sin(polar)
    height = np.broadcast_to(-radius * wider * np.cos(polar), (90, 181))
    return woven(np.stack([out * np.cos(around), out * np.sin(around), height], axis=-1))
