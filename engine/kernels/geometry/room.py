# cython: language_level=3, annotation_typing=False, infer_types=True, boundscheck=False
# cython: wraparound=False, initializedcheck=False, cdivision=True
"""Convex pieces at their current poses: where kernels write vertices and bounds while they go
through a batch of carrier poses (a carrier is a link, or a body that moves).
"""

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.geometry import layout
from cellwright.engine.kernels.geometry.gjk import Cores
from cellwright.engine.kernels.geometry.layout import Pieces


class Room:
    """Pieces and the carrier poses (n, k + 1, 3, 4) of a batch; made once for it. What stands has
    its place already.

    `world` (v, 3) are vertices and `bounds` (n, 18) bounds in the world. After the pieces, as
    number `count`, comes the one of `visitors`, others that stand, that was brought in last. Raises
    `ValueError` for poses that do not fit.
    """

    def __init__(self, p: Pieces, poses: Floats, visitors: Pieces | None = None) -> None:
        self.poses = poses
        if self.poses.shape[1] < p.carriers or self.poses.shape[2] != 3 or self.poses.shape[3] != 4:
            raise ValueError(
                f"carrier poses must be (n, {p.carriers} or more, 3, 4), not {poses.shape}"
            )
        self.count, self.batch, self.most = p.count, len(poses), p.most
        self.pieces = p
        self.vertices, self.carrier = self.pieces._vertices, self.pieces._carrier
        self.own = self.pieces._bounds
        self.first = len(p.vertices)  # row of a visitor's vertices
        world, bounds, stretch, radius = p.vertices.copy(), p.bounds.copy(), p.stretch, p.radius
        if visitors is not None:
            world = np.concatenate([world, np.empty((visitors.most, 3))])
            bounds = np.concatenate([bounds, np.empty((1, layout.KIND + 1))])
            stretch = np.concatenate([stretch, np.zeros((1, 2), np.int64)])
            radius = np.concatenate([radius, np.zeros(1)])
        self.world, self.cores, self.bounds = world, Cores(world), bounds
        self.stretch, self.radius = stretch, radius
        # the last of the batch that each was placed for
        self.placed = np.empty(self.count, np.int64)
        self.moved = np.empty(self.count, np.int64)  # the same for bounds
        for i in range(self.count):
            self.placed[i] = self.moved[i] = self.batch if self.carrier[i] == 0 else -1


def move_bounds(room: Room, n: int) -> None:
    """Put the bounds of all that moves where the carriers are in pose `n` of the batch."""
    for i in range(room.count):
        if room.carrier[i] != 0:
            _place_bounds(room, n, i)
            room.moved[i] = n


def bounds_once(room: Room, i: int, n: int) -> None:
    """Put the bounds of one piece where its carrier is, unless they are there already."""
    if room.moved[i] < n:
        _place_bounds(room, n, i)
        room.moved[i] = n


def _place_bounds(room: Room, n: int, i: int) -> None:
    k = room.carrier[i]
    _turn(room, n, k, i, layout.CENTRE)
    for r in range(3):
        room.bounds[i, r] += room.poses[n, k, r, 3]
    if room.own[i, layout.KIND] != layout.BALL_ITSELF:
        for axis in range(3):
            _turn(room, n, k, i, layout.AXES + 3 * axis)


def _turn(room: Room, n: int, k: int, i: int, at: int) -> None:
    """Turn three entries of the bounds of a piece as its carrier is."""
    x, y, z = room.own[i, at], room.own[i, at + 1], room.own[i, at + 2]
    for r in range(3):
        room.bounds[i, at + r] = (
            room.poses[n, k, r, 0] * x + room.poses[n, k, r, 1] * y + room.poses[n, k, r, 2] * z
        )


def place(room: Room, n: int, i: int) -> None:
    """Put the vertices of piece `i` where its carrier is."""
    k, first = room.carrier[i], room.stretch[i, 0]
    for v in range(first, first + room.stretch[i, 1]):
        x, y, z = room.vertices[v, 0], room.vertices[v, 1], room.vertices[v, 2]
        for r in range(3):
            room.world[v, r] = (
                room.poses[n, k, r, 0] * x
                + room.poses[n, k, r, 1] * y
                + room.poses[n, k, r, 2] * z
                + room.poses[n, k, r, 3]
            )


def move_vertices(room: Room, n: int) -> None:
    """Put the vertices of all that moves where the carriers are."""
    for i in range(room.count):
        if room.carrier[i] != 0:
            place(room, n, i)


def forget(room: Room) -> None:
    """Take all that moves for not placed: the poses were written anew."""
    for i in range(room.count):
        if room.carrier[i] != 0:
            room.placed[i] = room.moved[i] = -1


def place_once(room: Room, i: int, n: int) -> None:
    """The same for one piece, unless it is there already."""
    if room.placed[i] < n:
        place(room, n, i)
        room.placed[i] = n


def bring_bounds(room: Room, visitors: Pieces, r: int) -> None:
    """Bring in the bounds of visitor `r`."""
    for x in range(layout.KIND + 1):
        room.bounds[room.count, x] = visitors._bounds[r, x]


def bring(room: Room, visitors: Pieces, r: int) -> None:
    """Bring in the vertices of visitor `r`."""
    start, rows = visitors._stretch[r, 0], visitors._stretch[r, 1]
    room.stretch[room.count, 0], room.stretch[room.count, 1] = room.first, rows
    room.radius[room.count] = visitors._radius[r]
    for v in range(rows):
        for x in range(3):
            room.world[room.first + v, x] = visitors._vertices[start + v, x]
