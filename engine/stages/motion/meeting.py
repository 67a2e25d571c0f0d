"""Whether two arms can meet, whatever the times at which they go along their paths.

Each pair of places on the two paths is a point of a rectangle (the coordination space of O'Donnell & Lozano-Pérez 1989). From the
middle of a part of it, no point of an arm moves farther than its joints turn times its distance from their axes. If the arms are
farther apart in the middle than both may move, they do not meet anywhere on that part; else the part is halved, on the side that
moves more. Parts of one size are looked at together.
"""

from dataclasses import dataclass

import numpy as np

from cellwright.engine.model.geometry import Floats, Longs
from cellwright.engine.model.motion import FINEST_M
from cellwright.engine.ports import MotionGround

MOST = 200_000  # parts that are looked at for one pair of paths; beyond them nothing is proved
AT_ONCE = 4_096  # of them in one look
FINE_M = 10 * FINEST_M  # arms that are nearer than this count as meeting


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """A path (m, all joints) of one arm among the joints of a ground; all other values are 0. A rest has one configuration."""

    path: Floats

    @property
    def lines(self) -> tuple[Floats, Floats]:
        """Where each line begins, and its way (n, all joints); a rest is one line without a way."""
        if len(self.path) == 1:
            return self.path, np.zeros_like(self.path)
        return self.path[:-1], np.diff(self.path, axis=0)


@dataclass(frozen=True, slots=True, eq=False)
class _Parts:
    """Parts of rectangles: the lines of both paths (n, 2), and where on them the part begins, and how long it is (n, 2)."""

    lines: Longs
    first: Floats
    share: Floats

    def only(self, rows: Floats | Longs) -> "_Parts":
        return _Parts(self.lines[rows], self.first[rows], self.share[rows])


def meet(ground: MotionGround, one: Course, other: Course, margin_m: float = 0.0) -> bool:
    """Whether it is not proved that two arms stay more than `margin_m` apart, wherever each is on its course.

    The ground has the pairs of bodies of the two arms, and no others.
    """
    (begin, way), (start, ride) = one.lines, other.lines
    grid = np.stack(np.meshgrid(np.arange(len(begin)), np.arange(len(start)), indexing="ij"), axis=-1)
    lines = grid.reshape(-1, 2)
    waiting, looked = [_Parts(lines, np.zeros((len(lines), 2)), np.ones((len(lines), 2)))], 0
    while waiting:
        parts = waiting.pop()
        if len(parts.lines) > AT_ONCE:
            waiting.append(parts.only(np.arange(AT_ONCE, len(parts.lines))))
            parts = parts.only(np.arange(AT_ONCE))
        looked += len(parts.lines)
        middle = parts.first + parts.share / 2
        a, b = parts.lines.T
        where = begin[a] + middle[:, :1] * way[a] + start[b] + middle[:, 1:] * ride[b]
        moves = np.stack(
            [
                ground.travels(way[a] * parts.share[:, :1] / 2),
                ground.travels(ride[b] * parts.share[:, 1:] / 2),
            ],
            1,
        )
        needed = moves.sum(axis=1) + margin_m
        apart = ground.clearance(where, float(needed.max()) + FINE_M)
        near = apart <= needed
        if (apart[near] <= margin_m).any() or (needed[near] < margin_m + FINE_M).any() or looked > MOST:
            return True
        if near.any():
            waiting.append(_halved(parts.only(np.nonzero(near)[0]), moves[near]))
    return False


def _halved(parts: _Parts, moves: Floats) -> _Parts:
    """Both halves of each part, cut across the path on which more moves (n, 2)."""
    rows = np.arange(len(parts.lines))
    side = np.argmax(moves, axis=1)
    share, second = parts.share.copy(), parts.first.copy()
    share[rows, side] /= 2
    second[rows, side] += share[rows, side]
    return _Parts(
        np.concatenate([parts.lines, parts.lines]),
        np.concatenate([parts.first, second]),
        np.concatenate([share, share]),
    )
