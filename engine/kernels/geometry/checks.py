# cython: language_level=3, annotation_typing=False, infer_types=True, boundscheck=False
# cython: wraparound=False, initializedcheck=False, cdivision=True
"""Collision checks and distances of a whole scene, one configuration after another; pairs whose
bounding volumes are apart are skipped.
"""

import math

import cython
import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs
from cellwright.engine.kernels.geometry import gjk, layout, room, segments, volumes
from cellwright.engine.kernels.geometry.distance import Separations
from cellwright.engine.kernels.geometry.layout import Pairs, Pieces
from cellwright.engine.kernels.geometry.room import Room

INFINITE = math.inf


def touches(here: Room, i: int, j: int, by: float) -> bool:
    """Whether two placed pieces are within `by` (at least 0) of each other.

    Points, segments and blocks by formulas of their own, the rest by GJK.
    """
    na, nb, reach = here.stretch[i, 1], here.stretch[j, 1], here.radius[i] + here.radius[j] + by
    if na <= 2 and nb <= 2:
        return bool(segments.segment_gap(here, i, j) <= reach * reach)
    if na <= 2 and here.bounds[j, layout.KIND] == layout.BLOCK_ITSELF:
        return bool(segments.segment_block_gap(here, i, j) <= reach * reach)
    if nb <= 2 and here.bounds[i, layout.KIND] == layout.BLOCK_ITSELF:
        return bool(segments.segment_block_gap(here, j, i) <= reach * reach)
    a, b = here.stretch[i, 0], here.stretch[j, 0]
    return bool(gjk.core_distance(here.cores, a, na, b, nb, reach) <= reach)


def separation(here: Room, s: Separations, i: int, j: int) -> float:
    """The signed distance of two placed pieces, with points and normal in `s`."""
    a, na, b, nb = here.stretch[i, 0], here.stretch[i, 1], here.stretch[j, 0], here.stretch[j, 1]
    return s.between(a, na, here.radius[i], b, nb, here.radius[j])


def first_contacts(poses: Floats, p: Pieces, q: Pairs, out: Longs) -> None:
    """For each of the carrier poses (n, k + 1, 3, 4) the first pair that touches (n,), or -1.

    Raises `ValueError` for arrays that do not fit together, as all of these do.
    """
    here, found = _room(poses, p, q), out
    if found.shape[0] != here.batch:
        raise ValueError(f"{here.batch} carrier poses have as many results, not {found.shape[0]}")
    with cython.nogil:
        for n in range(here.batch):
            found[n] = first_contact(here, q, n, 0.0)


def _room(poses: Floats, p: Pieces, q: Pairs) -> Room:
    if q.numbers > p.count:
        raise ValueError(f"pairs of {q.numbers} pieces, but there are {p.count}")
    return Room(p, poses)


def first_contact(here: Room, q: Pairs, n: int, by: float) -> int:
    """The first pair that is within `by` (at least 0) of each other in pose `n` of the batch,
    or -1.
    """
    for g in range(q._groups.shape[0]):
        first = first_of_group(here, q, g, n, by)
        if first >= 0:
            return first
    return -1


def first_of_group(here: Room, q: Pairs, g: int, n: int, by: float) -> int:
    """The same for one group. A first piece that is off the other bounds spares its pairs.

    Bounds are put in place when they are first looked at: most groups are apart, and their pieces
    need not be moved.
    """
    room.bounds_once(here, q._groups[g, 0], n)
    room.bounds_once(here, q._groups[g, 1], n)
    if volumes.verdict(here, q._groups[g, 0], q._groups[g, 1], by) == volumes.APART:
        return -1
    m, last, around, checked = q._groups[g, 2], q._groups[g, 3], q._groups[g, 1], -1
    while m < last:
        i, j = q._pairs[m, 0], q._pairs[m, 1]
        room.bounds_once(here, i, n)
        if i != checked and volumes.verdict(here, i, around, by) == volumes.APART:
            m = q._after[m]
            continue
        checked = i
        room.bounds_once(here, j, n)
        said = volumes.verdict(here, i, j, by)
        if said == volumes.TOUCHING or (said == volumes.UNDECIDED and _decided(here, i, j, n, by)):
            return int(q._order[m])
        m += 1
    return -1


