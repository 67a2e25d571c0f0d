"""Exact search where outcomes are uncertain: a state is the causes still possible and the outcomes seen, in two words.

The same branch and bound as over partitions; beliefs are carried along as weights, the prior times the likelihoods of
what was seen. The bound is what the case would cost if the cause were known.
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


class Beliefs(NamedTuple):
    """A problem in arrays: C causes, A actions, O outcomes, K situations, G conclusions.

    `likelihoods` (A, O, C); `masks` (A, O) the causes under which an outcome is possible; `ends` (A, O), and `repairs` (A,) the actions that have one; `costs` and
    `following` (K, A); `losses` (G, C) of the conclusions; `known` (C,) a lower bound of the cost if c were known.
    The rest of a key is the situation in its lowest bits and, at `shifts` (A,), the outcome of action a plus one in
    `widths` (A,) bits, none for actions whose outcomes are certain.
    """

    likelihoods: Floats
    masks: Longs
    ends: Flags
    repairs: Flags
    costs: Floats
    following: Longs
    losses: Floats
    known: Floats
    shifts: Longs
    widths: Longs
    situations: int


@compiled
def stop(problem: Beliefs, weights: Floats) -> float:
    """The loss of the best conclusion; infinite where none may be drawn."""
    best = np.inf
    for conclusion in range(problem.losses.shape[0]):
        loss = 0.0
        for cause in range(weights.shape[0]):
            if weights[cause] > 0.0:
                loss += weights[cause] * problem.losses[conclusion, cause]
        best = min(best, loss)
    return best


@compiled
def floor_of(problem: Beliefs, weights: Floats) -> float:
    """What the case costs at least from these weights."""
    total = 0.0
    for cause in range(weights.shape[0]):
        total += weights[cause] * problem.known[cause]
    return total


@compiled
def is_done(problem: Beliefs, action: int, rest: int) -> bool:
    """Whether the key tells an outcome of an action; of those whose outcomes are certain it tells none."""
    return bool((rest >> problem.shifts[action]) & ((1 << problem.widths[action]) - 1))


@compiled
def _ended(problem: Beliefs, action: int, weights: Floats) -> float:
    """What an action saves of the least cost by the outcomes that end the case."""
    saved = 0.0
    for outcome in range(problem.masks.shape[1]):
        if problem.ends[action, outcome]:
            for cause in range(weights.shape[0]):
                saved += weights[cause] * problem.likelihoods[action, outcome, cause] * problem.known[cause]
    return saved


@compiled
def tells(problem: Beliefs, action: int, weights: Floats, rest: int) -> bool:
    """Whether an action is still to be done and may end the case or change the belief."""
    if is_done(problem, action, rest):
        return False
    for outcome in range(problem.likelihoods.shape[1]):
        first = -1.0
        for cause in range(weights.shape[0]):
            if weights[cause] > 0.0:
                value = problem.likelihoods[action, outcome, cause]
                if (problem.ends[action, outcome] and value > 0.0) or (first >= 0.0 and value != first):
                    return True
                first = value
    return False


@compiled
def situation_of(problem: Beliefs, rest: int) -> int:
    """The situation that a key names."""
    return rest & ((1 << problem.situations) - 1)


@compiled
def rest_after(problem: Beliefs, action: int, outcome: int, rest: int) -> int:
    """The rest of the key when an action had an outcome."""
    situation = situation_of(problem, rest)
    after = rest ^ situation ^ problem.following[situation, action]
    return int(after | ((outcome + 1) << problem.shifts[action]) if problem.widths[action] else after)


@compiled
def weights_after(problem: Beliefs, action: int, outcome: int, weights: Floats) -> Floats:
    """The weights when an action had an outcome."""
    after: Floats = weights * problem.likelihoods[action, outcome]
    return after


@compiled
def possible(weights: Floats) -> int:
    """The causes that have a weight, as a set."""
    found = 0
    for cause in range(weights.shape[0]):
        if weights[cause] > 0.0:
            found |= 1 << cause
    return found


@compiled
def lower(problem: Beliefs, table: Memo, weights: Floats, rest: int) -> float:
    """What is known so far of the value from below: stop now, or pay for a step and then at least for what is known."""
    causes = possible(weights)
    at = slot(table, causes, rest)
    if table.possible[at] != 0:
        return float(table.value[at])
    stopping, base, total = stop(problem, weights), floor_of(problem, weights), weights.sum()
    least, situation = np.inf, situation_of(problem, rest)
    for action in range(problem.masks.shape[0]):
        if base < stopping and not is_done(problem, action, rest):
            value = problem.costs[situation, action] * total + base
            if problem.repairs[action]:
                value -= _ended(problem, action, weights)
            least = min(least, value)
    enter(table, at, causes, rest, min(stopping, max(least, base)), stopping <= max(least, base))
    return float(table.value[at])


@compiled
def estimate(problem: Beliefs, table: Memo, action: int, causes: int, weights: Floats, rest: int) -> float:
    """A lower bound of beginning with an action."""
    value = problem.costs[situation_of(problem, rest), action] * weights.sum()
    for outcome in range(problem.masks.shape[1]):
        if causes & problem.masks[action, outcome] and not problem.ends[action, outcome]:
            after = weights_after(problem, action, outcome, weights)
            value += lower(problem, table, after, rest_after(problem, action, outcome, rest))
    return float(value)


@compiled
def ranked(problem: Beliefs, table: Memo, weights: Floats, rest: int) -> tuple[Longs, Floats, int]:
    """The actions that tell something, by the lower bound of beginning with them; how many there are."""
    actions, causes = problem.masks.shape[0], possible(weights)
    order, values = np.empty(actions, np.int64), np.empty(actions)
    count = 0
    for action in range(actions):
        if not tells(problem, action, weights, rest):
            continue
        value = estimate(problem, table, action, causes, weights, rest)
        count = insert(action, value, order, values, count)
    return order, values, count


@compiled
def solve(problem: Beliefs, table: Memo, weights: Floats, rest: int, limit: float) -> float:
    """The value of a state if it is below `limit`; otherwise, or when the budget is spent, a lower bound of it."""
    known, causes = lower(problem, table, weights, rest), possible(weights)
    at = slot(table, causes, rest)
    if table.exact[at] or known >= limit or table.counts[STATUS] != RUNNING:
        return known
    expand(table)
    order, values, count = ranked(problem, table, weights, rest)
    floor = stop(problem, weights)
    best = min(limit, floor)
    for rank in range(count):
        action = order[rank]
        value = estimate(problem, table, action, causes, weights, rest)  # more may be known by now
        for outcome in range(problem.masks.shape[1]):
            seen = causes & problem.masks[action, outcome]
            if value < best and seen != 0 and not problem.ends[action, outcome]:
                after = weights_after(problem, action, outcome, weights)
                then = rest_after(problem, action, outcome, rest)
                guess = lower(problem, table, after, then)
                value += solve(problem, table, after, then, np.inf) - guess
        floor, best = min(floor, value), min(best, value)
        if rank + 1 < count and values[rank + 1] >= best:  # so are all that follow
            floor = min(floor, values[rank + 1])
            break
    return conclude(table, causes, rest, floor, limit)
