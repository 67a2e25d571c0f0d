# cython: language_level=3, annotation_typing=False, infer_types=True, boundscheck=False
# cython: wraparound=False, initializedcheck=False, cdivision=True
"""Which pairs of pieces touch in some sampled poses: from this it is learned which pairs are worth
a check first.
"""

import cython
import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs, Truths
from cellwright.engine.kernels.geometry import regions, room
from cellwright.engine.kernels.geometry.hierarchy import Hierarchy
from cellwright.engine.kernels.geometry.layout import Pieces
from cellwright.engine.kernels.geometry.regions import Walk
from cellwright.engine.kernels.geometry.room import Room


def all_hits(
    poses: Floats,
    asking: Pieces,
    standing: Pieces,
    tree: Hierarchy,
    pairs: Longs,
    skip: Truths,
    found: Longs,
) -> int:
    """How often anything touches in all carrier poses.

    The first of it is written to `found` (m, 3): the pose, the asking piece, and the standing piece
    that it touches, or after the numbers of these the other asking one.
    """
    here, w, told = Room(asking, poses, standing), Walk(standing, tree), found
    may, both, count = skip.view(np.uint8), pairs, 0
    regions.refuse_unless_fitting(here, w, both, may, here.batch)
    if told.shape[1] != 3:
        raise ValueError(f"hits must be (m, 3), not {found.shape}")
    with cython.nogil:
        for n in range(here.batch):
            for i in range(here.count):
                room.bounds_once(here, i, n)
                regions.begin(w, here, i, 0.0)
                r = regions.next_within(w, 0.0)
                while r >= 0:
                    if not may[i, r] and regions.meets(w, here, i, r, 0.0, n):
                        count = _tell(told, count, n, i, r)
                    r = regions.next_within(w, 0.0)
            for m in range(both.shape[0]):
                if regions.both_touch(here, both[m, 0], both[m, 1], n):
                    count = _tell(told, count, n, both[m, 0], w.standing.count + both[m, 1])
    return count


def _tell(told: Longs, count: int, n: int, i: int, other: int) -> int:
    """Write a hit down, if there is room for it; returns how many there are now."""
    if count < told.shape[0]:
        told[count, 0], told[count, 1], told[count, 2] = n, i, other
    return count + 1
