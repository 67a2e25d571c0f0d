"""Compiled search over orders and poses together.

The poses of all visits lie in one table (m, k), joint values over joint speeds, so that the time between two poses is
their largest difference; those of visit v are the rows offset[v] .. offset[v + 1] - 1. A tour is a ring of visits
(`after`, `before`) with a row for each (`pose`).

Ruin and recreate (Schrimpf et al. 2000) with the choice of a pose in every insertion, as Smith & Imeson 2017 (GLNS) do
for generalised tours; the layered shortest path over poses is that of Suarez-Ruiz, Lembono & Pham 2018.
"""

import numpy as np
from numpy.typing import NDArray

from engine.stages.sequencing.kernels import compiled
from engine.stages.sequencing.kernels.arrays import Ints

Floats = NDArray[np.float64]
BIG = 1e300
MOST = 12  # visits that one round takes off
NOISE = 0.2  # how far the choice of a place may err


@compiled
def travel(table: Floats, a: int, b: int) -> float:
    """The time from one pose to another."""
    most = 0.0
    for joint in range(table.shape[1]):
        step = abs(table[a, joint] - table[b, joint])
        most = max(most, step)
    return float(most)


@compiled
def best_poses(order: Ints, table: Floats, offset: Ints, closed: bool, pose: Ints) -> float:
    """The least time of an order over all choices of poses; the rows that give it go into `pose` (n,), by visit.

    A closed tour is cut at its first visit, for each of whose poses the path is computed: let it be one with few.
    """
    n, first = order.shape[0], order[0]
    choices = offset[first + 1] - offset[first] if closed else 1
    widest = 0
    for visit in range(n):
        widest = max(widest, offset[visit + 1] - offset[visit])
    best, back = BIG, np.zeros((n, widest), np.int32)
    for choice in range(choices):
        fixed = choice if closed else -1
        total, last = _layers(order, table, offset, fixed, back)
        if total >= best:
            continue
        best = total
        for place in range(n - 1, -1, -1):
            pose[order[place]] = offset[order[place]] + last
            last = back[place, last]
    return best


@compiled
def _layers(order: Ints, table: Floats, offset: Ints, fixed: int, back: Ints) -> tuple[float, int]:
    """One pass over the layers; with `fixed` the first pose is that and the way back to it counts."""
    n, widest = back.shape
    value, following = np.full(widest, BIG), np.empty(widest)
    start = offset[order[0]]
    for pose in range(offset[order[0] + 1] - start):
        value[pose] = 0.0 if fixed in (-1, pose) else BIG
    count = offset[order[0] + 1] - start
    for place in range(1, n):
        low = offset[order[place]]
        width = offset[order[place] + 1] - low
        for pose in range(width):
            following[pose], back[place, pose] = _from_before(table, value, start, count, low + pose)
        value[:width] = following[:width]
        start, count = low, width
    total, last = BIG, 0
    for pose in range(count):
        time = value[pose]
        if fixed >= 0 and time < BIG:
            time += travel(table, start + pose, offset[order[0]] + fixed)
        if time < total:
            total, last = time, pose
    return total, last


@compiled
def _from_before(table: Floats, value: Floats, start: int, count: int, row: int) -> tuple[float, int]:
    """The least time to a row from the `count` rows at `start`, reached at `value`; and from which of them."""
    least, origin = BIG, 0
    for earlier in range(count):
        if value[earlier] < least:
            time = value[earlier] + travel(table, start + earlier, row)
            if time < least:
                least, origin = time, earlier
    return least, origin


@compiled
def _ring_time(after: Ints, pose: Ints, table: Floats) -> float:
    total = 0.0
    for visit in range(after.shape[0]):
        total += travel(table, pose[visit], pose[after[visit]])
    return total


@compiled
def _choose_pose(
    visit: int, left: int, right: int, table: Floats, offset: Ints, limit: float
) -> tuple[float, int]:
    """The pose of a visit between two others that takes least time, if it takes less than `limit`; else -1."""
    chosen = -1
    for row in range(offset[visit], offset[visit + 1]):
        time = travel(table, left, row)
        if time < limit:
            time += travel(table, row, right)
            if time < limit:
                limit, chosen = time, row
    return limit, chosen


