# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False, initializedcheck=False
# cython: cdivision=True
"""Exact search if every cause determines every outcome: a state is the set of causes still possible, in one
word.

It is a depth-first branch and bound over the AND/OR graph, with a memo of lower bounds and values. The bound
is the cost of separating pairs of causes that may not be concluded together.
"""

from math import inf

import numpy as np

from engine.kernels.arrays import Floats, Longs, Truths, real, whole
from engine.stages.diagnosis.kernels.memo import Memo
from engine.stages.diagnosis.kernels.ranking import Ranking


class Partition:
    """A problem in words: bit c of a mask stands for cause c."""

    def __init__(
        self,
        masses: Floats,
        masks: Longs,
        ends: Truths,
        costs: Floats,
        following: Longs,
        cheapest: Floats,
        goals: Longs,
        exempt: Longs,
        cures: Floats,
    ) -> None:
        """Takes the arrays of a problem. Raises `ValueError` if their shapes do not agree.

        `masses` (8, 256): the probability of each byte of a set. `masks` (A, O): the causes that give outcome
        o of action a; an outcome in `ends` (A, O) ends the case. `costs` and `following` (K, A) of action a
        in situation k; `cheapest` (A,) over the situations. `goals` (G,): sets that may be concluded.
        `exempt` (E,): disjoint sets within which no pair needs to be separated. `cures` (C,): the least cost
        of ending the case if the cause is known.
        """
        self.actions, self.outcomes = masks.shape
        self.conclusions, self.groups, row = len(goals), len(exempt), (self.actions,)
        agree = masses.shape == (8, 256) and ends.shape == masks.shape and len(cures) <= 64
        if not agree or not costs.shape == following.shape == (len(costs), *row) or cheapest.shape != row:
            raise ValueError(f"the arrays of a problem do not fit masks {masks.shape}")
        self.masses, self.masks, self.ends = real(masses), whole(masks), whole(ends.view(np.uint8))
        self.costs, self.following, self.cheapest = real(costs), whole(following), real(cheapest)
        self.goals, self.exempt, self.cures = whole(goals), whole(exempt), real(cures)


class Room:
    """Working space of a search: the ranking of the actions at each level (the last one for bounds), and
    blocks of causes (64,).

    No way is longer than the number of actions, because an action that was done brings no new information.
    """

    def __init__(self, problem: Partition) -> None:
        self.last = problem.actions + 1
        self.ranking = Ranking(self.last + 1, problem.actions)
        self.blocks = whole(np.empty(64, np.int64))


def mass(problem: Partition, causes: int) -> float:
    """The prior probability of a set of causes."""
    total, byte = 0.0, 0
    while causes != 0:
        total += problem.masses[byte, causes & 255]
        causes >>= 8
        byte += 1
    return total


def is_final(problem: Partition, causes: int) -> bool:
    """Whether a conclusion is allowed while all of these causes are possible."""
    for goal in range(problem.conclusions):  # noqa: SIM110  (`any` over a generator would not compile to a loop)
        if causes & ~problem.goals[goal] == 0:
            return True
    return False


def tells(problem: Partition, action: int, causes: int) -> bool:
    """Whether an action can end the case or leave fewer causes."""
    for outcome in range(problem.outcomes):
        if causes & ~problem.masks[action, outcome] == 0:
            return problem.ends[action, outcome] != 0
    return True


def _unlike(problem: Partition, action: int, causes: int, total: float) -> float:
    """The weight p_i p_j of the pairs that an action separates within a set of mass `total`."""
    squares = 0.0
    for outcome in range(problem.outcomes):
        part = mass(problem, causes & problem.masks[action, outcome])
        squares += part * part
    return 0.5 * (total * total - squares)


def _needed(problem: Partition, action: int, causes: int, total: float) -> float:
    """The same as `_unlike`, without pairs that may be concluded together."""
    weight = _unlike(problem, action, causes, total)
    for group in range(problem.groups):
        part = causes & problem.exempt[group]
        if part & (part - 1) != 0:
            weight -= _unlike(problem, action, part, mass(problem, part))
    return weight


