"""Questions that go down a region tree. Its regions are the first of the pieces; the others ask.

A region is looked into when its bounding volumes come near enough: as near as is asked, and as much more as its
descendants may reach out of it (`tree.grow`). To compare the region itself would cost more than it saves.
"""

from typing import NamedTuple

import numpy as np

from engine.geometry.kernels import compiled
from engine.geometry.kernels.checks import piece_separation, place, place_centres, touches
from engine.geometry.kernels.volumes import far_apart
from engine.geometry.packing import Pieces, Tree
from engine.model.geometry import Floats, Ints, Truths


class Walk(NamedTuple):
    """What is written while walking; made once for a batch."""

    world: Floats  # (v, 3) vertices in the world
    centres: Floats  # (n, 3) of the bounding balls
    simplex: Floats  # (5, 10)
    stack: Ints  # (regions + children + 1,) its size, then the regions to be looked at
    seen: Ints  # (regions,) the number of the walk that saw each last
    found: Floats  # (9,)


@compiled
def walk_of(p: Pieces, tree: Tree) -> Walk:
    """Room for walking."""
    regions = tree.solid.shape[0]
    return Walk(
        p.vertices.copy(),
        np.empty((p.carrier.shape[0], 3)),
        np.empty((5, 10)),
        np.empty(regions + tree.children.shape[0] + 1, np.int64),
        np.full(regions, -1),
        np.empty(9),
    )


@compiled
def begin(tree: Tree, w: Walk) -> None:
    """Put the roots on the stack."""
    count = tree.roots.shape[0]
    w.stack[0] = count
    for i in range(count):
        w.stack[1 + i] = tree.roots[i]


@compiled
def next_solid(pose: Floats, p: Pieces, tree: Tree, w: Walk, asking: int, by: float, number: int) -> int:
    """The next solid region whose bounding volume is within `by` of a piece, or -1; each is told once in walk `number`."""
    while w.stack[0] > 0:
        r = w.stack[w.stack[0]]
        w.stack[0] -= 1
        if w.seen[r] == number:
            continue
        w.seen[r] = number
        margin = by + tree.grow[r]
        if far_apart(pose, p, w.centres, asking, r, margin):
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
    regions, w = near.shape[1], walk_of(p, tree)
    still = np.zeros((1, 3, 4))
    still[0, 0, 0] = still[0, 1, 1] = still[0, 2, 2] = 1.0
    place_centres(still, p, w.centres)
    for n in range(near.shape[0]):
        begin(tree, w)
        r = next_solid(still, p, tree, w, regions + n, within, n)
        while r >= 0:
            near[n, r] = touches(still, w.world, p, regions + n, r, within, w.simplex)
            r = next_solid(still, p, tree, w, regions + n, within, n)


@compiled
def place_asking(pose: Floats, p: Pieces, regions: int, w: Walk) -> None:
    """Put the asking pieces where the carriers are; the regions never move."""
    place_centres(pose, p, w.centres)
    for i in range(regions, p.carrier.shape[0]):
        place(pose, p, i, w.world)


@compiled
def first_hits(poses: Floats, p: Pieces, tree: Tree, pairs: Ints, skip: Truths, out: Truths) -> None:
    """For each of the carrier poses (n, k + 1, 3, 4) whether an asking piece touches a solid region or one of `pairs`.

    `skip` (asking, regions) are those that may touch.
    """
    regions, w = tree.solid.shape[0], walk_of(p, tree)
    for n in range(poses.shape[0]):
        place_asking(poses[n], p, regions, w)
        out[n] = _pairs_touch(poses[n], p, pairs, w)
        asking = 0
        while asking < skip.shape[0] and not out[n]:
            out[n] = _hits(poses[n], p, tree, skip, asking, n * skip.shape[0] + asking, w)
            asking += 1


@compiled
def _pairs_touch(pose: Floats, p: Pieces, pairs: Ints, w: Walk) -> bool:
    for m in range(pairs.shape[0]):
        i, j = pairs[m, 0], pairs[m, 1]
        if not far_apart(pose, p, w.centres, i, j, 0.0) and touches(pose, w.world, p, i, j, 0.0, w.simplex):
            return True
    return False


@compiled
def _hits(pose: Floats, p: Pieces, tree: Tree, skip: Truths, asking: int, number: int, w: Walk) -> bool:
    """Whether one asking piece touches a solid region."""
    piece = tree.solid.shape[0] + asking
    begin(tree, w)
    r = next_solid(pose, p, tree, w, piece, 0.0, number)
    while r >= 0:
        if not skip[asking, r] and touches(pose, w.world, p, piece, r, 0.0, w.simplex):
            return True
        r = next_solid(pose, p, tree, w, piece, 0.0, number)
    return False


@compiled
def nearest_hits(
    poses: Floats, p: Pieces, tree: Tree, pairs: Ints, skip: Truths, beyond: float, distance: Floats
) -> None:
    """The least signed distance (n,) below `beyond` between asking pieces and solid regions, and in `pairs`."""
    regions, w = tree.solid.shape[0], walk_of(p, tree)
    for n in range(poses.shape[0]):
        place_asking(poses[n], p, regions, w)
        best = beyond
        for m in range(pairs.shape[0]):
            i, j = pairs[m, 0], pairs[m, 1]
            if not far_apart(poses[n], p, w.centres, i, j, max(best, 0.0)):
                best = min(best, piece_separation(w.world, p, i, j, w.simplex, w.found))
        for asking in range(skip.shape[0]):
            best = _nearest(poses[n], p, tree, skip, asking, n * skip.shape[0] + asking, best, w)
        distance[n] = best


@compiled
def _nearest(
    pose: Floats, p: Pieces, tree: Tree, skip: Truths, asking: int, number: int, best: float, w: Walk
) -> float:
    """The least signed distance of one asking piece from a solid region, if below `best`."""
    piece = tree.solid.shape[0] + asking
    begin(tree, w)
    r = next_solid(pose, p, tree, w, piece, max(best, 0.0), number)
    while r >= 0:
        if not skip[asking, r]:
            best = min(best, piece_separation(w.world, p, piece, r, w.simplex, w.found))
        r = next_solid(pose, p, tree, w, piece, max(best, 0.0), number)
    return best
