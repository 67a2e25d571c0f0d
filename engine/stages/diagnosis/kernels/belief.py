# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False, initializedcheck=False
# cython: cdivision=True
"""Exact search if outcomes are uncertain: a state is the causes still possible and the outcomes seen, in two
words.

The branch and bound is the same as over partitions. Beliefs are kept as weights: the prior times the
likelihoods of what was seen. The bound is the cost of the case if the cause were known.
"""

from math import inf

import numpy as np

from engine.kernels.arrays import Floats, Longs, Truths, real, whole
from engine.stages.diagnosis.kernels.memo import Memo
from engine.stages.diagnosis.kernels.ranking import Ranking


class Beliefs:
    """A problem in arrays: C causes, A actions, O outcomes, K situations, G conclusions.

    Each array has two names here: one for NumPy, and one with an underscore for the kernels.
    """

    def __init__(
        self,
        likelihoods: Floats,
        masks: Longs,
        ends: Truths,
        repairs: Truths,
        costs: Floats,
        following: Longs,
        losses: Floats,
        known: Floats,
        shifts: Longs,
        widths: Longs,
        situations: int,
    ) -> None:
        """Takes the arrays of a problem. Raises `ValueError` if their shapes do not agree.

        `likelihoods` (A, O, C). `masks` (A, O): the causes under which an outcome is possible. `ends` (A, O):
        the outcomes that end the case; `repairs` (A,): the actions that have such an outcome. `costs` and
        `following` (K, A). `losses` (G, C) of the conclusions. `known` (C,): a lower bound of the cost if c
        were known. The second word of a key, `rest`, has the situation in its lowest bits (`situations` of
        them). At `shifts` (A,) it has the outcome of action a plus one, in `widths` (A,) bits; actions with
        certain outcomes have no bits.
        """
        self.actions, self.outcomes, self.causes = likelihoods.shape
        self.conclusions, self.changes = len(losses), len(costs)
        table, row = (self.actions, self.outcomes), (self.actions,)
        agree = masks.shape == ends.shape == table and repairs.shape == shifts.shape == widths.shape == row
        agree = agree and costs.shape == following.shape == (self.changes, self.actions)
        if not agree or losses.shape[1:] != (self.causes,) or known.shape != (self.causes,):
            raise ValueError(f"the arrays of a problem do not fit likelihoods {likelihoods.shape}")
        self.likelihoods, self.masks, self.ends, self.repairs = likelihoods, masks, ends, repairs
        self.costs, self.following, self.losses, self.known = costs, following, losses, known
        self.shifts, self.widths, self.situations = shifts, widths, situations
        self._likelihoods, self._masks = real(likelihoods), whole(masks)
        self._ends, self._repairs = whole(ends.view(np.uint8)), whole(repairs.view(np.uint8))
        self._costs, self._following = real(costs), whole(following)
        self._losses, self._known = real(losses), real(known)
        self._shifts, self._widths = whole(shifts), whole(widths)


class Trail:
    """Weights (levels, C) on the way from one state to others, and the `ranking` of the actions at each
    level.

    No way is longer than the number of actions, because an action that was done brings no new information.
    """

    def __init__(self, problem: Beliefs, weights: Floats) -> None:
        """Begins at level 0 with weights (C,).

        Raises `ValueError` unless there is one weight for each cause.
        """
        if weights.shape != (problem.causes,):
            raise ValueError(f"{problem.causes} weights were expected, not {weights.shape}")
        levels = problem.actions + 2
        rows = np.zeros((levels, problem.causes))
        rows[0] = weights
        self.causes, self.weights = problem.causes, real(rows)
        self.ranking = Ranking(levels, problem.actions)

    def mass(self, level: int) -> float:
        """The sum of the weights."""
        total = 0.0
        for cause in range(self.causes):
            total += self.weights[level, cause]
        return total

    def possible(self, level: int) -> int:
        """The causes that have a positive weight, as a set."""
        found, bit = 0, 1
        for cause in range(self.causes):
            if self.weights[level, cause] > 0.0:
                found |= bit
            bit <<= 1
        return found

    def follow(self, problem: Beliefs, level: int, action: int, outcome: int) -> None:
        """Write the weights of the next level: those after an outcome of an action."""
        for cause in range(self.causes):
            likelihood = problem._likelihoods[action, outcome, cause]
            self.weights[level + 1, cause] = self.weights[level, cause] * likelihood


def stop(problem: Beliefs, trail: Trail, level: int) -> float:
    """The loss of the best conclusion; infinite if none is allowed."""
    best = inf
    for conclusion in range(problem.conclusions):
        loss = 0.0
        for cause in range(problem.causes):
            weight = trail.weights[level, cause]
            if weight > 0.0:
                loss += weight * problem._losses[conclusion, cause]
        best = min(best, loss)
    return best


def floor_of(problem: Beliefs, trail: Trail, level: int) -> float:
    """The least that the case costs with these weights."""
    total = 0.0
    for cause in range(problem.causes):
        total += trail.weights[level, cause] * problem._known[cause]
    return total


