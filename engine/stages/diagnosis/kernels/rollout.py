# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False, initializedcheck=False
# cython: cdivision=True
"""One-step rules, the cost of following them, and rollout of two steps with such a rule as base policy.

Bertsekas, Tsitsiklis & Wu 1997: lookahead over the cost of a base policy is never worse than this policy.
Here each leaf takes the cheapest of several base policies; this remains true.
"""

import math
from math import inf

import numpy as np

from engine.kernels.arrays import Longs, real, whole
from engine.stages.diagnosis.kernels.belief import Beliefs, Trail, rest_after, situation_of, stop, tells
from engine.stages.diagnosis.kernels.memo import Memo

Bases = tuple[Memo, Memo, Memo]

GAIN, PAIRS, CURES, MILD = 0, 1, 2, 3
RULES: dict[str, int] = {"gain": GAIN, "pairs": PAIRS, "p/c": CURES}


class Groups:
    """For each cause (C,) the number of its group, at most C groups; and working space for their masses."""

    def __init__(self, problem: Beliefs, groups: Longs) -> None:
        """Raises `ValueError` unless there is a group for each cause."""
        if groups.shape != (problem.causes,) or not ((groups >= 0) & (groups < problem.causes)).all():
            raise ValueError(f"a group below {problem.causes} was expected for each cause, not {groups}")
        self.count, self.group = problem.causes, whole(groups)
        self.mass = real(np.zeros(problem.causes))


def uncertainty(trail: Trail, level: int, groups: Groups, rule: int) -> float:
    """The entropy (bits) over groups of causes, times the mass.

    For the rule `PAIRS`: the weight of pairs of different groups, divided by the mass.
    """
    total, found = trail.mass(level), 0.0
    if total <= 0.0:
        return 0.0
    for group in range(groups.count):
        groups.mass[group] = 0.0
    for cause in range(groups.count):
        groups.mass[groups.group[cause]] += trail.weights[level, cause]
    for group in range(groups.count):
        part = groups.mass[group]
        if rule == PAIRS:
            found += 0.5 * part * (total - part) / total
        elif part > 0.0:
            found -= part * math.log2(part / total)
    return found


def _price(problem: Beliefs, action: int, rest: int, rule: int) -> float:
    """The cost of an action as a rule counts it.

    `MILD` gives costs less weight: it takes the square root of the cost or, with set-up, the cost without it.
    """
    cost = problem._costs[situation_of(problem, rest), action]
    if rule == MILD and problem.changes > 1:
        for situation in range(problem.changes):
            cost = min(cost, problem._costs[situation, action])
    elif rule == MILD:
        cost = math.sqrt(cost)
    return max(cost, 1e-9)


def index(
    problem: Beliefs, groups: Groups, action: int, trail: Trail, level: int, rest: int, rule: int
) -> float:
    """The worth of an action by a rule, per unit of cost; larger is better."""
    left, ended = 0.0, 0.0
    for outcome in range(problem.outcomes):
        if problem._ends[action, outcome]:
            trail.follow(problem, level, action, outcome)
            ended += trail.mass(level + 1)
        elif rule != CURES:
            trail.follow(problem, level, action, outcome)
            left += uncertainty(trail, level + 1, groups, rule)
    gain = ended if rule == CURES else uncertainty(trail, level, groups, rule) - left
    return gain / _price(problem, action, rest, rule)


def _preferred(
    problem: Beliefs, groups: Groups, trail: Trail, level: int, rest: int, rule: int
) -> tuple[int, float]:
    """The first action with the largest index, and this index; -1 if no action is useful."""
    best, value = -1, -inf
    for action in range(problem.actions):
        if tells(problem, trail, level, action, rest):
            this = index(problem, groups, action, trail, level, rest, rule)
            if best < 0 or this > value + 1e-12 * abs(value):
                best, value = action, this
    return best, value


def greedy(problem: Beliefs, groups: Groups, trail: Trail, level: int, rest: int, rule: int) -> int:
    """The action that a rule prefers; -1 if no action is useful.

    By p/c, tests come only if no repair can cure.
    """
    best, value = _preferred(problem, groups, trail, level, rest, rule)
    if rule == CURES and value <= 0.0:
        best, value = _preferred(problem, groups, trail, level, rest, GAIN)
    return best


def follow(
    problem: Beliefs, groups: Groups, table: Memo, trail: Trail, level: int, rest: int, rule: int
) -> float:
    """The weighted cost of following a rule, and of stopping if that is cheaper."""
    causes = trail.possible(level)
    at = table.slot(causes, rest)
    if table.possible[at] != 0 or table.full:
        return table.value[
            at
        ]  # if the table is full, the value is not used: the caller asks again with a longer table
    value = stop(problem, trail, level)
    action = greedy(problem, groups, trail, level, rest, rule)
    if action >= 0 and value > 0.0:
        going = problem._costs[situation_of(problem, rest), action] * trail.mass(level)
        for outcome in range(problem.outcomes):
            if causes & problem._masks[action, outcome] and not problem._ends[action, outcome]:
                trail.follow(problem, level, action, outcome)
                then = rest_after(problem, action, outcome, rest)
                going += follow(problem, groups, table, trail, level + 1, then, rule)
        value = min(value, going)
    at = table.slot(causes, rest)
    if table.possible[at] == 0:
        table.enter(at, causes, rest, value, True)
    return value


def base_cost(problem: Beliefs, groups: Groups, bases: Bases, trail: Trail, level: int, rest: int) -> float:
    """The cost of the cheapest base policy."""
    least = follow(problem, groups, bases[0], trail, level, rest, GAIN)
    least = min(least, follow(problem, groups, bases[1], trail, level, rest, PAIRS))
    return min(least, follow(problem, groups, bases[2], trail, level, rest, MILD))


def look_ahead(
    problem: Beliefs,
    groups: Groups,
    bases: Bases,
    trail: Trail,
    level: int,
    rest: int,
    steps: int,
    limit: float,
) -> tuple[int, float]:
    """The best first action and its cost, by a lookahead of `steps` over the base policies; -1 to stop.

    Actions that cannot cost less than `limit` are left early; their cost is then at least `limit`.
    """
    best, value = -1, stop(problem, trail, level)
    if steps == 0 or value <= 0.0:
        return best, min(value, base_cost(problem, groups, bases, trail, level, rest))
    causes, total = trail.possible(level), trail.mass(level)
    for action in range(problem.actions):
        if not tells(problem, trail, level, action, rest):
            continue
        going = problem._costs[situation_of(problem, rest), action] * total
        for outcome in range(problem.outcomes):
            seen = causes & problem._masks[action, outcome]
            if going < min(value, limit) and seen != 0 and not problem._ends[action, outcome]:
                trail.follow(problem, level, action, outcome)
                then = rest_after(problem, action, outcome, rest)
                left = min(value, limit) - going
                going += look_ahead(problem, groups, bases, trail, level + 1, then, steps - 1, left)[1]
        if going < value * (1.0 - 1e-12):
            best, value = action, going
    return best, value
