# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False
# cython: initializedcheck=False, cdivision=True
"""Exact search for certain outcomes: each cause determines every outcome, so a state is the set of
causes still possible.

It is a depth-first branch and bound over the AND/OR graph, with a memo of lower bounds and values.
The bound is the cost of separating pairs of causes that may not be concluded together.
"""

from math import inf

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs, Truths, Words, real, whole
from cellwright.engine.kernels.cancellation import Poll
from cellwright.engine.stages.diagnosis.kernels.memo import Keys, Memo
from cellwright.engine.stages.diagnosis.kernels.ranking import Ranking


class Partition:
    """A problem in sets of W words: bit c of a set stands for cause c.

    A key has one word more: the situation.
    """

    def __init__(
        self,
        masses: Floats,
        masks: Words,
        ends: Truths,
        costs: Floats,
        following: Longs,
        cheapest: Floats,
        goals: Words,
        exempt: Words,
        cures: Floats,
    ) -> None:
        """Takes the arrays of a problem. Raises `ValueError` if their shapes do not agree.

        `masses` (8 W, 256): the probability of each byte of a set. `masks` (A, O, W): the causes
        that give outcome o of action a; an outcome in `ends` (A, O) ends the case. `costs` and
        `following` (K, A) of action a in situation k; `cheapest` (A,) over the situations. `goals`
        (G, W): sets that may be concluded. `exempt` (E, W): disjoint sets within which no pair
        needs to be separated. `cures` (C,): the least cost of ending the case if the cause is
        known.
        """
        self.actions, self.outcomes, self.sets = masks.shape
        self.causes, self.conclusions, self.groups, row = (
            len(cures),
            len(goals),
            len(exempt),
            (self.actions,),
        )
        agree = masses.shape == (8 * self.sets, 256) and ends.shape == masks.shape[:2]
        agree = (
            agree
            and len(cures) <= 64 * self.sets
            and goals.shape[1:] == exempt.shape[1:] == (self.sets,)
        )
        if (
            not agree
            or not costs.shape == following.shape == (len(costs), *row)
            or cheapest.shape != row
        ):
            raise ValueError(f"the arrays of a problem do not fit masks {masks.shape}")
        self.masses, self.masks, self.ends = real(masses), whole(masks), whole(ends.view(np.uint8))
        self.costs, self.following, self.cheapest = real(costs), whole(following), real(cheapest)
        self.goals, self.exempt, self.cures = whole(goals), whole(exempt), real(cures)


class Room:
    """Working space of a search: key and ranking of the actions at each level (the last ones for
    bounds), and blocks.

    No way is longer than the number of actions, because an action that was done brings no new
    information.
    """

    def __init__(
        self, problem: Partition, causes: int, situation: int, poll: Poll | None = None
    ) -> None:
        """Begins at level 0 with a set of causes and a situation."""
        self.last = problem.actions + 1
        self.keys = Keys(self.last + 1, problem.sets + 1)
        self.ranking = Ranking(self.last + 1, problem.actions)
        self.blocks = Keys(problem.causes + 1, problem.sets)
        self.part = Keys(1, problem.sets)
        self.poll = Poll() if poll is None else poll
        self.keys.write(0, 0, problem.sets, causes)
        self.keys.write(0, problem.sets, problem.sets + 1, situation)

    def follow(self, problem: Partition, level: int, action: int, outcome: int) -> bool:
        """Write the next level: the state after an outcome.

        Returns whether any cause is still possible.
        """
        some, last = 0, problem.sets
        for word in range(last):
            part = self.keys.words[level, word] & problem.masks[action, outcome, word]
            self.keys.words[level + 1, word] = part
            some |= part
        self.keys.words[level + 1, last] = problem.following[self.keys.words[level, last], action]
        return some != 0


def mass(problem: Partition, keys: Keys, row: int) -> float:
    """The prior probability of a set of causes."""
    total = 0.0
    for word in range(problem.sets):
        causes, byte = keys.words[row, word], 8 * word
        while causes != 0:
            total += problem.masses[byte, causes & 255]
            causes >>= 8
            byte += 1
    return total


