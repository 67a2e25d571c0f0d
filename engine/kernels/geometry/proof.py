# cython: language_level=3, annotation_typing=False, infer_types=True, boundscheck=False
# cython: wraparound=False, initializedcheck=False, cdivision=True
"""Proofs that a whole path is free of collision, also between its samples (Schwarzer, Saha &
Latombe 2005).

From the middle of a stretch of a straight line, no point of a piece moves farther than its joints
turn times its distance from their axes. Pieces that are farther apart than that do not touch on the
whole stretch. Else the stretch is halved. Sixteen stretches are looked at side by side.
"""

import cython
import numpy as np

from cellwright.engine.kernels.arrays import Floats, refuse_unless
from cellwright.engine.kernels.geometry import checks, edges, mechanism, room, volumes
from cellwright.engine.kernels.geometry.lanes import Lanes, Narrow
from cellwright.engine.kernels.geometry.room import Room

LANES = 16  # stretches side by side
DEEPEST = 40  # how often a stretch is halved at most
LONGEST = 0.5  # rad or m: of a stretch that is looked at first


class Proof:
    """What a proof needs: the scene, and for each joint and piece (k, n) how far the piece gets
    from the joint's axis.

    The reach is 0 where the joint does not move the piece, 1 for a joint that slides. Pieces must
    stay more than `margin` (m) apart. A stretch on which nothing moves more than `finest` (m) is
    not halved. `looked` counts stretches, `refined` those halved, and `shortest` is the length of
    the shortest one (rad, m). After a failure, `where` (0 to 1) and `pair` say where on the line,
    and which pair of the scene is too near. Raises `ValueError` for what does not fit together.
    """

    def __init__(self, scene: Narrow, reach: Floats, margin: float, finest: float) -> None:
        self.mechanism, self.pairs, self.count = scene.mechanism, scene.pairs, scene.mechanism.count
        refuse_unless("reaches", reach, np.float64, (self.count, scene.pieces.count))
        if not (margin >= 0.0 and finest > 0.0):
            raise ValueError(
                f"the margin must be 0 or more, the finest motion above 0, not {margin} and "
                f"{finest}"
            )
        self.margin, self.finest, self.reach = margin, finest, reach
        self.poses = np.empty((1, self.count + 1, 3, 4))
        self.room, self.lanes = Room(scene.pieces, np.asarray(self.poses)), Lanes(scene, reach)
        self.at, self.half, self.whole = (
            np.zeros(self.count),
            np.zeros(self.count),
            np.zeros(scene.pieces.count),
        )
        self.looked, self.refined, self.pair, self.latest, self.where = 0, 0, -1, 0, 0.0
        self.shortest = np.inf
        self.todo = np.empty(
            (LANES * (DEEPEST + 2), 2)
        )  # stretches to be looked at: their starts and their shares of the line
        self.now = np.empty((LANES, 2))


def proved(p: Proof, path: Floats) -> int:
    """How many lines of a path (m, k), from its start, are proved to be free: m - 1 if all are."""
    refuse_unless("path", path, np.float64, (len(path), p.count))
    if not np.isfinite(path).all():
        raise ValueError("a path must be of finite numbers")
    a, free, n = path, True, 0
    with cython.nogil:
        while n < a.shape[0] - 1:
            free = _line_proved(p, a, n)
            if not free:
                break
            n += 1
    return n


def _line_proved(p: Proof, a: Floats, n: int) -> bool:
    """Look at sixteen stretches of a line at a time, those nearest to its start first; put
    halves back for those that fail.
    """
    away, level, first, size = edges.length(a, n, a, n + 1, p.count), 1.0, 0.0, 0
    _measure(p, a, n)
    while level * away > LONGEST:
        level *= 0.5
    while first < 1.0 or size > 0:
        taken = 0
        while taken < LANES and size > 0:
            size -= 1
            p.now[taken, 0], p.now[taken, 1] = p.todo[size, 0], p.todo[size, 1]
            taken += 1
        while taken < LANES and first < 1.0:
            p.now[taken, 0], p.now[taken, 1] = first, level
            first += level
            taken += 1
        failed = _failed(p, taken)
        for lane in range(taken - 1, -1, -1):
            p.shortest = min(p.shortest, away * p.now[lane, 1])
            if failed & (1 << lane):
                if _finest(p, p.now[lane, 1]):
                    p.where = p.now[lane, 0]
                    return False
                p.refined += 1
                half = 0.5 * p.now[lane, 1]
                p.todo[size, 0], p.todo[size, 1] = p.now[lane, 0] + half, half
                p.todo[size + 1, 0], p.todo[size + 1, 1] = p.now[lane, 0], half
                size += 2
    return True


