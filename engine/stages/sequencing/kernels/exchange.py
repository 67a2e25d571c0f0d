"""Compiled search for short closed tours: exchanges of two and three edges, kicked and annealed.

An exchange is evaluated before anything is moved: most are rejected, and then cost no reversal. Costs are symmetric
integers. `near` (n, k) has each city's candidates, nearest first; `toll` (n, k) the costs to them.

Lin & Kernighan 1973, all choices on the first levels; Bentley 1992 (queue of cities worth looking at); Martin, Otto &
Felten 1991 (double-bridge kicks with annealed acceptance), the kicks kept local.
"""

from typing import NamedTuple

import numpy as np

from engine.stages.sequencing.kernels import compiled
from engine.stages.sequencing.kernels.arrays import Ints, after, before, flip, positions, undo, wake
from engine.stages.sequencing.kernels.kicks import kick

ROOM = 8  # rows that one exchange may need in the journal
TWO, TWO_TWICE, SWAPPED, TURNED = 1, 2, 3, 4


class Ring(NamedTuple):
    """A tour (n,) and where each city stands in it, costs (n, n), candidates and the costs to them (n, k)."""

    tour: Ints
    position: Ints
    cost: Ints
    near: Ints
    toll: Ints


class Desk(NamedTuple):
    """Room to work: cities worth looking at and which of them wait, reversals made, and the exchange that was found."""

    queue: Ints
    waiting: Ints
    journal: Ints
    found: Ints


@compiled
def _step(tour: Ints, position: Ints, forward: bool, city: int) -> int:
    return after(tour, position, city) if forward else before(tour, position, city)


@compiled
def _within(position: Ints, forward: bool, first: int, city: int, last: int) -> bool:
    """Whether one meets `city` on the way from `first` to `last` in the given direction."""
    a, b, c = position[first], position[city], position[last]
    if not forward:
        a, c = c, a
    if a <= c:
        return bool(a <= b and b <= c)
    return bool(b >= a or b <= c)


@compiled
def _second_turn(ring: Ring, forward: bool, gain: int, best: int, found: Ints) -> int:
    """After t2..t4 is turned round, another two-edge exchange of the edges at t1: the best gain so far."""
    tour, position, cost, near, toll = ring
    t1, t2, t3, t4 = found[0], found[1], found[2], found[3]
    follower = _step(tour, position, not forward, t4)
    for rank in range(near.shape[1]):
        t5 = near[t4, rank]
        left = gain - toll[t4, rank]
        if left <= best:
            break
        if t5 in (t1, t3, follower):
            continue
        t6 = _step(tour, position, forward == _within(position, forward, t2, t5, t4), t5)
        if left + cost[t5, t6] - cost[t6, t1] > best:
            best = left + cost[t5, t6] - cost[t6, t1]
            found[4], found[5], found[6] = t5, t6, TWO_TWICE
            found[7:10] = found[1:4]
    return best


@compiled
def _opened_cycle(ring: Ring, forward: bool, gain: int, best: int, found: Ints) -> int:
    """The cycle t2..t3 that the first two exchanged edges cut off is opened and put between t4 and t1 again."""
    tour, position, cost, near, toll = ring
    t1, t2, t3, t4 = found[0], found[1], found[2], found[3]
    for rank in range(near.shape[1]):
        t5 = near[t4, rank]
        left = gain - toll[t4, rank]
        if left <= best:
            break
        if t5 == t3 or not _within(position, forward, t2, t5, t3):
            continue
        for kind in (SWAPPED, TURNED):
            if kind == TURNED and t5 == t2:
                continue
            t6 = _step(tour, position, forward == (kind == SWAPPED), t5)
            if left + cost[t5, t6] - cost[t6, t1] > best:
                best = left + cost[t5, t6] - cost[t6, t1]
                found[4], found[5], found[6] = t5, t6, kind
                found[7:10] = found[1:4]
    return best


@compiled
def _best_exchange(ring: Ring, t1: int, forward: bool, found: Ints) -> int:
    """The exchange of most gain that removes the edge after `t1`: its kind in found[6], t2 to t4 in found[7:10]."""
    tour, position, cost, near, toll = ring
    t2 = _step(tour, position, forward, t1)
    beyond = _step(tour, position, forward, t2)
    best, removed = 0, cost[t1, t2]
    found[0], found[1] = t1, t2
    for rank in range(near.shape[1]):
        t3 = near[t2, rank]
        left = removed - toll[t2, rank]
        if left <= 0:
            break
        if t3 in (t1, beyond):
            continue
        t4 = _step(tour, position, not forward, t3)
        found[2], found[3] = t3, t4
        gain = left + cost[t3, t4]
        if gain - cost[t4, t1] > best:
            best = gain - cost[t4, t1]
            found[6] = TWO
            found[7:10] = found[1:4]
        best = _second_turn(ring, forward, gain, best, found)
        t4 = _step(tour, position, forward, t3)
        found[3] = t4
        gain = left + cost[t3, t4]
        best = _opened_cycle(ring, forward, gain, best, found)
    return best


