# cython: language_level=3, annotation_typing=False, infer_types=True, boundscheck=False
# cython: wraparound=False, initializedcheck=False, cdivision=True
"""Collision and distance between the few pieces of an arm and the many pieces that stand in the
cell, by a hierarchy of boxes.

A question goes down a hierarchy of boxes. A standing piece that it finds is brought into the room
of those that ask, where both are compared as any two pieces are. So a question costs nothing for
the pieces that are far away.
"""

import cython
import numpy as np

from cellwright.engine.kernels.arrays import Bytes, Floats, Longs, Truths
from cellwright.engine.kernels.geometry import checks, hierarchy, layout, room, volumes
from cellwright.engine.kernels.geometry.distance import Separations
from cellwright.engine.kernels.geometry.hierarchy import Hierarchy
from cellwright.engine.kernels.geometry.layout import Pieces
from cellwright.engine.kernels.geometry.room import Room


class Walk:
    """Walks through a hierarchy over standing pieces, one after the other; made once for a batch.

    `low` and `high` (3,) are the corners of the box around the piece that asks. Raises `ValueError`
    for a hierarchy over pieces that are not there, and for pieces that do not stand.
    """

    def __init__(self, standing: Pieces, tree: Hierarchy) -> None:
        if tree.numbers > standing.count or standing.carriers > 1:
            raise ValueError(f"a hierarchy over {tree.numbers} pieces, but {standing.count} stand")
        self.standing, self.tree = standing, tree
        self.open, self.gaps = np.empty(tree.depth + 2, np.int64), np.empty(tree.depth + 2)
        self.size = 0
        self.box = np.empty(6)


def begin(w: Walk, here: Room, asking: int, by: float) -> None:
    """Ask for all that is within `by` of a piece."""
    _surround(w, here, asking)
    w.size = 0
    if w.tree.root >= 0:
        _open(w, w.tree.root, by * by)


def _surround(w: Walk, here: Room, asking: int) -> None:
    """Lay the box around a placed piece: around its block, and within the box around its ball."""
    ball, radius = here.bounds[asking, layout.BALL], here.bounds[asking, layout.RADIUS]
    for x in range(3):
        reach = radius
        for axis in range(3):
            along = here.bounds[asking, layout.AXES + 3 * axis + x]
            reach += abs(along) * here.bounds[asking, layout.HALF + axis]
        reach = min(reach, ball)
        w.box[x], w.box[3 + x] = here.bounds[asking, x] - reach, here.bounds[asking, x] + reach


def _open(w: Walk, node: int, square: float) -> None:
    """Put a node on the stack if its box is within a distance, given squared."""
    gap = _gap(w, node, square)
    if gap <= square:
        w.open[w.size], w.gaps[w.size] = node, gap
        w.size += 1


def _gap(w: Walk, node: int, square: float) -> float:
    """How far the box of a node is from the box that asks, squared; beyond `square` some lower
    bound of it.
    """
    total = 0.0
    for x in range(3):
        above = w.tree._boxes[node, x] - w.box[3 + x]
        below = w.box[x] - w.tree._boxes[node, 3 + x]
        beyond = max(above, below)
        if beyond > 0.0:
            total += beyond * beyond
            if total > square:
                break
    return float(total)


def next_within(w: Walk, by: float) -> int:
    """The next standing piece whose box is within `by` of the piece that asks, or -1.

    What is nearer comes first.
    """
    square = by * by
    while w.size > 0:
        w.size -= 1
        node = w.open[w.size]
        if w.gaps[w.size] > square:
            continue
        one, other = w.tree._children[node, 0], w.tree._children[node, 1]
        if one == hierarchy.LEAF:
            return int(other)
        before = w.size
        _open(w, one, square)
        _open(w, other, square)
        if w.size == before + 2 and w.gaps[before + 1] > w.gaps[before]:
            gap = w.gaps[before]
            w.open[before], w.open[before + 1] = other, one
            w.gaps[before], w.gaps[before + 1] = w.gaps[before + 1], gap
    return -1


