"""Compiled annealing over orders whose costs depend on the direction, or on what came before.

A move puts a stretch of the order somewhere else, the same way round or turned. Without windows, precedence or turned
stretches a move is priced by the arcs that it changes; else the whole order is walked.
"""

import numpy as np
from numpy.typing import NDArray

from engine.stages.sequencing.kernels import compiled
from engine.stages.sequencing.kernels.arrays import Ints, Longs, positions

LONGEST = 30
Pairs = NDArray[np.int64]


@compiled
def price(
    order: Ints,
    arcs: Longs,
    closed: bool,
    times: Longs,
    pairs: Pairs,
    fine: Longs,
) -> int:
    """The cost of an order with fines: fine[0] for each unit of lateness, fine[1] for each pair (m, 2) the wrong way round.

    `times` (3, n) are durations, and the earliest and latest beginnings.
    """
    n = order.shape[0]
    total, clock, late, wrong = 0, 0, 0, 0
    place = np.empty(n, np.int32)
    for index in range(n):
        city = order[index]
        place[city] = index
        if index:
            step = arcs[order[index - 1], city]
            total += step
            clock += step + times[0, order[index - 1]]
        clock = max(clock, times[1, city])
        late += max(0, clock - times[2, city])
    for pair in range(pairs.shape[0]):
        wrong += place[pairs[pair, 0]] > place[pairs[pair, 1]]
    if closed:
        total += arcs[order[n - 1], order[0]]
    return int(total + fine[0] * late + fine[1] * wrong)


@compiled
def _move(order: Ints, moved: Ints, first: int, last: int, behind: int, turned: bool) -> None:
    """`order` with the stretch first..last put behind position `behind` (outside it; -1: in front) into `moved`."""
    at = 0
    for index in range(-1, order.shape[0]):
        if 0 <= index < first or index > last:
            moved[at] = order[index]
            at += 1
        if index == behind:
            for step in range(last - first + 1):
                moved[at] = order[last - step] if turned else order[first + step]
                at += 1


@compiled
def _difference(order: Ints, arcs: Longs, closed: bool, first: int, last: int, behind: int) -> int:
    """What a move of a stretch changes in cost, the same way round."""
    n = order.shape[0]
    if closed and ((first == 0 and behind == n - 1) or (last == n - 1 and behind == -1)):
        return 0  # the same circle
    head, tail = order[first], order[last]
    before = order[first - 1] if first > 0 else (order[n - 1] if closed else -1)
    beyond = order[last + 1] if last + 1 < n else (order[0] if closed else -1)
    left = order[behind] if behind >= 0 else (order[n - 1] if closed else -1)
    right = order[behind + 1] if behind + 1 < n else (order[0] if closed else -1)
    change = 0
    if before >= 0:
        change -= arcs[before, head]
    if beyond >= 0:
        change -= arcs[tail, beyond]
    if before >= 0 and beyond >= 0:
        change += arcs[before, beyond]
    if left >= 0 and right >= 0:
        change -= arcs[left, right]
    if left >= 0:
        change += arcs[left, head]
    if right >= 0:
        change += arcs[tail, right]
    return int(change)


@compiled
def _proposal(order: Ints, place: Ints, near: Ints, low: int, high: int) -> tuple[int, int, int]:
    """A stretch and where to put it, most often behind a city from which its first one is near; last < first: none."""
    n = order.shape[0]
    width = high - low
    first = low + np.random.randint(width)
    last = min(high - 1, first + np.random.randint(min(LONGEST, width)))
    if np.random.random() < 0.3:
        last = min(high - 1, first + np.random.randint(min(3, width)))
    city = near[order[first], np.random.randint(near.shape[1])]
    behind = place[city] if np.random.random() < 0.8 else low - 1 + np.random.randint(width + 1)
    if (first - 1 <= behind <= last and first > 0) or behind >= high or behind < low - 1:
        return 0, -1, 0
    if (first == 0 and behind <= last) or (first == 0 and last == n - 1):
        return 0, -1, 0
    return first, last, behind


@compiled
def _price_after(
    order: Ints,
    moved: Ints,
    arcs: Longs,
    closed: bool,
    times: Longs,
    pairs: Pairs,
    fine: Longs,
    now: int,
    move: tuple[int, int, int, bool],
) -> int:
    """The price after a move of `order`, whose price is `now`; where the arcs alone do not tell, `moved` is walked."""
    first, last, behind, turned = move
    if fine[0] == 0 and not turned:
        return int(now + _difference(order, arcs, closed, first, last, behind))
    _move(order, moved, first, last, behind, turned)
    return int(price(moved, arcs, closed, times, pairs, fine))


@compiled
def anneal(
    order: Ints,
    arcs: Longs,
    near: Ints,
    closed: bool,
    low: int,
    high: int,
    times: Longs,
    pairs: Pairs,
    fine: Longs,
    moves: int,
    warmth: float,
    cooling: float,
    seed: int,
) -> tuple[Ints, int, float]:
    """Anneal over `moves` moves of the positions low..high - 1; the others stay where they are.

    `order` (n,) is changed in place; `near` (n, k) are cities from which each city is near; fines of 0 say that there
    are neither windows nor precedence. Returns the best order, its price and the final warmth.
    """
    np.random.seed(seed)
    place, moved = positions(order), order.copy()
    now = price(order, arcs, closed, times, pairs, fine)
    best, kept = now, order.copy()
    for _ in range(moves):
        warmth *= cooling
        first, last, behind = _proposal(order, place, near, low, high)
        if last < first:
            continue
        move = (first, last, behind, np.random.random() < 0.3)
        after = _price_after(order, moved, arcs, closed, times, pairs, fine, now, move)
        if not _accepted(after - now, warmth):
            continue
        now = after
        _move(order, moved, *move)
        _take(order, moved, place)
        if now < best:
            best = now
            kept[:] = order
    return kept, best, warmth


@compiled
def _accepted(loss: int, warmth: float) -> bool:
    return loss <= 0 or np.random.random() < np.exp(-loss / max(warmth, 1e-9))


@compiled
def _take(order: Ints, moved: Ints, place: Ints) -> None:
    for index in range(order.shape[0]):
        order[index] = moved[index]
        place[moved[index]] = index
