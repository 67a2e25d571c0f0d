"""Whether blocks and triangles meet, by separating axes (Gottschalk, Lin & Manocha 1996; Akenine-Moller 2001).

A triangle may be a line or a point: what is seen of an unknown thing is a line of sight that is blocked.
"""

import numpy as np

from engine.model.geometry import Floats, Truths

CHUNK = 2_000_000


def meet(T: Floats, middles: Floats, halves: Floats, triangles: Floats) -> Truths:
    """Whether any triangle (m, 3, 3) meets any of the blocks, for each pose (n, 4, 4) of their frame (n,).

    Blocks have middles (b, 3) and half extents (b, 3) along the frame's axes. What only touches does not meet.
    """
    found = np.zeros(len(T), dtype=bool)
    if not len(triangles):
        return found
    step = max(1, CHUNK // (len(triangles) * 9))
    for first in range(0, len(T), step):
        part = T[first : first + step]
        local = (triangles[None] - part[:, None, None, :3, 3]) @ part[:, None, :3, :3]
        for middle, half in zip(middles, halves, strict=True):
            found[first : first + step] |= _meets(local - middle, half).any(axis=1)
    return found


def _meets(corners: Floats, half: Floats) -> Truths:
    """Whether triangles (..., 3, 3) meet a block about the origin (...)."""
    low, high = corners.min(axis=-2), corners.max(axis=-2)
    near = ((low < half) & (high > -half)).all(axis=-1)
    found: Truths = near
    if near.any():
        found[near] = ~_separated(corners[near], half)
    return found


def _separated(corners: Floats, half: Floats) -> Truths:
    """Whether the triangle's plane, or a plane along an edge of it and one of the block, separates them (n,)."""
    edges = np.roll(corners, -1, axis=1) - corners
    normal = np.cross(edges[:, 0], edges[:, 1])
    apart = np.abs((normal * corners[:, 0]).sum(axis=1)) > np.abs(normal) @ half
    axes = np.cross(edges[:, :, None], np.eye(3)).reshape(len(corners), 9, 3)
    heights = np.einsum("nai,nci->nac", axes, corners)
    reach = np.abs(axes) @ half
    long = np.linalg.norm(axes, axis=2) > 1e-12
    beyond = (heights.min(axis=2) >= reach) | (heights.max(axis=2) <= -reach)
    found: Truths = apart | (beyond & long).any(axis=1)
    return found
