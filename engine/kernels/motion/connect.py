# cython: language_level=3, annotation_typing=False, infer_types=True, boundscheck=False
# cython: wraparound=False, initializedcheck=False, cdivision=True
"""Path planning by two trees of collision-free lines, from the starts and from the goals, until
they meet (RRT-Connect, Kuffner & LaValle 2000).

Samples are quasi-random. The smaller tree grows next, so that neither is caught behind a narrow
passage for long.
"""

import math

import cython
import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.geometry import edges
from cellwright.engine.kernels.geometry.edges import Edges
from cellwright.engine.kernels.motion import halton
from cellwright.engine.kernels.motion.halton import Halton

INFINITE = math.inf


class Trees:
    """Trees over starts (a, k) and goals (b, k), within limits (k,) that are finite; a branch is at
    most `reach` long.

    `nodes` (2, capacity, k) are configurations, `parents` (2, capacity) their predecessors, -1 for
    none. `shift` (k,), from 0 to 1, is what the seed decides. Raises `ValueError` for arrays that
    do not fit together.
    """

    def __init__(
        self,
        starts: Floats,
        goals: Floats,
        low: Floats,
        high: Floats,
        shift: Floats,
        reach: float,
        capacity: int,
    ) -> None:
        count = len(low)
        if any(each.shape[1:] != (count,) or not len(each) for each in (starts, goals)):
            raise ValueError(f"starts and goals must be (n, {count}), at least one of each")
        if high.shape != (count,) or shift.shape != (count,):
            raise ValueError(f"limits and shift must be ({count},)")
        self.count, self.capacity, self.reach = (
            count,
            capacity + max(len(starts), len(goals)),
            reach,
        )
        self.nodes, self.parents = (
            np.empty((2, self.capacity, count)),
            np.empty((2, self.capacity), np.int64),
        )
        self.nodes[0, : len(starts)], self.nodes[1, : len(goals)] = starts, goals
        self.parents[0, : len(starts)], self.parents[1, : len(goals)] = -1, -1
        self._nodes, self._parents = self.nodes, self.parents
        self._first, self._second = self.nodes[0], self.nodes[1]
        self.size, self.met = [len(starts), len(goals)], [-1, -1]
        self.low, self.high = np.array(low, dtype=float), np.array(high, dtype=float)
        self.target, self.halton = np.empty((1, count)), Halton(shift)
        if not (reach > 0.0 and _finite(self)):
            raise ValueError(
                "configurations and limits must be finite, and branches longer than nothing"
            )

    def grown(self) -> tuple[Floats, Floats]:
        """The configurations of both trees, each (n, k)."""
        return self.nodes[0, : self.size[0]], self.nodes[1, : self.size[1]]

    def path(self) -> Floats:
        """The configurations (m, k) from a start to a goal, once the trees have met."""
        halves = []
        for side in range(2):
            rows, n = [], self.met[side]
            while n >= 0:
                rows.append(n)
                n = int(self.parents[side, n])
            halves.append(self.nodes[side, rows])
        joined: Floats = np.concatenate([halves[0][::-1], halves[1][1:]])
        return joined


def _finite(t: Trees) -> bool:
    """Whether the limits and the roots of both trees are finite."""
    sound = True
    for x in range(t.count):
        sound = sound and math.isfinite(t.low[x]) and math.isfinite(t.high[x])
        for side in range(2):
            for n in range(t.size[side]):
                sound = sound and math.isfinite(t._nodes[side, n, x])
    return sound


def connect(t: Trees, e: Edges, budget: int) -> bool:
    """Grow both trees until they meet, or until `e` has looked at `budget` configurations or
    the trees are full.
    """
    if e.count != t.count:
        raise ValueError(f"lines of {e.count} joints, but trees of {t.count}")
    with cython.nogil:
        found = _straight(t, e, budget)
        if not found:
            found = _grow(t, e, budget)
    return bool(found)


def _straight(t: Trees, e: Edges, budget: int) -> int:
    """Whether a start and a goal can be joined by a straight line; the meeting point is then
    added.
    """
    for start in range(t.size[0]):
        for goal in range(t.size[1]):
            free = e.free(t._first, start, t._second, goal)
            if free:
                t.met[0], t.met[1] = t.size[0], goal
                for x in range(t.count):
                    t._nodes[0, t.size[0], x] = t._nodes[1, goal, x]
                t._parents[0, t.size[0]] = start
                t.size[0] += 1
                return 1
            if e.looked >= budget:
                return 0
    return 0


def _grow(t: Trees, e: Edges, budget: int) -> int:
    side = 0
    while e.looked < budget and t.size[0] < t.capacity and t.size[1] < t.capacity:
        side = 1 - side if t.size[1 - side] <= t.size[side] else side
        _sample(t)
        near = _nearest(t, side)
        if _advance(t, e, side, near):
            met = _met(t, e, side)
            if met:
                return 1
    return 0


def _met(t: Trees, e: Edges, side: int) -> int:
    """Whether the other tree reaches the youngest node of `side`; it goes there as far as it
    can.
    """
    other = 1 - side
    for x in range(t.count):
        t.target[0, x] = t._nodes[side, t.size[side] - 1, x]
    near = _nearest(t, other)
    while t.size[other] < t.capacity and t.size[side] < t.capacity:
        moved = _advance(t, e, other, near)
        if moved == 0:
            return 0
        near = t.size[other] - 1
        if moved == 2:
            t.met[side], t.met[other] = t.size[side] - 1, near
            return 1
    return 0


def _sample(t: Trees) -> None:
    t.halton.drawn += 1
    for x in range(t.count):
        t.target[0, x] = t.low[x] + (t.high[x] - t.low[x]) * halton.coordinate(t.halton, x)


def _nearest(t: Trees, side: int) -> int:
    """The node of a tree that is nearest to the target."""
    best, found = INFINITE, 0
    for n in range(t.size[side]):
        total = 0.0
        for x in range(t.count):
            away = t._nodes[side, n, x] - t.target[0, x]
            total += away * away
        if total < best:
            best, found = total, n
    return found


def _advance(t: Trees, e: Edges, side: int, near: int) -> int:
    """Add a node on the way from a node to the target: 2 if it is the target, 1 if it is not, 0
    if the way is blocked.
    """
    nodes = t._second if side else t._first
    n = t.size[side]
    away = edges.length(nodes, near, t.target, 0, t.count)
    reached = away <= t.reach
    share = 1.0 if reached else t.reach / away
    for x in range(t.count):
        nodes[n, x] = nodes[near, x] + share * (t.target[0, x] - nodes[near, x])
        if reached:
            nodes[n, x] = t.target[0, x]
    if not e.free(nodes, near, nodes, n):
        return 0
    t._parents[side, n] = near
    t.size[side] += 1
    return 2 if reached else 1