def shared(problem: Partition, keys: Keys, row: int, action: int, outcome: int) -> float:
    """The prior probability of those causes of a set that give an outcome."""
    total = 0.0
    for word in range(problem.sets):
        causes, byte = keys.words[row, word] & problem.masks[action, outcome, word], 8 * word
        while causes != 0:
            total += problem.masses[byte, causes & 255]
            causes >>= 8
            byte += 1
    return total


def is_final(problem: Partition, keys: Keys, row: int) -> bool:
    """Whether a conclusion is allowed while all of these causes are possible."""
    for goal in range(problem.conclusions):
        beyond, word = 0, 0
        while word < problem.sets and beyond == 0:
            beyond = keys.words[row, word] & ~problem.goals[goal, word]
            word += 1
        if beyond == 0:
            return True
    return False


def tells(problem: Partition, keys: Keys, row: int, action: int) -> bool:
    """Whether an action can end the case or leave fewer causes."""
    for outcome in range(problem.outcomes):
        beyond, word = 0, 0
        while word < problem.sets and beyond == 0:
            beyond = keys.words[row, word] & ~problem.masks[action, outcome, word]
            word += 1
        if beyond == 0:
            return problem.ends[action, outcome] != 0
    return True


def _unlike(problem: Partition, keys: Keys, row: int, action: int, total: float) -> float:
    """The weight p_i p_j of the pairs that an action separates within a set of mass `total`."""
    squares = 0.0
    for outcome in range(problem.outcomes):
        part = shared(problem, keys, row, action, outcome)
        squares += part * part
    return 0.5 * (total * total - squares)


def _needed(problem: Partition, room: Room, row: int, action: int) -> float:
    """The weight of the pairs of a block that an action separates and that may not be concluded
    together.
    """
    weight = _unlike(problem, room.blocks, row, action, mass(problem, room.blocks, row))
    for group in range(problem.groups):
        for word in range(problem.sets):
            room.part.words[0, word] = room.blocks.words[row, word] & problem.exempt[group, word]
        if several(problem, room.part, 0):
            weight -= _unlike(problem, room.part, 0, action, mass(problem, room.part, 0))
    return weight


def several(problem: Partition, keys: Keys, row: int) -> bool:
    """Whether a set has more than one cause."""
    found = False
    for word in range(problem.sets):
        causes = keys.words[row, word]
        if causes != 0:
            if found or causes & (causes - 1) != 0:
                return True
            found = True
    return False


def _split(
    problem: Partition, room: Room, index: int, action: int, outcome: int, count: int
) -> bool:
    """Move the causes of a block that give an outcome to block `count`, if they are some but
    not all.
    """
    some, other = 0, 0
    for word in range(problem.sets):
        part = room.blocks.words[index, word] & problem.masks[action, outcome, word]
        some |= part
        other |= room.blocks.words[index, word] ^ part
        room.blocks.words[count, word] = part
    if some == 0 or other == 0:
        return False
    for word in range(problem.sets):
        room.blocks.words[index, word] ^= room.blocks.words[count, word]
    return True


def _refine(problem: Partition, room: Room, action: int, count: int) -> tuple[int, float]:
    """Split blocks by the outcomes of an action. Blocks of one cause are dropped.

    Returns the number of blocks and the weight of the pairs that this separates.
    """
    weight, index = 0.0, 0
    first = count
    while index < first:
        if not tells(problem, room.blocks, index, action):
            index += 1
            continue
        weight += _needed(problem, room, index, action)
        for outcome in range(problem.outcomes):
            if _split(problem, room, index, action, outcome, count):
                count += several(problem, room.blocks, count)
        if several(problem, room.blocks, index):
            index += 1
        else:
            first, count = first - 1, count - 1
            _move(problem, room, first, index)
            _move(problem, room, count, first)
    return count, weight


def _move(problem: Partition, room: Room, origin: int, place: int) -> None:
    for word in range(problem.sets):
        room.blocks.words[place, word] = room.blocks.words[origin, word]


