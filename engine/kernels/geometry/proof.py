# cython: language_level=3, annotation_typing=False, infer_types=True, boundscheck=False, wraparound=False
# cython: initializedcheck=False, cdivision=True
"""Proofs that nothing touches anywhere on a path, not only at the places looked at (Schwarzer, Saha & Latombe 2005).

From the middle of a stretch of a straight line, no point of a piece moves farther than its joints turn times its distance
from their axes. Pieces that are farther apart than that do not touch on the whole stretch. Else the stretch is halved.
"""

import cython
import numpy as np

from engine.kernels.arrays import Floats, refuse_unless
from engine.kernels.geometry import checks, edges, room, volumes
from engine.kernels.geometry.edges import Mechanism
from engine.kernels.geometry.layout import Pairs, Pieces
from engine.kernels.geometry.room import Room


class Proof:
    """What a proof needs: the scene, and for each joint and piece (k, n) how far the piece gets from the joint's axis.

    The reach is 0 where the joint does not move the piece, 1 for a joint that slides. Pieces must stay more than `margin` (m)
    apart. A stretch on which nothing moves more than `finest` (m) is not halved. `looked` counts stretches, `refined` those
    halved. After a failure, `where` (0 to 1) and `pair` say where on the line, and which pair of the scene is too near.
    Raises `ValueError` for what does not fit together.
    """

    def __init__(
        self, mechanism: Mechanism, pieces: Pieces, pairs: Pairs, reach: Floats, margin: float, finest: float
    ) -> None:
        refuse_unless("reaches", reach, np.float64, (mechanism.count, pieces.count))
        if pairs.numbers > pieces.count or pieces.carriers > mechanism.count + 1:
            raise ValueError(f"pairs or carriers beyond {pieces.count} pieces and {mechanism.count} joints")
        if not (margin >= 0.0 and finest > 0.0):
            raise ValueError(
                f"the margin must be 0 or more, the finest motion above 0, not {margin} and {finest}"
            )
        self.mechanism, self.pairs, self.count = mechanism, pairs, mechanism.count
        self.margin, self.finest, self.reach = margin, finest, reach
        poses = np.empty((1, mechanism.count + 1, 3, 4))
        self.poses, self.room = poses, Room(pieces, poses)
        self.at, self.half, self.whole = np.zeros(self.count), np.zeros(self.count), np.zeros(pieces.count)
        self.looked, self.refined, self.pair, self.latest, self.where = 0, 0, -1, 0, 0.0


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
    """Go through the line from its start, with stretches as long as can be proved."""
    low, level = 0.0, 1.0
    while low < 1.0:
        most = _stand_at(p, a, n, low + 0.5 * level, 0.5 * level)
        p.looked += 1
        if _apart(p):
            low += level
            while level < 1.0 and low % (2.0 * level) == 0.0:
                level *= 2.0
                if low + level > 1.0:
                    level *= 0.5
                    break
        elif most <= p.finest or level < 1e-12:
            p.where = low
            return False
        else:
            p.refined += 1
            level *= 0.5
    return True


def _stand_at(p: Proof, a: Floats, n: int, t: float, half: float) -> float:
    """Put everything where it is at a place of line `n`; the farthest that a piece moves from there on half a stretch."""
    most = 0.0
    for x in range(p.count):
        away = a[n + 1, x] - a[n, x]
        p.at[x], p.half[x] = a[n, x] + t * away, half * abs(away)
    edges.place_carriers(p.mechanism, p.at, 0, p.poses)
    room.forget(p.room)
    for i in range(p.room.count):
        p.whole[i] = 0.0
        for x in range(p.count):
            p.whole[i] += p.half[x] * p.reach[x, i]
        most = max(most, p.whole[i])
    return most


def _apart(p: Proof) -> bool:
    """Whether no pair can touch on the stretch; the group that was near last is looked at first."""
    if p.latest < p.pairs._groups.shape[0] and _near(p, p.latest) >= 0:
        return False
    for g in range(p.pairs._groups.shape[0]):
        if g != p.latest and _near(p, g) >= 0:
            p.latest = g
            return False
    return True


def _near(p: Proof, g: int) -> int:
    """The first pair of a group that may touch on the stretch, or -1."""
    i, j = p.pairs._groups[g, 0], p.pairs._groups[g, 1]
    room.bounds_once(p.room, i, 0)
    room.bounds_once(p.room, j, 0)
    if volumes.verdict(p.room, i, j, _motion(p, i, j)) == volumes.APART:
        return -1
    for m in range(p.pairs._groups[g, 2], p.pairs._groups[g, 3]):
        i, j = p.pairs._pairs[m, 0], p.pairs._pairs[m, 1]
        by = _motion(p, i, j)
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


def _motion(p: Proof, i: int, j: int) -> float:
    """The farthest that two pieces can come nearer on half a stretch, and the margin.

    A joint that moves both alike counts for neither.
    """
    if p.room.carrier[i] == 0 or p.room.carrier[j] == 0:
        return float(p.whole[i] + p.whole[j] + p.margin)
    total = p.margin
    for x in range(p.count):
        if p.reach[x, i] == 0.0 or p.reach[x, j] == 0.0:
            total += p.half[x] * (p.reach[x, i] + p.reach[x, j])
    return total