@compiled
def _insert(
    visit: int, after: Ints, before: Ints, pose: Ints, table: Floats, offset: Ints, near: Ints, noise: float
) -> None:
    """Put a visit where it costs least, beside one of its neighbours on the ring."""
    least, place, row = BIG, -1, -1
    for rank in range(near.shape[1]):
        for side in range(2):
            a = near[visit, rank]
            if after[a] < 0:
                break
            a = before[a] if side else a
            cut = travel(table, pose[a], pose[after[a]])
            factor = 1.0 + noise * np.random.random()
            limit, chosen = _choose_pose(visit, pose[a], pose[after[a]], table, offset, cut + least / factor)
            if chosen >= 0 and (limit - cut) * factor < least:
                least, place, row = (limit - cut) * factor, a, chosen
    if place < 0:  # none of its neighbours is on the ring
        place = 0
        while after[place] < 0:
            place += 1
        _, row = _choose_pose(visit, pose[place], pose[after[place]], table, offset, BIG)
    b = after[place]
    after[place], after[visit], before[b], before[visit] = visit, b, visit, place
    pose[visit] = row


@compiled
def _polish(visit: int, after: Ints, before: Ints, pose: Ints, table: Floats, offset: Ints) -> None:
    """Take the best pose of a visit between its neighbours as they are."""
    left, right = pose[before[visit]], pose[after[visit]]
    now = travel(table, left, pose[visit]) + travel(table, pose[visit], right)
    _, row = _choose_pose(visit, left, right, table, offset, now - 1e-12)
    if row >= 0:
        pose[visit] = row


@compiled
def _ruin(after: Ints, before: Ints, near: Ints, removed: Ints, fewest: int, most: int) -> int:
    """Take visits off the ring: some that are near each other, or a stretch of the tour; how many."""
    n = after.shape[0]
    count = min(fewest + np.random.randint(most - fewest + 1), n - 3)
    visit, taken = np.random.randint(n), 0
    along = np.random.random() < 0.5
    seed = visit
    for attempt in range(4 * count):
        if taken == count:
            break
        if after[visit] >= 0:
            following = after[visit]
            after[before[visit]], before[following] = following, before[visit]
            after[visit] = -1
            removed[taken] = visit
            taken += 1
            if along:
                visit = following
                continue
        source = removed[np.random.randint(taken)] if taken and attempt % 2 else seed
        visit = near[source, np.random.randint(near.shape[1])]
    return taken


@compiled
def _recreate(
    removed: Ints, after: Ints, before: Ints, pose: Ints, table: Floats, offset: Ints, near: Ints
) -> None:
    """Put visits back on the ring in any order, then choose their poses and those of their neighbours again."""
    np.random.shuffle(removed)
    for visit in removed:
        _insert(visit, after, before, pose, table, offset, near, NOISE)
    for visit in removed:
        for beside in (before[visit], after[visit], visit):
            _polish(beside, after, before, pose, table, offset)


@compiled
def search(
    order: Ints,
    pose: Ints,
    table: Floats,
    offset: Ints,
    near: Ints,
    rounds: int,
    warmth: float,
    cooling: float,
    seed: int,
) -> tuple[Ints, Ints, float, Ints, Ints, float]:
    """Ruin and recreate a closed tour for `rounds` rounds, annealed; n >= 8.

    `order` (n,) and `pose` (n,) are the tour, `near` (n, k) the visits beside which one may be inserted. Returns the
    best order, its poses and time, the current order and poses, and the final warmth.
    """
    n = order.shape[0]
    np.random.seed(seed)
    after, before, row = _after_each(order), _after_each(order[::-1].copy()), pose.copy()
    now = _ring_time(after, row, table)
    best, kept_after, kept_row = now, after.copy(), row.copy()
    old_after, old_before, old_row, removed = after.copy(), before.copy(), row.copy(), np.empty(n, np.int32)
    for _ in range(rounds):
        warmth *= cooling
        old_after[:], old_before[:], old_row[:] = after, before, row
        count = _ruin(after, before, near, removed, 1, MOST)
        _recreate(removed[:count], after, before, row, table, offset, near)
        time = _ring_time(after, row, table)
        if time < now or np.random.random() < np.exp((now - time) / max(warmth, 1e-12)):
            now = time
            if now < best - 1e-12:
                best = now
                kept_after[:], kept_row[:] = after, row
        else:
            after[:], before[:], row[:] = old_after, old_before, old_row
    return _order_of(kept_after, order[0]), kept_row, best, _order_of(after, order[0]), row, warmth


@compiled
def _after_each(order: Ints) -> Ints:
    """The visit that follows each one on the ring."""
    after = np.empty(order.shape[0], np.int32)
    for place in range(order.shape[0]):
        after[order[place - 1]] = order[place]
    return after


@compiled
def _order_of(after: Ints, first: int) -> Ints:
    order, visit = np.empty(after.shape[0], np.int32), first
    for place in range(after.shape[0]):
        order[place] = visit
        visit = after[visit]
    return order
