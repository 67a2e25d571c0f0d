"""Questions that go down a region tree. Its regions are the first of the pieces; the others ask.

A region is looked into when its bounding volumes come near enough: as near as is asked, and as much more as its
descendants may reach out of it (`tree.grow`). To compare the region itself would cost more than it saves.
"""

from typing import NamedTuple

import numpy as np

from engine.kernels.arrays import Floats, Longs, Truths
from engine.kernels.geometry import compiled
from engine.kernels.geometry.checks import (
    Room,
    move_bounds,
    move_vertices,
    piece_separation,
    room_for,
    touches,
)
from engine.kernels.geometry.layout import Pieces, Tree
from engine.kernels.geometry.volumes import APART, verdict


class Walk(NamedTuple):
    """What is written while walking; made once for a batch."""

    stack: Longs  # (regions + children + 1,) its size, then the regions to be looked at
    seen: Longs  # (regions,) the number of the walk that saw each last


@compiled
def walk_of(tree: Tree) -> Walk:
    """Room for walking."""
    regions = tree.solid.shape[0]
    return Walk(np.empty(regions + tree.children.shape[0] + 1, np.int64), np.full(regions, -1))


@compiled
def begin(tree: Tree, w: Walk) -> None:
    """Put the roots on the stack."""
    count = tree.roots.shape[0]
    w.stack[0] = count
    for i in range(count):
        w.stack[1 + i] = tree.roots[i]


@compiled
def next_solid(tree: Tree, bounds: Floats, w: Walk, asking: int, by: float, number: int) -> int:
    """The next solid region whose bounding volume is within `by` of a piece, or -1; each is told once in walk `number`."""
    while w.stack[0] > 0:
        r = w.stack[w.stack[0]]
        w.stack[0] -= 1
        if w.seen[r] == number:
            continue
        w.seen[r] = number
        margin = by + tree.grow[r]
        if verdict(bounds, asking, r, margin) == APART:
            continue
        first, last = tree.first[r], tree.first[r + 1]
        if last > first:
            for c in range(first, last):
                w.stack[0] += 1
                w.stack[w.stack[0]] = tree.children[c]
        if tree.solid[r]:
            return int(r)
    return -1


@compiled
def near_solids(p: Pieces, tree: Tree, within: float, near: Truths) -> None:
    """Which solid regions are within a distance of each asking piece: near (n, regions). All stand in the world."""
    regions, room, w = near.shape[1], room_for(p), walk_of(tree)
    for n in range(near.shape[0]):
        begin(tree, w)
        r = next_solid(tree, room.bounds, w, regions + n, within, n)
        while r >= 0:
            near[n, r] = touches(p, room, regions + n, r, within)
            r = next_solid(tree, room.bounds, w, regions + n, within, n)


@compiled
def first_hits(poses: Floats, p: Pieces, tree: Tree, pairs: Longs, skip: Truths, out: Truths) -> None:
    """For each of the carrier poses (n, k + 1, 3, 4) whether an asking piece touches a solid region or one of `pairs`.

    `skip` (asking, regions) are those that may touch.
    """
    room, w = room_for(p), walk_of(tree)
    for n in range(poses.shape[0]):
        move_bounds(poses[n], p.carrier, p.bounds, room.bounds)
        move_vertices(poses[n], p, room)
        out[n] = _pairs_touch(p, pairs, room)
        asking = 0
        while asking < skip.shape[0] and not out[n]:
            out[n] = _hits(p, tree, skip, asking, n * skip.shape[0] + asking, room, w)
            asking += 1


@compiled
def _pairs_touch(p: Pieces, pairs: Longs, room: Room) -> bool:
    for m in range(pairs.shape[0]):
        i, j = pairs[m, 0], pairs[m, 1]
        if verdict(room.bounds, i, j, 0.0) != APART and touches(p, room, i, j, 0.0):
            return True
    return False


@compiled
def _hits(p: Pieces, tree: Tree, skip: Truths, asking: int, number: int, room: Room, w: Walk) -> bool:
    """Whether one asking piece touches a solid region."""
    piece = tree.solid.shape[0] + asking
    begin(tree, w)
    r = next_solid(tree, room.bounds, w, piece, 0.0, number)
    while r >= 0:
        if not skip[asking, r] and touches(p, room, piece, r, 0.0):
            return True
        r = next_solid(tree, room.bounds, w, piece, 0.0, number)
    return False


@compiled
def nearest_hits(
    poses: Floats, p: Pieces, tree: Tree, pairs: Longs, skip: Truths, beyond: float, distance: Floats
) -> None:
    """The least signed distance (n,) below `beyond` between asking pieces and solid regions, and in `pairs`."""
    room, w = room_for(p), walk_of(tree)
    for n in range(poses.shape[0]):
        move_bounds(poses[n], p.carrier, p.bounds, room.bounds)
        move_vertices(poses[n], p, room)
        best = beyond
        for m in range(pairs.shape[0]):
            i, j = pairs[m, 0], pairs[m, 1]
            if verdict(room.bounds, i, j, max(best, 0.0)) != APART:
                best = min(best, piece_separation(p, room, i, j))
        for asking in range(skip.shape[0]):
            best = _nearest(p, tree, skip, asking, n * skip.shape[0] + asking, best, room, w)
        distance[n] = best


@compiled
def _nearest(
    p: Pieces, tree: Tree, skip: Truths, asking: int, number: int, best: float, room: Room, w: Walk
) -> float:
    """The least signed distance of one asking piece from a solid region, if below `best`."""
    piece = tree.solid.shape[0] + asking
    begin(tree, w)
    r = next_solid(tree, room.bounds, w, piece, max(best, 0.0), number)
    while r >= 0:
        if not skip[asking, r]:
            best = min(best, piece_separation(p, room, piece, r))
        r = next_solid(tree, room.bounds, w, piece, max(best, 0.0), number)
    return best