def bound(problem: Partition, room: Room, row: int) -> float:
    """A lower bound of the weighted cost from the state at a level.

    Each pair (i, j) that may not be concluded together is separated at one state only. A state of
    mass P where action a separates pairs of weight W costs c P, that is c P / W for each unit of
    weight. In a smaller state W / P is smaller, so no pair ever costs less than its cheapest rate
    here.
    """
    total, ranking = mass(problem, room.keys, row), room.ranking
    count = 0
    for action in range(problem.actions):
        weight = _unlike(problem, room.keys, row, action, total)
        if weight > 1e-15 * total * total:
            rate = problem.cheapest[action] * total / weight
            count = ranking.insert(room.last, action, rate, count)
    for word in range(problem.sets):
        room.blocks.words[0, word] = room.keys.words[row, word]
    parts, cost, index = 1, 0.0, 0
    while index < count and parts > 0:
        parts, weight = _refine(problem, room, ranking.order[room.last, index], parts)
        cost += ranking.values[room.last, index] * weight
        index += 1
    return max(cost * (1.0 - 1e-12), _cure_cost(problem, room.keys, row))


def _cure_cost(problem: Partition, keys: Keys, row: int) -> float:
    """The least cost of ending the case if the cause were known."""
    cost = 0.0
    for cause in range(problem.causes):
        if problem.cures[cause] > 0.0 and (keys.words[row, cause >> 6] >> (cause & 63)) & 1:
            cost += problem.cures[cause] * problem.masses[cause >> 3, 1 << (cause & 7)]
    return cost


def lower(problem: Partition, table: Memo, room: Room, level: int) -> float:
    """The lower bound that is known so far."""
    at = table.slot(room.keys, level)
    if not table.used[at]:
        final = is_final(problem, room.keys, level)
        table.enter(at, room.keys, level, 0.0 if final else bound(problem, room, level), final)
    return table.value[at]


def estimate(problem: Partition, table: Memo, room: Room, level: int, action: int) -> float:
    """A lower bound on the cost of beginning with an action."""
    value = problem.costs[room.keys.words[level, problem.sets], action] * mass(
        problem, room.keys, level
    )
    for outcome in range(problem.outcomes):
        if not problem.ends[action, outcome] and room.follow(problem, level, action, outcome):
            value += lower(problem, table, room, level + 1)
    return value


def ranked(problem: Partition, table: Memo, room: Room, level: int) -> int:
    """Rank the useful actions by the lower bounds of beginning with them, and count them."""
    count = 0
    for action in range(problem.actions):
        if room.poll.due(problem.outcomes * problem.actions * problem.causes):
            table.halt()
        if not room.poll.stopped and not table.full and tells(problem, room.keys, level, action):
            value = estimate(problem, table, room, level, action)
            count = room.ranking.insert(level, action, value, count)
    return count


def begun(
    problem: Partition, table: Memo, room: Room, level: int, action: int, best: float
) -> float:
    """The cost of beginning with an action.

    If it is not below `best`, or the search ends, a lower bound.
    """
    # the table may have a better bound by now
    value = estimate(problem, table, room, level, action)
    for outcome in range(problem.outcomes):
        going = value < best and not table.full and not problem.ends[action, outcome]
        if going and room.follow(problem, level, action, outcome):
            guess = lower(problem, table, room, level + 1)
            value += solve(problem, table, room, level + 1, best - value + guess) - guess
    return value


def solve(problem: Partition, table: Memo, room: Room, level: int, limit: float) -> float:
    """The value of a state if it is below `limit`.

    Otherwise, or if the budget is spent, a lower bound.
    """
    known = lower(problem, table, room, level)
    if table.exact[table.slot(room.keys, level)] or known >= limit or table.spent or table.full:
        return known
    table.expand()
    count = ranked(problem, table, room, level)
    if room.poll.stopped:
        return known
    best, floor = limit, inf
    for rank in range(count):
        if table.full:
            return known
        value = begun(problem, table, room, level, room.ranking.order[level, rank], best)
        floor, best = min(floor, value), min(best, value)
        if rank + 1 < count and room.ranking.values[level, rank + 1] >= best:
            # the following actions are no better
            floor = min(floor, room.ranking.values[level, rank + 1])
            break
    return table.conclude(room.keys, level, floor, limit)
