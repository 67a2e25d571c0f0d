"""Exact search where every cause fixes every outcome: a state is the set of causes still possible, in one word.

Depth-first branch and bound over the AND/OR graph with a memo of lower bounds and values; the bound is the cost of
separating pairs of causes that may not be concluded together.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from engine.stages.diagnosis.kernels import compiled
from engine.stages.diagnosis.kernels.memo import (
    RUNNING,
    STATUS,
    Floats,
    Longs,
    Memo,
    conclude,
    enter,
    expand,
    insert,
    slot,
)

Flags = NDArray[np.bool_]


class Partition(NamedTuple):
    """A problem in words: bit c of a mask is cause c.

    `masses` (8, 256) probability of each byte of a set; `masks` (A, O) causes that give outcome o of action a, an
    outcome in `ends` (A, O) finishing the case; `costs` and `following` (K, A) of action a in situation k, `cheapest`
    (A,) over the situations; `goals` (G,) sets that may be concluded; `exempt` (E,) disjoint sets within which no pair
    needs separating; `cures` (C,) the least that ending the case costs, given the cause.
    """

    masses: Floats
    masks: Longs
    ends: Flags
    costs: Floats
    following: Longs
    cheapest: Floats
    goals: Longs
    exempt: Longs
    cures: Floats


@compiled
def mass(masses: Floats, causes: int) -> float:
    """The prior probability of a set of causes."""
    total = 0.0
    for byte in range(8):
        part = (causes >> (8 * byte)) & 255
        if part:
            total += masses[byte, part]
    return total


@compiled
def is_final(problem: Partition, causes: int) -> bool:
    """Whether something may be concluded while all of these are possible."""
    return bool(np.any((causes & ~problem.goals) == 0))


@compiled
def tells(problem: Partition, action: int, causes: int) -> bool:
    """Whether an action can end the case or leave fewer causes."""
    for outcome in range(problem.masks.shape[1]):
        if causes & ~problem.masks[action, outcome] == 0:
            return bool(problem.ends[action, outcome])
    return True


@compiled
def _unlike(problem: Partition, action: int, causes: int, total: float) -> float:
    """The weight p_i p_j of the pairs that an action separates within a set of mass `total`."""
    squares = 0.0
    for outcome in range(problem.masks.shape[1]):
        part = mass(problem.masses, causes & problem.masks[action, outcome])
        squares += part * part
    return 0.5 * (total * total - squares)


@compiled
def _needed(problem: Partition, action: int, causes: int, total: float) -> float:
    """As `_unlike`, without pairs that may be concluded together."""
    weight = _unlike(problem, action, causes, total)
    for group in problem.exempt:
        part = causes & group
        if part & (part - 1) != 0:
            weight -= _unlike(problem, action, part, mass(problem.masses, part))
    return weight


@compiled
def _refine(problem: Partition, action: int, blocks: Longs, count: int) -> tuple[int, float]:
    """Split blocks by the outcomes of an action; the number of blocks and the weight of pairs newly separated."""
    weight, last = 0.0, count
    for index in range(last):
        block = blocks[index]
        if block & (block - 1) == 0:
            continue
        left = block
        for outcome in range(problem.masks.shape[1]):
            part = left & problem.masks[action, outcome]
            if part != 0 and part != left:
                blocks[count] = part
                count += 1
                left ^= part
        if left != block:
            weight += _needed(problem, action, block, mass(problem.masses, block))
            blocks[index] = left
    return count, weight


@compiled
def bound(problem: Partition, causes: int) -> float:
    """A lower bound of the weighted cost from here.

    Each pair (i, j) that may not be concluded together is separated at one state only. A state of mass P where action a
    separates pairs of weight W pays c P, that is c P / W for each unit of weight; in a smaller state W / P is smaller,
    so that no pair is ever had for less than its cheapest rate here.
    """
    total = mass(problem.masses, causes)
    actions = problem.masks.shape[0]
    rates, order = np.empty(actions), np.empty(actions, np.int64)
    count = 0
    for action in range(actions):
        weight = _unlike(problem, action, causes, total)
        if weight <= 1e-15 * total * total:
            continue
        rate = problem.cheapest[action] * total / weight
        count = insert(action, rate, order, rates, count)
    blocks = np.empty(64, np.int64)
    blocks[0] = causes
    parts, cost = 1, 0.0
    for index in range(count):
        parts, weight = _refine(problem, order[index], blocks, parts)
        cost += rates[index] * weight
    return max(cost * (1.0 - 1e-12), _cure_cost(problem, causes))


@compiled
def _cure_cost(problem: Partition, causes: int) -> float:
    """What ending the case costs if the cause were known."""
    cost, cause = 0.0, 0
    while causes >> cause:
        if causes >> cause & 1 and problem.cures[cause] > 0.0:
            cost += problem.cures[cause] * mass(problem.masses, 1 << cause)
        cause += 1
    return cost


@compiled
def lower(problem: Partition, table: Memo, causes: int, situation: int) -> float:
    """What is known so far of the value from below."""
    at = slot(table, causes, situation)
    if table.possible[at] == 0:
        final = is_final(problem, causes)
        enter(table, at, causes, situation, 0.0 if final else bound(problem, causes), final)
    return float(table.value[at])


@compiled
def estimate(problem: Partition, table: Memo, action: int, causes: int, situation: int) -> float:
    """A lower bound of beginning with an action."""
    value = problem.costs[situation, action] * mass(problem.masses, causes)
    after = problem.following[situation, action]
    for outcome in range(problem.masks.shape[1]):
        part = causes & problem.masks[action, outcome]
        if part != 0 and not problem.ends[action, outcome]:
            value += lower(problem, table, part, after)
    return float(value)


@compiled
def ranked(problem: Partition, table: Memo, causes: int, situation: int) -> tuple[Longs, Floats, int]:
    """The actions that tell something, by the lower bound of beginning with them; how many there are."""
    actions = problem.masks.shape[0]
    order, values = np.empty(actions, np.int64), np.empty(actions)
    count = 0
    for action in range(actions):
        if not tells(problem, action, causes):
            continue
        value = estimate(problem, table, action, causes, situation)
        count = insert(action, value, order, values, count)
    return order, values, count


@compiled
def solve(problem: Partition, table: Memo, causes: int, situation: int, limit: float) -> float:
    """The value of a state if it is below `limit`; otherwise, or when the budget is spent, a lower bound of it."""
    known = lower(problem, table, causes, situation)
    at = slot(table, causes, situation)
    if table.exact[at] or known >= limit or table.counts[STATUS] != RUNNING:
        return known
    expand(table)
    order, values, count = ranked(problem, table, causes, situation)
    best, floor = limit, np.inf
    for rank in range(count):
        action = order[rank]
        value = estimate(problem, table, action, causes, situation)  # more may be known by now
        after = problem.following[situation, action]
        for outcome in range(problem.masks.shape[1]):
            part = causes & problem.masks[action, outcome]
            if value < best and part != 0 and not problem.ends[action, outcome]:
                guess = lower(problem, table, part, after)
                value += solve(problem, table, part, after, best - value + guess) - guess
        floor, best = min(floor, value), min(best, value)
        if rank + 1 < count and values[rank + 1] >= best:  # so are all that follow
            floor = min(floor, values[rank + 1])
            break
    return conclude(table, causes, situation, floor, limit)