def _measure(p: Proof, a: Floats, n: int) -> None:
    """Take line `n`, and note how far joints and pieces move on half of it."""
    p.lanes.along(a, n, a, n + 1)
    for i in range(p.room.count):
        p.whole[i] = 0.0
    for x in range(p.count):
        p.half[x] = 0.5 * abs(a[n + 1, x] - a[n, x])
        p.lanes.away[x] = p.half[x]
        for i in range(p.room.count):
            p.whole[i] += p.half[x] * p.reach[x, i]
    for i in range(p.room.count):
        p.lanes.whole[i] = p.whole[i]


def _finest(p: Proof, share: float) -> bool:
    """Whether a stretch, a share of the line, is not halved any more: nothing moves far on it."""
    most = 0.0
    for i in range(p.room.count):
        most = max(most, share * p.whole[i])
    return most <= p.finest or share < 1e-12


def _failed(p: Proof, taken: int) -> int:
    """Which of the first `taken` stretches of `now` are not proved, one bit each."""
    for lane in range(LANES):
        row = min(lane, taken - 1)
        p.lanes.where[lane] = p.now[row, 0] + 0.5 * p.now[row, 1]
        p.lanes.share[lane] = p.now[row, 1]
    p.looked += taken
    g = p.lanes.sift(p.latest, (1 << taken) - 1, p.margin, True)
    if g >= 0:
        p.latest = g
    failed = p.lanes.hit
    if failed:
        p.pair = p.pairs._order[p.pairs._groups[g, 2]]
    for lane in range(taken):
        if p.lanes.doubted & ~failed & (1 << lane) and _near_in(p, lane):
            failed |= 1 << lane
    return failed


def _near_in(p: Proof, lane: int) -> bool:
    """Whether a pair of the groups that a lane leaves in doubt may touch on its stretch."""
    for x in range(p.count):
        p.at[x] = p.lanes.start[x] + p.lanes.where[lane] * p.lanes.way[x]
    mechanism.place_carriers(p.mechanism, p.at, 0, p.poses)
    room.forget(p.room)
    for g in range(p.lanes.groups):
        if p.lanes.doubt[g] & (1 << lane) and _near(p, g, p.now[lane, 1]) >= 0:
            p.latest = g
            return True
    return False


def _near(p: Proof, g: int, share: float) -> int:
    """The first pair of a group that may touch on a stretch, a share of the line, or -1."""
    i, j = p.pairs._groups[g, 0], p.pairs._groups[g, 1]
    room.bounds_once(p.room, i, 0)
    room.bounds_once(p.room, j, 0)
    if volumes.verdict(p.room, i, j, _motion(p, i, j, share)) == volumes.APART:
        return -1
    for m in range(p.pairs._groups[g, 2], p.pairs._groups[g, 3]):
        i, j = p.pairs._pairs[m, 0], p.pairs._pairs[m, 1]
        by = _motion(p, i, j, share)
        room.bounds_once(p.room, i, 0)
        room.bounds_once(p.room, j, 0)
        said = volumes.verdict(p.room, i, j, by)
        if said == volumes.UNDECIDED:
            room.place_once(p.room, i, 0)
            room.place_once(p.room, j, 0)
            said = volumes.TOUCHING if checks.touches(p.room, i, j, by) else volumes.APART
        if said == volumes.TOUCHING:
            p.pair = p.pairs._order[m]
            return m
    return -1


def _motion(p: Proof, i: int, j: int, share: float) -> float:
    """The farthest that two pieces can come nearer from the middle of a stretch, and the margin.

    A joint that moves both alike counts for neither.
    """
    if p.room.carrier[i] == 0 or p.room.carrier[j] == 0:
        return float(share * (p.whole[i] + p.whole[j]) + p.margin)
    total = 0.0
    for x in range(p.count):
        if p.reach[x, i] == 0.0 or p.reach[x, j] == 0.0:
            total += p.half[x] * (p.reach[x, i] + p.reach[x, j])
    return total * share + p.margin