def _compared(w: Walk, here: Room, asking: int, r: int, by: float) -> int:
    """What the bounds of a standing piece tell; if not that it is apart by more than `by`, it
    is in the room from now on.
    """
    room.bring_bounds(here, w.standing, r)
    said = volumes.verdict(here, asking, here.count, by)
    if said != volumes.APART:
        room.bring(here, w.standing, r)
    return said


def meets(w: Walk, here: Room, asking: int, r: int, by: float, n: int) -> bool:
    """Whether a standing piece is within `by` of a piece that asks, in pose `n` of the batch."""
    said = _compared(w, here, asking, r, by)
    if said != volumes.UNDECIDED:
        return said == volumes.TOUCHING
    room.place_once(here, asking, n)
    return checks.touches(here, asking, here.count, by)


def near_pieces(
    asking: Pieces, standing: Pieces, tree: Hierarchy, within: float, found: Longs
) -> int:
    """How many pairs there are of an asking piece and a standing one within a distance of it;
    nothing is moved.

    The first of the pairs that fit are written to `found` (m, 2). Raises `ValueError` for arrays
    that do not fit together, as all of these do.
    """
    still = np.empty((0, max(1, asking.carriers), 3, 4))
    here, w, told = Room(asking, still, standing), Walk(standing, tree), found
    if told.shape[1] != 2:
        raise ValueError(f"pairs must be (m, 2), not {found.shape}")
    if not within >= 0.0:
        raise ValueError(f"a distance must be 0 or more, not {within}")
    count = 0
    with cython.nogil:
        for n in range(here.count):
            begin(w, here, n, within)
            r = next_within(w, within)
            while r >= 0:
                if meets(w, here, n, r, within, -1):
                    if count < told.shape[0]:
                        told[count, 0], told[count, 1] = n, r
                    count += 1
                r = next_within(w, within)
    return count


def first_hits(
    poses: Floats,
    asking: Pieces,
    standing: Pieces,
    tree: Hierarchy,
    pairs: Longs,
    skip: Truths,
    likely: Longs,
    out: Truths,
) -> None:
    """For each of the carrier poses (n, k + 1, 3, 4) whether an asking piece touches a standing one
    or one of `pairs`.

    `skip` (asking, standing) are those that may touch. The `likely` ones (m, 2), as
    `sampling.all_hits` numbers them, are tried first; rows below 0 are free for what touches on the
    way.
    """
    here, w, hit = Room(asking, poses, standing), Walk(standing, tree), likely.copy()
    told, may, both = out.view(np.uint8), skip.view(np.uint8), pairs
    refuse_unless_fitting(here, w, both, may, told.shape[0])
    if (
        hit.shape[1] != 2
        or (hit[:, 0] >= here.count).any()
        or (hit[:, 1] >= standing.count + here.count).any()
    ):
        raise ValueError("what is likely to touch must be (m, 2), of pieces that are there")
    again = hit
    with cython.nogil:
        for n in range(here.batch):
            told[n] = (
                _hits_again(here, w, n, again)
                or _hits_one(here, w, may, n, again)
                or _pairs_touch(here, both, n)
            )


def refuse_unless_fitting(here: Room, w: Walk, pairs: Longs, skip: Bytes, results: int) -> None:
    if not checks.fit(here, pairs):
        raise ValueError(f"pairs must be (m, 2), of {here.count} pieces")
    if skip.shape[0] != here.count or skip.shape[1] != w.standing.count:
        raise ValueError(f"pieces that may touch must be ({here.count}, {w.standing.count})")
    if results != here.batch:
        raise ValueError(f"{here.batch} carrier poses have as many results, not {results}")


def _pairs_touch(here: Room, pairs: Longs, n: int) -> bool:
    m = 0
    while m < pairs.shape[0] and not both_touch(here, pairs[m, 0], pairs[m, 1], n):
        m += 1
    return bool(m < pairs.shape[0])