def is_done(problem: Beliefs, action: int, rest: int) -> bool:
    """Whether the key has an outcome of an action. It has none for actions whose outcomes are certain."""
    return (rest >> problem._shifts[action]) & ((1 << problem._widths[action]) - 1) != 0


def _ended(problem: Beliefs, trail: Trail, level: int, action: int) -> float:
    """How much of the least cost an action saves by the outcomes that end the case."""
    saved = 0.0
    for outcome in range(problem.outcomes):
        if problem._ends[action, outcome]:
            for cause in range(problem.causes):
                likelihood = problem._likelihoods[action, outcome, cause]
                saved += trail.weights[level, cause] * likelihood * problem._known[cause]
    return saved


def tells(problem: Beliefs, trail: Trail, level: int, action: int, rest: int) -> bool:
    """Whether an action is still open and may end the case or change the belief."""
    if is_done(problem, action, rest):
        return False
    for outcome in range(problem.outcomes):
        first, ends = -1.0, problem._ends[action, outcome] != 0
        for cause in range(problem.causes):
            if trail.weights[level, cause] > 0.0:
                value = problem._likelihoods[action, outcome, cause]
                if (ends and value > 0.0) or (first >= 0.0 and value != first):
                    return True
                first = value
    return False


def situation_of(problem: Beliefs, rest: int) -> int:
    """The situation in a key."""
    return rest & ((1 << problem.situations) - 1)


def rest_after(problem: Beliefs, action: int, outcome: int, rest: int) -> int:
    """The second word of the key after an outcome of an action."""
    situation = situation_of(problem, rest)
    after = rest ^ situation ^ problem._following[situation, action]
    if problem._widths[action]:
        after |= (outcome + 1) << problem._shifts[action]
    return after


def lower(problem: Beliefs, table: Memo, trail: Trail, level: int, rest: int) -> float:
    """The lower bound known so far: stop now, or pay for a step and then the bounds of what follows."""
    causes = trail.possible(level)
    at = table.slot(causes, rest)
    if table.possible[at] != 0:
        return table.value[at]
    stopping, base = stop(problem, trail, level), floor_of(problem, trail, level)
    least, total, situation = inf, trail.mass(level), situation_of(problem, rest)
    for action in range(problem.actions):
        if base < stopping and not is_done(problem, action, rest):
            value = problem._costs[situation, action] * total + base
            if problem._repairs[action]:
                value -= _ended(problem, trail, level, action)
            least = min(least, value)
    least = max(least, base)
    table.enter(at, causes, rest, min(stopping, least), stopping <= least)
    return table.value[at]


def estimate(
    problem: Beliefs, table: Memo, trail: Trail, level: int, action: int, causes: int, rest: int
) -> float:
    """A lower bound on the cost of beginning with an action."""
    value = problem._costs[situation_of(problem, rest), action] * trail.mass(level)
    for outcome in range(problem.outcomes):
        if causes & problem._masks[action, outcome] and not problem._ends[action, outcome]:
            trail.follow(problem, level, action, outcome)
            value += lower(problem, table, trail, level + 1, rest_after(problem, action, outcome, rest))
    return value


def ranked(problem: Beliefs, table: Memo, trail: Trail, level: int, causes: int, rest: int) -> int:
    """Rank the useful actions by the lower bounds of beginning with them.

    Returns the number of these actions.
    """
    count = 0
    for action in range(problem.actions):
        if tells(problem, trail, level, action, rest):
            value = estimate(problem, table, trail, level, action, causes, rest)
            count = trail.ranking.insert(level, action, value, count)
    return count


def solve(problem: Beliefs, table: Memo, trail: Trail, level: int, rest: int, limit: float) -> float:
    """The value of a state if it is below `limit`. Otherwise, or if the budget is spent, a lower bound."""
    known, causes = lower(problem, table, trail, level, rest), trail.possible(level)
    if table.exact[table.slot(causes, rest)] or known >= limit or table.spent or table.full:
        return known
    table.expand()
    count = ranked(problem, table, trail, level, causes, rest)
    floor = stop(problem, trail, level)
    best = min(limit, floor)
    for rank in range(count):
        action = trail.ranking.order[level, rank]
        value = estimate(
            problem, table, trail, level, action, causes, rest
        )  # the table may have a better bound by now
        for outcome in range(problem.outcomes):
            seen = causes & problem._masks[action, outcome]
            if value < best and seen != 0 and not problem._ends[action, outcome]:
                trail.follow(problem, level, action, outcome)
                then = rest_after(problem, action, outcome, rest)
                guess = lower(problem, table, trail, level + 1, then)
                value += solve(problem, table, trail, level + 1, then, inf) - guess
        floor, best = min(floor, value), min(best, value)
        if (
            rank + 1 < count and trail.ranking.values[level, rank + 1] >= best
        ):  # the following actions are no better
            floor = min(floor, trail.ranking.values[level, rank + 1])
            break
    return table.conclude(causes, rest, floor, limit)
