# cython: language_level=3, annotation_typing=False, infer_types=True, boundscheck=False
# cython: wraparound=False, initializedcheck=False, cdivision=True
"""Bounding balls and boxes of pieces: they decide most pairs without an iteration."""

import cython

from cellwright.engine.kernels.geometry import layout
from cellwright.engine.kernels.geometry.room import Room

if not cython.compiled:  # `volumes.pxd` has these numbers, too
    APART, TOUCHING, UNDECIDED = 0, 1, 2


def verdict(room: Room, i: int, j: int, by: float) -> int:
    """What bounds in the world tell of two pieces: APART by more than `by`, TOUCHING (within `by`),
    or UNDECIDED.

    Of two balls, and of a ball and a block, the bounds are the pieces, so that nothing is left
    undecided.
    """
    x, y, z = (
        room.bounds[i, 0] - room.bounds[j, 0],
        room.bounds[i, 1] - room.bounds[j, 1],
        room.bounds[i, 2] - room.bounds[j, 2],
    )
    reach = room.bounds[i, layout.BALL] + room.bounds[j, layout.BALL] + by
    if reach < 0.0 or x * x + y * y + z * z > reach * reach:
        return APART
    one, other = room.bounds[i, layout.KIND], room.bounds[j, layout.KIND]
    if one == layout.BALL_ITSELF and other == layout.BALL_ITSELF:
        return TOUCHING
    if other != layout.BALL_ITSELF and _off_block(room, i, j, x, y, z, by):
        return APART
    if one != layout.BALL_ITSELF and _off_block(room, j, i, -x, -y, -z, by):
        return APART
    return TOUCHING if one + other == layout.BALL_ITSELF + layout.BLOCK_ITSELF else UNDECIDED


def _off_block(room: Room, i: int, j: int, x: float, y: float, z: float, by: float) -> bool:
    """Whether the ball of `i` is more than `by` from the block of `j`."""
    reach = room.bounds[i, layout.BALL] + room.bounds[j, layout.RADIUS] + by
    return bool(_block_gap(room, j, x, y, z) > reach * reach)


def _block_gap(room: Room, j: int, x: float, y: float, z: float) -> float:
    """How far a point, given from the middle of block `j`, is from it, squared."""
    total = 0.0
    for axis in range(3):
        a = layout.AXES + 3 * axis
        along = room.bounds[j, a] * x + room.bounds[j, a + 1] * y + room.bounds[j, a + 2] * z
        beyond = abs(along) - room.bounds[j, layout.HALF + axis]
        if beyond > 0.0:
            total += beyond * beyond
    return total