@compiled
def _turn(
    tour: Ints, position: Ints, forward: bool, first: int, last: int, journal: Ints, written: int
) -> bool:
    """Turn the path from `first` to `last` round; the direction that is forward then."""
    if forward:
        return not flip(tour, position, first, last, journal, written)
    return flip(tour, position, last, first, journal, written)


@compiled
def _apply(tour: Ints, position: Ints, forward: bool, found: Ints, journal: Ints, written: int) -> int:
    """Make the exchange that was found; the journal's length."""
    kind, t2, t3, t4, t5, t6 = found[6], found[7], found[8], found[9], found[4], found[5]
    if kind == TWO:
        _turn(tour, position, forward, t2, t4, journal, written)
        return written + 1
    if kind == TWO_TWICE:
        forward = _turn(tour, position, forward, t2, t4, journal, written)
        _turn(tour, position, forward, t4, t6, journal, written + 1)
        return written + 2
    if kind == TURNED:
        forward = _turn(tour, position, forward, t2, t6, journal, written)
        _turn(tour, position, forward, t5, t3, journal, written + 1)
        return written + 2
    forward = _turn(tour, position, forward, t2, t5, journal, written)
    forward = _turn(tour, position, forward, t6, t3, journal, written + 1)
    _turn(tour, position, forward, t5, t6, journal, written + 2)
    return written + 3


@compiled
def _settle(ring: Ring, desk: Desk, size: int, written: int) -> tuple[int, int]:
    """Exchange edges around the `size` cities in the queue until none gains; the gain and the journal's length."""
    queue, waiting, journal, found = desk
    head, gain = 0, 0
    while size > 0:
        city = queue[head]
        head = (head + 1) % queue.shape[0]
        size -= 1
        waiting[city] = 0
        idle = 0
        forward = True
        while idle < 2 and written + ROOM < journal.shape[0]:
            won = _best_exchange(ring, city, forward, found)
            if won > 0:
                written = _apply(ring.tour, ring.position, forward, found, journal, written)
                gain += won
                idle = 0
                for place in range(7, 10):
                    size = wake(found[place], queue, waiting, head, size)
                if found[6] != TWO:
                    size = wake(found[4], queue, waiting, head, size)
                    size = wake(found[5], queue, waiting, head, size)
            else:
                idle += 1
                forward = not forward
    return gain, written


@compiled
def improve(
    tour: Ints, cost: Ints, near: Ints, toll: Ints, kicks: int, warmth: float, cooling: float, seed: int
) -> tuple[Ints, int, int, float]:
    """Anneal over `kicks` local double bridges, each repaired by exchanges; n >= 8.

    `tour` (n,) is changed in place. `cost` (n, n) is symmetric. Worse tours are accepted with the probability
    exp(-loss / warmth); `warmth` is multiplied by `cooling` each kick.
    Returns the best tour, what it gained over the given one, what the current one gained, and the final warmth.
    """
    n = tour.shape[0]
    np.random.seed(seed)
    ring = Ring(tour, positions(tour), cost, near, toll)
    queue, waiting, found = np.empty(n, np.int32), np.zeros(n, np.int32), np.zeros(10, np.int32)
    journal = np.empty((max(40 * n, 4096), 2), np.int32)
    desk = Desk(queue, waiting, journal, found)
    cuts, size = np.zeros(4, np.int32), 0
    for index in range(n):
        size = wake(tour[index], queue, waiting, 0, size)
    current, _ = _settle(ring, desk, size, 0)
    best_gain, best = current, tour.copy()
    for _ in range(kicks):
        loss, written, size = kick(tour, ring.position, cost, near, queue, waiting, journal, cuts)
        won, written = _settle(ring, desk, size, written)
        change = won - loss
        if change >= 0 or np.random.random() < np.exp(change / max(warmth, 1e-9)):
            current += change
            if current > best_gain:
                best_gain = current
                best[:] = tour
        else:
            undo(tour, ring.position, journal, written, 0)
        warmth *= cooling
    return best, best_gain, current, warmth