def _decided(here: Room, i: int, j: int, n: int, by: float) -> bool:
    """Whether two pieces are within `by`; their vertices are placed first."""
    room.place_once(here, i, n)
    room.place_once(here, j, n)
    return touches(here, i, j, by)


def count_hits(poses: Floats, p: Pieces, q: Pairs, hits: Longs) -> None:
    """In how many of the carrier poses each group (g,) has a pair that touches."""
    here, count = _room(poses, p, q), hits
    if count.shape[0] != q._groups.shape[0]:
        raise ValueError(f"{q._groups.shape[0]} groups have as many results, not {count.shape[0]}")
    with cython.nogil:
        for n in range(here.batch):
            for g in range(count.shape[0]):
                if first_of_group(here, q, g, n, 0.0) >= 0:
                    count[g] += 1


def nearest_pairs(
    poses: Floats,
    p: Pieces,
    q: Pairs,
    beyond: float,
    distance: Floats,
    pair: Longs,
    witness: Floats,
) -> None:
    """The least signed distance (n,) below `beyond`, its pair (n,) or -1, and its points and
    normal (n, 9).
    """
    here, least, number, points = _room(poses, p, q), distance, pair, witness
    if (
        not here.batch == least.shape[0] == number.shape[0] == points.shape[0]
        or points.shape[1] != 9
    ):
        raise ValueError(f"{here.batch} carrier poses have as many results, points with 9 entries")
    s = Separations(np.asarray(here.world), here.most)
    with cython.nogil:
        for n in range(here.batch):
            least[n] = beyond
            _nearest_pair(here, s, q, n, least, number, points)


def _nearest_pair(
    here: Room, s: Separations, q: Pairs, n: int, least: Floats, number: Longs, points: Floats
) -> None:
    room.move_bounds(here, n)
    room.move_vertices(here, n)
    number[n] = -1
    for x in range(9):
        points[n, x] = 0.0
    for g in range(q._groups.shape[0]):
        if (
            volumes.verdict(here, q._groups[g, 0], q._groups[g, 1], max(least[n], 0.0))
            == volumes.APART
        ):
            continue
        for m in range(q._groups[g, 2], q._groups[g, 3]):
            i, j = q._pairs[m, 0], q._pairs[m, 1]
            if volumes.verdict(here, i, j, max(least[n], 0.0)) == volumes.APART:
                continue
            gap = separation(here, s, i, j)
            if gap < least[n]:
                least[n], number[n] = gap, q._order[m]
                for x in range(9):
                    points[n, x] = s._found[x]


def fit(here: Room, pairs: Longs) -> bool:
    """Whether an array (m, 2) has pairs of the pieces that there are."""
    if pairs.shape[1] != 2:
        return False
    for m in range(pairs.shape[0]):
        for side in range(2):
            if not 0 <= pairs[m, side] < here.count:
                return False
    return True


def near_pairs(
    poses: Floats, p: Pieces, pairs: Longs, within: float, distance: Floats, witness: Floats
) -> None:
    """For one set of carrier poses (1, k + 1, 3, 4), the signed distance of every pair (m,) nearer
    than `within`, else infinity, and its points and normal (m, 9)."""
    here, asked, each, points = Room(p, poses), pairs, distance, witness
    if here.batch != 1 or not fit(here, asked):
        raise ValueError(
            f"pairs (m, 2) of {here.count} pieces at one set of carrier poses, not {here.batch}"
        )
    if not asked.shape[0] == each.shape[0] == points.shape[0] or points.shape[1] != 9:
        raise ValueError(f"{asked.shape[0]} pairs have as many results, points with 9 entries")
    s = Separations(np.asarray(here.world), here.most)
    with cython.nogil:
        room.move_bounds(here, 0)
        room.move_vertices(here, 0)
        for m in range(asked.shape[0]):
            i, j = asked[m, 0], asked[m, 1]
            each[m] = INFINITE
            if volumes.verdict(here, i, j, within) != volumes.APART:
                each[m] = separation(here, s, i, j)
                for x in range(9):
                    points[m, x] = s._found[x]
