"""Compiled search for short closed tours: Lin-Kernighan moves on an array, kicked and annealed.

A tour is an array of cities with its inverse (`position`). Every change is the reversal of a stretch of positions,
which is its own inverse, so that a journal of reversals undoes a rejected kick. Costs are symmetric integers.

Lin & Kernighan 1973; Johnson & McGeoch 1997 (neighbour lists, don't-look queues); Martin, Otto & Felten 1991
(double-bridge kicks with annealed acceptance).
"""

import numba
import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.int32]
Longs = NDArray[np.int64]

DEPTH = 40
SEGMENT = 50


@numba.njit(cache=True)
def _reverse(tour: Ints, position: Ints, first: int, last: int) -> None:
    """Reverse the positions from `first` to `last`, cyclically; the stretch between them, not the rest."""
    n = tour.shape[0]
    length = last - first + 1
    if length <= 0:
        length += n
    for _ in range(length // 2):
        a, b = tour[first], tour[last]
        tour[first], position[b] = b, first
        tour[last], position[a] = a, last
        first += 1
        if first == n:
            first = 0
        last -= 1
        if last < 0:
            last = n - 1


@numba.njit(cache=True)
def _flip(tour: Ints, position: Ints, start: int, end: int, journal: Ints, written: int) -> int:
    """Reverse the path from city `start` to city `end`, or, if that is shorter, the rest of the tour instead."""
    n = tour.shape[0]
    first, last = position[start], position[end]
    length = last - first + 1
    if length <= 0:
        length += n
    if 2 * length > n:
        first, last = (last + 1) % n, (first - 1) % n
    _reverse(tour, position, first, last)
    if written < journal.shape[0]:
        journal[written, 0], journal[written, 1] = first, last
    return written + 1


@numba.njit(cache=True)
def _undo(tour: Ints, position: Ints, journal: Ints, written: int, kept: int) -> None:
    for entry in range(written - 1, kept - 1, -1):
        _reverse(tour, position, journal[entry, 0], journal[entry, 1])


@numba.njit(cache=True)
def _next(tour: Ints, position: Ints, city: int) -> int:
    at = position[city] + 1
    return int(tour[0] if at == tour.shape[0] else tour[at])


@numba.njit(cache=True)
def _before(tour: Ints, position: Ints, city: int) -> int:
    at = position[city] - 1
    return int(tour[at])  # -1 is the last


@numba.njit(cache=True)
def _is_added(added: Ints, count: int, one: int, other: int) -> bool:
    for index in range(0, count, 2):
        x, y = added[index], added[index + 1]
        if (x == one and y == other) or (x == other and y == one):
            return True
    return False


@numba.njit(cache=True)
def _choose(
    tour: Ints,
    position: Ints,
    cost: Ints,
    near: Ints,
    base: int,
    end: int,
    gain: int,
    added: Ints,
    count: int,
    only: int,
) -> tuple[int, int, int]:
    """The edge from `end` that leaves most gain: its other city, the city that becomes the end, the gain; or -1.

    An edge that the chain added may not be removed again. `only` picks one rank among the neighbours, -1 all of them.
    """
    following, preceding = _next(tour, position, end), _before(tour, position, end)
    forward = _next(tour, position, base) == end
    chosen, follower, value = -1, -1, -1
    for rank in range(near.shape[1]):
        city = near[end, rank]
        left = gain - cost[end, city]
        if left <= 0:
            break
        if (only >= 0 and rank != only) or city in (base, following, preceding):
            continue
        other = _before(tour, position, city) if forward else _next(tour, position, city)
        if left + cost[other, city] > value and not _is_added(added, count, city, other):
            chosen, follower, value = city, other, left + cost[other, city]
    return chosen, follower, value


@numba.njit(cache=True)
def _attempt(
    tour: Ints,
    position: Ints,
    cost: Ints,
    near: Ints,
    base: int,
    tail: int,
    only: int,
    added: Ints,
    journal: Ints,
    written: int,
) -> tuple[int, int, int]:
    """One chain of exchanges; cut where it had gained most. The gain, the journal's length, the length of `added`."""
    gain, end, count = cost[base, tail], tail, 0
    best, best_written, best_count = 0, written, 0
    for depth in range(DEPTH):
        rank = only if depth == 0 else -1
        city, follower, left = _choose(tour, position, cost, near, base, end, gain, added, count, rank)
        if city < 0 or written + 2 >= journal.shape[0]:
            break
        added[count], added[count + 1] = end, city
        count += 2
        if _next(tour, position, base) == end:
            written = _flip(tour, position, end, follower, journal, written)
        else:
            written = _flip(tour, position, follower, end, journal, written)
        gain, end = left, follower
        if gain - cost[end, base] > best:
            best, best_written, best_count = gain - cost[end, base], written, count
    _undo(tour, position, journal, written, best_written)
    return best, best_written, best_count


@numba.njit(cache=True)
def _chain(
    tour: Ints,
    position: Ints,
    cost: Ints,
    near: Ints,
    base: int,
    tail: int,
    added: Ints,
    journal: Ints,
    written: int,
) -> tuple[int, int, int]:
    """A Lin-Kernighan chain that first removes the edge from `base` to `tail`, every neighbour tried as its first.

    Returns the gain (0 if none was found, the tour then as before), the journal's length and the number of cities in
    `added` whose surroundings changed.
    """
    for only in range(near.shape[1]):
        best, after, count = _attempt(tour, position, cost, near, base, tail, only, added, journal, written)
        if best > 0:
            return best, after, count
    return 0, written, 0


@numba.njit(cache=True)
def _settle(
    tour: Ints,
    position: Ints,
    cost: Ints,
    near: Ints,
    queue: Ints,
    waiting: Ints,
    size: int,
    added: Ints,
    journal: Ints,
    written: int,
) -> tuple[int, int]:
    """Improve around the cities in the queue until none is left; the gain and the journal's length."""
    n = tour.shape[0]
    head, gain = 0, 0
    while size > 0:
        city = queue[head]
        head = (head + 1) % n
        size -= 1
        waiting[city] = 0
        improved = True
        while improved and written + DEPTH + 4 < journal.shape[0]:
            improved = False
            for side in range(2):
                tail = _next(tour, position, city) if side == 0 else _before(tour, position, city)
                won, written, count = _chain(tour, position, cost, near, city, tail, added, journal, written)
                if won > 0:
                    gain += won
                    improved = True
                    for index in range(-1, count):
                        other = tail if index < 0 else added[index]
                        if waiting[other] == 0 and other != city:
                            waiting[other] = 1
                            queue[(head + size) % n] = other
                            size += 1
                    break
    return gain, written


@numba.njit(cache=True)
def improve(
    tour: Ints, cost: Ints, near: Ints, kicks: int, warmth: float, cooling: float, seed: int
) -> tuple[Ints, int, int, float]:
    """Anneal over `kicks` local double bridges, each repaired by Lin-Kernighan chains.

    `tour` (n,) is changed in place. `cost` (n, n) symmetric; `near` (n, k) each city's nearest ones in order.
    Worse tours are accepted with the probability exp(-loss / warmth); `warmth` is multiplied by `cooling` each kick.
    Returns the best tour, what it gained over the given one, what the current one gained, and the final warmth.
    """
    n = tour.shape[0]
    np.random.seed(seed)
    position = np.empty(n, np.int32)
    for index in range(n):
        position[tour[index]] = index
    queue, waiting = np.empty(n, np.int32), np.zeros(n, np.int32)
    added = np.empty(2 * DEPTH + 8, np.int32)
    journal = np.empty((max(40 * n, 4096), 2), np.int32)
    for index in range(n):
        queue[index], waiting[tour[index]] = tour[index], 1
    current, _ = _settle(tour, position, cost, near, queue, waiting, n, added, journal, 0)
    best_gain, best = current, tour.copy()
    for _ in range(kicks):
        loss, written, size = _kick(tour, position, cost, queue, waiting, journal)
        won, written = _settle(tour, position, cost, near, queue, waiting, size, added, journal, written)
        change = won - loss
        if change >= 0 or np.random.random() < np.exp(change / max(warmth, 1e-9)):
            current += change
            if current > best_gain:
                best_gain = current
                best[:] = tour
        else:
            _undo(tour, position, journal, written, 0)
        warmth *= cooling
    return best, best_gain, current, warmth


@numba.njit(cache=True)
def _kick(
    tour: Ints, position: Ints, cost: Ints, queue: Ints, waiting: Ints, journal: Ints
) -> tuple[int, int, int]:
    """Exchange two neighbouring short stretches somewhere; the loss, the journal's length, the queue's size."""
    n = tour.shape[0]
    limit = max(1, min(SEGMENT, (n - 2) // 3))
    start = np.random.randint(n)
    middle = 1 + np.random.randint(limit)
    end = middle + 1 + np.random.randint(limit)
    a, b = tour[start], tour[(start + 1) % n]
    c, d = tour[(start + middle) % n], tour[(start + middle + 1) % n]
    e, f = tour[(start + end) % n], tour[(start + end + 1) % n]
    first, last = (start + 1) % n, (start + end) % n
    split = (start + middle) % n
    stretches = ((first, split), ((split + 1) % n, last), (first, last))
    _reverse(tour, position, first, split)
    _reverse(tour, position, (split + 1) % n, last)
    _reverse(tour, position, first, last)
    for index in range(3):
        journal[index, 0], journal[index, 1] = stretches[index]
    loss = cost[a, d] + cost[e, b] + cost[c, f] - cost[a, b] - cost[c, d] - cost[e, f]
    size = 0
    for city in (a, b, c, d, e, f):
        if waiting[city] == 0:
            waiting[city] = 1
            queue[size] = city
            size += 1
    return loss, 3, size
