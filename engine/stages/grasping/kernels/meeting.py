# cython: language_level=3, annotation_typing=False, infer_types=True, boundscheck=False
# cython: wraparound=False, initializedcheck=False, cdivision=True
"""Whether boxes and triangles intersect, by separating axes (Gottschalk, Lin & Manocha 1996;
Akenine-Möller 2001).

Each triangle is brought into the frame of the blocks. Most are beyond a side of a block; the others
are tried on the plane of the triangle, and on the planes along one of its edges and one of the
block.
"""

import cython
import numpy as np

from cellwright.engine.kernels.arrays import Floats, Truths, refuse_unless

SHORT = 1e-24  # the square of an axis that two parallel edges make


class Blocks:
    """Blocks with middles (b, 3) and half extents (b, 3) along the axes of one frame."""

    def __init__(self, middles: Floats, halves: Floats) -> None:
        self.count = len(middles)
        refuse_unless("middles", middles, np.float64, (self.count, 3))
        refuse_unless("halves", halves, np.float64, (self.count, 3))
        self.middle, self.half = middles, halves
        self.local, self.corner, self.edge = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))


def meeting(blocks: Blocks, poses: Floats, triangles: Floats) -> Truths:
    """Whether a triangle (m, 3, 3) meets a block, for each pose (n, 4, 4) of the blocks' frame
    (n,).
    """
    n, m = len(poses), len(triangles)
    refuse_unless("poses", poses, np.float64, (n, 4, 4))
    refuse_unless("triangles", triangles, np.float64, (m, 3, 3))
    found = np.zeros(n, dtype=np.uint8)
    frames, corners, out = poses, triangles, found
    with cython.nogil:
        for i in range(n):
            for k in range(m):
                if _any(blocks, frames, i, corners, k):
                    out[i] = 1
                    break
    return found.view(np.bool_)


def _any(b: Blocks, frames: Floats, i: int, corners: Floats, k: int) -> bool:
    """Whether one triangle meets any block at one pose."""
    for c in range(3):
        for x in range(3):
            b.local[c, x] = 0.0
            for y in range(3):
                b.local[c, x] += frames[i, y, x] * (corners[k, c, y] - frames[i, y, 3])
    hit = False
    for j in range(b.count):
        hit = hit or (_near(b, j) and not _separated(b, j))
    return hit


def _near(b: Blocks, j: int) -> bool:
    """Whether the box around the triangle meets a block; sets the triangle's corners about the
    block's middle.
    """
    for x in range(3):
        for c in range(3):
            b.corner[c, x] = b.local[c, x] - b.middle[j, x]
        low = min(b.corner[0, x], b.corner[1, x], b.corner[2, x])
        high = max(b.corner[0, x], b.corner[1, x], b.corner[2, x])
        if low >= b.half[j, x] or high <= -b.half[j, x]:
            return False
    return True


def _separated(b: Blocks, j: int) -> bool:
    """Whether the triangle's plane, or a plane along an edge of it and one of the block,
    separates them.
    """
    for c in range(3):
        n = 0 if c == 2 else c + 1
        for x in range(3):
            b.edge[c, x] = b.corner[n, x] - b.corner[c, x]
    height, reach = 0.0, 0.0
    for x in range(3):
        y, z = (0 if x == 2 else x + 1), (x - 1 if x else 2)
        normal = b.edge[0, y] * b.edge[1, z] - b.edge[0, z] * b.edge[1, y]
        height += normal * b.corner[0, x]
        reach += abs(normal) * b.half[j, x]
    if abs(height) > reach:
        return True
    for c in range(3):
        for x in range(3):
            if _beyond(b, j, c, x):
                return True
    return False


def _beyond(b: Blocks, j: int, c: int, x: int) -> bool:
    """Whether the axis square to one edge of the triangle and to one axis of the block
    separates them.
    """
    y, z = (0 if x == 2 else x + 1), (x - 1 if x else 2)
    p, q = b.edge[c, z], -b.edge[c, y]  # the axis has these along y and z
    if p * p + q * q <= SHORT:
        return False
    first = p * b.corner[0, y] + q * b.corner[0, z]
    second = p * b.corner[1, y] + q * b.corner[1, z]
    third = p * b.corner[2, y] + q * b.corner[2, z]
    reach = abs(p) * b.half[j, y] + abs(q) * b.half[j, z]
    return bool(min(first, second, third) >= reach or max(first, second, third) <= -reach)
