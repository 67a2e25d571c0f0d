"""One-step rules, what following them costs, and rollout of two steps with such a rule as base policy.

Bertsekas, Tsitsiklis & Wu 1997: choosing by lookahead over the cost of a base policy never does worse than the policy.
Here the leaves take the cheapest of several base policies, which keeps that property.
"""

import numpy as np

from engine.stages.diagnosis.kernels import compiled
from engine.stages.diagnosis.kernels.belief import (
    Beliefs,
    possible,
    rest_after,
    situation_of,
    stop,
    tells,
    weights_after,
)
from engine.stages.diagnosis.kernels.memo import FULL, STATUS, Floats, Longs, Memo, enter, slot

Bases = tuple[Memo, Memo, Memo]

GAIN, PAIRS, CURES, MILD = 0, 1, 2, 3


@compiled
def uncertainty(weights: Floats, groups: Longs, rule: int) -> float:
    """Entropy (bits) over groups of causes, or the weight of pairs of different groups; times or per the mass."""
    mass = np.zeros(groups.shape[0])
    for cause in range(weights.shape[0]):
        mass[groups[cause]] += weights[cause]
    total, found = weights.sum(), 0.0
    if total <= 0.0:
        return 0.0
    for part in mass:
        if rule == PAIRS:
            found += 0.5 * part * (total - part) / total
        elif part > 0.0:
            found -= part * np.log2(part / total)
    return found


@compiled
def index(problem: Beliefs, groups: Longs, action: int, weights: Floats, rest: int, rule: int) -> float:
    """What a rule thinks of an action, per unit of cost; larger is better.

    `MILD` is gain that minds costs less: the square root of a cost or, where there is set-up, the cost without it.
    """
    cost = problem.costs[situation_of(problem, rest), action]
    if rule == MILD:
        cost = problem.costs[:, action].min() if problem.costs.shape[0] > 1 else np.sqrt(cost)
    left, ended = 0.0, 0.0
    for outcome in range(problem.masks.shape[1]):
        after = weights_after(problem, action, outcome, weights)
        if problem.ends[action, outcome]:
            ended += after.sum()
        elif rule != CURES:
            left += uncertainty(after, groups, rule)
    gain = ended if rule == CURES else uncertainty(weights, groups, rule) - left
    return float(gain / max(cost, 1e-9))


@compiled
def _preferred(problem: Beliefs, groups: Longs, weights: Floats, rest: int, rule: int) -> tuple[int, float]:
    """The first action of the largest index, and that; -1 when none tells anything."""
    best, value = -1, -np.inf
    for action in range(problem.masks.shape[0]):
        if tells(problem, action, weights, rest):
            this = index(problem, groups, action, weights, rest, rule)
            if best < 0 or this > value + 1e-12 * abs(value):
                best, value = action, this
    return best, value


@compiled
def greedy(problem: Beliefs, groups: Longs, weights: Floats, rest: int, rule: int) -> int:
    """The action that a rule prefers; -1 when none tells anything. By p/c, tests come when no repair can cure."""
    best, value = _preferred(problem, groups, weights, rest, rule)
    if rule == CURES and value <= 0.0:
        best, value = _preferred(problem, groups, weights, rest, GAIN)
    return best


@compiled
def follow(problem: Beliefs, groups: Longs, table: Memo, weights: Floats, rest: int, rule: int) -> float:
    """The weighted cost of following a rule, stopping where that is cheaper."""
    causes = possible(weights)
    at = slot(table, causes, rest)
    if table.possible[at] != 0 or table.counts[STATUS] == FULL:
        return float(table.value[at])  # of no use if full: the caller asks again with a longer table
    value = stop(problem, weights)
    action = greedy(problem, groups, weights, rest, rule)
    if action >= 0 and value > 0.0:
        going = problem.costs[situation_of(problem, rest), action] * weights.sum()
        for outcome in range(problem.masks.shape[1]):
            if causes & problem.masks[action, outcome] and not problem.ends[action, outcome]:
                after = weights_after(problem, action, outcome, weights)
                then = rest_after(problem, action, outcome, rest)
                going += follow(problem, groups, table, after, then, rule)
        value = min(value, going)
    at = slot(table, causes, rest)
    if table.possible[at] == 0:
        enter(table, at, causes, rest, value, True)
    return float(value)


@compiled
def base_cost(problem: Beliefs, groups: Longs, bases: Bases, weights: Floats, rest: int) -> float:
    """The cost of the cheapest of the base policies."""
    least = follow(problem, groups, bases[0], weights, rest, GAIN)
    least = min(least, follow(problem, groups, bases[1], weights, rest, PAIRS))
    return float(min(least, follow(problem, groups, bases[2], weights, rest, MILD)))


@compiled
def look_ahead(
    problem: Beliefs, groups: Longs, bases: Bases, weights: Floats, rest: int, steps: int, limit: float
) -> tuple[int, float]:
    """The best first action and its cost by a lookahead of `steps` over the base policies; -1 to stop.

    Actions that cannot get below `limit` are left early; the cost is then no less than `limit`.
    """
    best, value = -1, stop(problem, weights)
    if steps == 0 or value <= 0.0:
        return best, min(value, base_cost(problem, groups, bases, weights, rest))
    causes, situation, total = possible(weights), situation_of(problem, rest), weights.sum()
    for action in range(problem.masks.shape[0]):
        if not tells(problem, action, weights, rest):
            continue
        going = problem.costs[situation, action] * total
        for outcome in range(problem.masks.shape[1]):
            seen = causes & problem.masks[action, outcome]
            if going < min(value, limit) and seen != 0 and not problem.ends[action, outcome]:
                after = weights_after(problem, action, outcome, weights)
                then = rest_after(problem, action, outcome, rest)
                left = min(value, limit) - going
                going += look_ahead(problem, groups, bases, after, then, steps - 1, left)[1]
        if going < value * (1.0 - 1e-12):
            best, value = action, going
    return best, value