def both_touch(here: Room, i: int, j: int, n: int) -> bool:
    """Whether two asking pieces touch."""
    room.bounds_once(here, i, n)
    room.bounds_once(here, j, n)
    said = volumes.verdict(here, i, j, 0.0)
    if said != volumes.UNDECIDED:
        return said == volumes.TOUCHING
    room.place_once(here, i, n)
    room.place_once(here, j, n)
    return checks.touches(here, i, j, 0.0)


def _hits_again(here: Room, w: Walk, n: int, hit: Longs) -> bool:
    """Whether two pieces touch that are likely to, or did so lately; those get one place nearer
    to the front.
    """
    for k in range(hit.shape[0]):
        if hit[k, 0] < 0 or hit[k, 1] < 0:
            return False
        if _hit(here, w, n, hit[k, 0], hit[k, 1]):
            if k > 0:
                for side in range(2):
                    kept = hit[k, side]
                    hit[k, side] = hit[k - 1, side]
                    hit[k - 1, side] = kept
            return True
    return False


def _hit(here: Room, w: Walk, n: int, asking: int, other: int) -> bool:
    """Whether an asking piece touches another one, numbered as in `sampling.all_hits`."""
    if other >= w.standing.count:
        return both_touch(here, asking, other - w.standing.count, n)
    room.bounds_once(here, asking, n)
    return meets(w, here, asking, other, 0.0, n)


def _hits_one(here: Room, w: Walk, skip: Bytes, n: int, hit: Longs) -> bool:
    """Whether one asking piece touches a standing one; notes which.

    The last pieces of an arm ask first.
    """
    for asking in range(here.count - 1, -1, -1):
        room.bounds_once(here, asking, n)
        begin(w, here, asking, 0.0)
        r = next_within(w, 0.0)
        while r >= 0:
            if not skip[asking, r] and meets(w, here, asking, r, 0.0, n):
                _keep(hit, asking, r)
                return True
            r = next_within(w, 0.0)
    return False


def _keep(hit: Longs, asking: int, r: int) -> None:
    """Note a hit in the first free place, or in the last of all."""
    k, last = 0, hit.shape[0] - 1
    while k < last and hit[k, 0] >= 0:
        k += 1
    if k <= last:
        hit[k, 0], hit[k, 1] = asking, r


def nearest_hits(
    poses: Floats,
    asking: Pieces,
    standing: Pieces,
    tree: Hierarchy,
    pairs: Longs,
    skip: Truths,
    beyond: float,
    distance: Floats,
) -> None:
    """The least signed distance (n,) below `beyond` between asking and standing pieces, and in
    `pairs`.
    """
    here, w = Room(asking, poses, standing), Walk(standing, tree)
    least, may, both = distance, skip.view(np.uint8), pairs
    refuse_unless_fitting(here, w, both, may, least.shape[0])
    s = Separations(np.asarray(here.world), max(here.most, standing.most))
    with cython.nogil:
        for n in range(here.batch):
            room.move_bounds(here, n)
            room.move_vertices(here, n)
            best = _nearest_of_pairs(here, s, both, beyond)
            for i in range(here.count):
                best = _nearest(here, s, w, may, i, best)
            least[n] = best


def _nearest_of_pairs(here: Room, s: Separations, pairs: Longs, best: float) -> float:
    """The least signed distance in `pairs`, if below `best`."""
    for m in range(pairs.shape[0]):
        i, j = pairs[m, 0], pairs[m, 1]
        if volumes.verdict(here, i, j, max(best, 0.0)) != volumes.APART:
            best = min(best, checks.separation(here, s, i, j))
    return best


def _nearest(here: Room, s: Separations, w: Walk, skip: Bytes, asking: int, best: float) -> float:
    """The least signed distance of one asking piece from a standing one, if below `best`."""
    begin(w, here, asking, max(best, 0.0))
    r = next_within(w, max(best, 0.0))
    while r >= 0:
        if not skip[asking, r] and _compared(w, here, asking, r, max(best, 0.0)) != volumes.APART:
            best = min(best, checks.separation(here, s, asking, here.count))
        r = next_within(w, max(best, 0.0))
    return best