def _refine(problem: Partition, room: Room, action: int, count: int) -> tuple[int, float]:
    """Split blocks by the outcomes of an action.

    Returns the number of blocks and the weight of the pairs that this separates.
    """
    weight, last = 0.0, count
    for index in range(last):
        block = room.blocks[index]
        if block & (block - 1) == 0:
            continue
        left = block
        for outcome in range(problem.outcomes):
            part = left & problem.masks[action, outcome]
            if part != 0 and part != left:
                room.blocks[count] = part
                count += 1
                left ^= part
        if left != block:
            weight += _needed(problem, action, block, mass(problem, block))
            room.blocks[index] = left
    return count, weight


def bound(problem: Partition, room: Room, causes: int) -> float:
    """A lower bound of the weighted cost from here.

    Each pair (i, j) that may not be concluded together is separated at one state only. A state of mass P
    where action a separates pairs of weight W costs c P, that is c P / W for each unit of weight. In a
    smaller state W / P is smaller, so no pair ever costs less than its cheapest rate here.
    """
    total, ranking = mass(problem, causes), room.ranking
    count = 0
    for action in range(problem.actions):
        weight = _unlike(problem, action, causes, total)
        if weight > 1e-15 * total * total:
            rate = problem.cheapest[action] * total / weight
            count = ranking.insert(room.last, action, rate, count)
    room.blocks[0] = causes
    parts, cost = 1, 0.0
    for index in range(count):
        parts, weight = _refine(problem, room, ranking.order[room.last, index], parts)
        cost += ranking.values[room.last, index] * weight
    return max(cost * (1.0 - 1e-12), _cure_cost(problem, causes))


def _cure_cost(problem: Partition, causes: int) -> float:
    """The least cost of ending the case if the cause were known."""
    cost, cause = 0.0, 0
    while causes >> cause != 0:
        if (causes >> cause) & 1 and problem.cures[cause] > 0.0:
            cost += problem.cures[cause] * problem.masses[cause >> 3, 1 << (cause & 7)]
        cause += 1
    return cost


def lower(problem: Partition, table: Memo, room: Room, causes: int, situation: int) -> float:
    """The lower bound that is known so far."""
    at = table.slot(causes, situation)
    if table.possible[at] == 0:
        final = is_final(problem, causes)
        table.enter(at, causes, situation, 0.0 if final else bound(problem, room, causes), final)
    return table.value[at]


def estimate(problem: Partition, table: Memo, room: Room, action: int, causes: int, situation: int) -> float:
    """A lower bound on the cost of beginning with an action."""
    value = problem.costs[situation, action] * mass(problem, causes)
    after = problem.following[situation, action]
    for outcome in range(problem.outcomes):
        part = causes & problem.masks[action, outcome]
        if part != 0 and not problem.ends[action, outcome]:
            value += lower(problem, table, room, part, after)
    return value


def ranked(problem: Partition, table: Memo, room: Room, level: int, causes: int, situation: int) -> int:
    """Rank the useful actions by the lower bounds of beginning with them.

    Returns the number of these actions.
    """
    count = 0
    for action in range(problem.actions):
        if tells(problem, action, causes):
            value = estimate(problem, table, room, action, causes, situation)
            count = room.ranking.insert(level, action, value, count)
    return count


def solve(
    problem: Partition, table: Memo, room: Room, level: int, causes: int, situation: int, limit: float
) -> float:
    """The value of a state if it is below `limit`. Otherwise, or if the budget is spent, a lower bound."""
    known = lower(problem, table, room, causes, situation)
    if table.exact[table.slot(causes, situation)] or known >= limit or table.spent or table.full:
        return known
    table.expand()
    count = ranked(problem, table, room, level, causes, situation)
    best, floor = limit, inf
    for rank in range(count):
        action = room.ranking.order[level, rank]
        value = estimate(
            problem, table, room, action, causes, situation
        )  # the table may have a better bound by now
        after = problem.following[situation, action]
        for outcome in range(problem.outcomes):
            part = causes & problem.masks[action, outcome]
            if value < best and part != 0 and not problem.ends[action, outcome]:
                guess = lower(problem, table, room, part, after)
                value += solve(problem, table, room, level + 1, part, after, best - value + guess) - guess
        floor, best = min(floor, value), min(best, value)
        if (
            rank + 1 < count and room.ranking.values[level, rank + 1] >= best
        ):  # the following actions are no better
            floor = min(floor, room.ranking.values[level, rank + 1])
            break
    return table.conclude(causes, situation, floor, limit)
