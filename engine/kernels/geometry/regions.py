# cython: language_level=3, annotation_typing=False, infer_types=True, boundscheck=False, wraparound=False
# cython: initializedcheck=False, cdivision=True
"""Questions that go down a region tree. Its regions are the first of the pieces; the others ask.

A region is looked into when its bounding volumes come near enough: as near as is asked, and as much more as its
descendants may reach out of it (`tree.grow`). To compare the region itself would cost more than it saves.
"""

import cython
import numpy as np

from engine.kernels.arrays import Bytes, Floats, Longs, Truths
from engine.kernels.geometry import checks, room, volumes
from engine.kernels.geometry.distance import Separations
from engine.kernels.geometry.layout import Pieces, Tree
from engine.kernels.geometry.room import Room


class Walk:
    """What is written while walking down a tree; made once for a batch."""

    def __init__(self, tree: Tree) -> None:
        self.tree, self.size = tree, 0
        self.stack = np.empty(tree.count + len(tree.children), np.int64)  # regions to be looked at
        self.seen = np.full(tree.count, -1)  # the number of the walk that saw each last


def _begin(w: Walk) -> None:
    """Put the roots on the stack."""
    w.size = w.tree._roots.shape[0]
    for i in range(w.size):
        w.stack[i] = w.tree._roots[i]


def _next_solid(w: Walk, here: Room, asking: int, by: float, number: int) -> int:
    """The next solid region whose bounding volume is within `by` of a piece, or -1; each is told once in walk `number`."""
    while w.size > 0:
        w.size -= 1
        r = w.stack[w.size]
        if w.seen[r] == number:
            continue
        w.seen[r] = number
        if volumes.verdict(here, asking, r, by + w.tree._grow[r]) == volumes.APART:
            continue
        for c in range(w.tree._first[r], w.tree._first[r + 1]):
            w.stack[w.size] = w.tree._children[c]
            w.size += 1
        if w.tree._solid[r]:
            return int(r)
    return -1


def near_solids(p: Pieces, tree: Tree, within: float, near: Truths) -> None:
    """Which solid regions are within a distance of each asking piece: near (n, regions). All stand in the world.

    Raises `ValueError` for arrays that do not fit together, as all of these do.
    """
    regions = tree.count
    here, w, told = Room(p, np.empty((0, p.carriers, 3, 4))), Walk(tree), near.view(np.uint8)
    if told.shape[0] + regions != here.count or told.shape[1] != regions:
        raise ValueError(f"regions that are near must be (pieces that ask, {regions}), not {near.shape}")
    with cython.nogil:
        for n in range(told.shape[0]):
            _begin(w)
            r = _next_solid(w, here, regions + n, within, n)
            while r >= 0:
                told[n, r] = checks.touches(here, regions + n, r, within)
                r = _next_solid(w, here, regions + n, within, n)


def first_hits(poses: Floats, p: Pieces, tree: Tree, pairs: Longs, skip: Truths, out: Truths) -> None:
    """For each of the carrier poses (n, k + 1, 3, 4) whether an asking piece touches a solid region or one of `pairs`.

    `skip` (asking, regions) are those that may touch.
    """
    here, w, told, may, both = Room(p, poses), Walk(tree), out.view(np.uint8), skip.view(np.uint8), pairs
    _refuse_unless_fitting(here, w, both, may, told.shape[0])
    with cython.nogil:
        for n in range(here.batch):
            room.move_bounds(here, n)
            room.move_vertices(here, n)
            told[n] = _pairs_touch(here, both)
            asking = 0
            while asking < may.shape[0] and not told[n]:
                told[n] = _hits(here, w, may, asking, n * may.shape[0] + asking)
                asking += 1


def _refuse_unless_fitting(here: Room, w: Walk, pairs: Longs, skip: Bytes, results: int) -> None:
    if not checks.fit(here, pairs):
        raise ValueError(f"pairs must be (m, 2), of {here.count} pieces")
    if skip.shape[0] + w.tree.count != here.count or skip.shape[1] != w.tree.count:
        raise ValueError(f"regions that may touch must be (pieces that ask, {w.tree.count})")
    if results != here.batch:
        raise ValueError(f"{here.batch} carrier poses have as many results, not {results}")


def _pairs_touch(here: Room, pairs: Longs) -> bool:
    for m in range(pairs.shape[0]):
        i, j = pairs[m, 0], pairs[m, 1]
        if volumes.verdict(here, i, j, 0.0) != volumes.APART and checks.touches(here, i, j, 0.0):
            return True
    return False


def _hits(here: Room, w: Walk, skip: Bytes, asking: int, number: int) -> bool:
    """Whether one asking piece touches a solid region."""
    piece = w.tree.count + asking
    _begin(w)
    r = _next_solid(w, here, piece, 0.0, number)
    while r >= 0:
        if not skip[asking, r] and checks.touches(here, piece, r, 0.0):
            return True
        r = _next_solid(w, here, piece, 0.0, number)
    return False


def nearest_hits(
    poses: Floats, p: Pieces, tree: Tree, pairs: Longs, skip: Truths, beyond: float, distance: Floats
) -> None:
    """The least signed distance (n,) below `beyond` between asking pieces and solid regions, and in `pairs`."""
    here, w, least, may, both = Room(p, poses), Walk(tree), distance, skip.view(np.uint8), pairs
    _refuse_unless_fitting(here, w, both, may, least.shape[0])
    s = Separations(np.asarray(here.world), here.most)
    with cython.nogil:
        for n in range(here.batch):
            room.move_bounds(here, n)
            room.move_vertices(here, n)
            best = _nearest_of_pairs(here, s, both, beyond)
            for asking in range(may.shape[0]):
                best = _nearest(here, s, w, may, asking, n * may.shape[0] + asking, best)
            least[n] = best


def _nearest_of_pairs(here: Room, s: Separations, pairs: Longs, best: float) -> float:
    """The least signed distance in `pairs`, if below `best`."""
    for m in range(pairs.shape[0]):
        i, j = pairs[m, 0], pairs[m, 1]
        if volumes.verdict(here, i, j, max(best, 0.0)) != volumes.APART:
            best = min(best, checks.separation(here, s, i, j))
    return best


def _nearest(
    here: Room, s: Separations, w: Walk, skip: Bytes, asking: int, number: int, best: float
) -> float:
    """The least signed distance of one asking piece from a solid region, if below `best`."""
    piece = w.tree.count + asking
    _begin(w)
    r = _next_solid(w, here, piece, max(best, 0.0), number)
    while r >= 0:
        if not skip[asking, r]:
            best = min(best, checks.separation(here, s, piece, r))
        r = _next_solid(w, here, piece, max(best, 0.0), number)
    return best
