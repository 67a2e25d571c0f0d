# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False
# cython: initializedcheck=False, cdivision=True
"""One-step rules, the cost of following them, and rollout of two steps with such a rule as base
policy.

Bertsekas, Tsitsiklis & Wu 1997: lookahead over the cost of a base policy is never worse than this
policy. Here each leaf takes the cheapest of several base policies; this remains true. In large
problems the lookahead tries only the actions that a rule prefers, and a policy is not followed into
branches of little weight: these are charged what they cost at most.
"""

import math
from math import inf

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs, real, whole
from cellwright.engine.stages.diagnosis.kernels.belief import (
    Beliefs,
    Trail,
    is_done,
    situation_of,
    stop,
    tells,
)
from cellwright.engine.stages.diagnosis.kernels.memo import Memo

Bases = tuple[Memo, Memo, Memo]

GAIN, PAIRS, CURES, MILD = 0, 1, 2, 3
RULES: dict[str, int] = {"gain": GAIN, "pairs": PAIRS, "p/c": CURES}


class Groups:
    """For each cause (C,) the number of its group, at most C groups; working space; and the reach
    of policies.

    `dearest` (A,) are the greatest costs of the actions over all situations, and `worst` the
    greatest loss that is possible at the end. Policies do not follow branches with less weight than
    `least`, and try no more than `width` actions at each step of a lookahead.
    """

    def __init__(self, problem: Beliefs, groups: Longs, dearest: Floats, worst: float) -> None:
        """Raises `ValueError` unless there is a group for each cause, and a cost for each
        action.
        """
        if (
            groups.shape != (problem.causes,)
            or not ((groups >= 0) & (groups < problem.causes)).all()
        ):
            raise ValueError(
                f"a group below {problem.causes} was expected for each cause, not {groups}"
            )
        if dearest.shape != (problem.actions,):
            raise ValueError(f"{problem.actions} costs were expected, not {dearest.shape}")
        self.group, self.dearest, self.worst = whole(groups), real(dearest), worst
        alone = np.bincount(groups, minlength=problem.causes)[groups] == 1
        self.alone = whole(alone.view(np.uint8))
        self.mass = real(np.zeros(problem.causes))
        self.own = real(np.zeros(problem.causes))
        self.parts = real(np.zeros(problem.outcomes))
        self.sums = real(np.zeros(problem.outcomes))
        self.together, self.width, self.least = False, problem.actions, 0.0

    def limit(self, width: int, least: float) -> None:
        """Set the number of actions that a lookahead tries, and the weight of branches that are
        not followed.
        """
        self.width, self.least = width, least


def _spread(part: float, total: float, rule: int) -> float:
    """What a group adds to the uncertainty: it has the weight `part` of `total`."""
    if rule == PAIRS:
        return 0.5 * part * (total - part) / total
    return -part * math.log2(part / total) if part > 0.0 else 0.0


def uncertainty(
    problem: Beliefs, trail: Trail, level: int, groups: Groups, rule: int, action: int, outcome: int
) -> float:
    """The entropy (bits) over groups of causes after an outcome, times the mass. Before all, if
    `action` is -1.

    For the rule `PAIRS`: the weight of pairs of different groups, divided by the mass.
    """
    total, found = 0.0, 0.0
    for place in range(trail.counts[level]):
        groups.mass[groups.group[trail.members[level, place]]] = 0.0
    for place in range(trail.counts[level]):
        cause = trail.members[level, place]
        weight = trail.weights[level, cause]
        if action >= 0:
            weight *= problem._likelihoods[action, outcome, cause]
        groups.mass[groups.group[cause]] += weight
        total += weight
    if total <= 0.0:
        return 0.0
    for place in range(trail.counts[level]):
        group = groups.group[trail.members[level, place]]
        if groups.mass[group] > 0.0:
            found += _spread(groups.mass[group], total, rule)
            groups.mass[group] = 0.0
    return found


def prepare(problem: Beliefs, trail: Trail, level: int, groups: Groups, rule: int) -> float:
    """Note what each cause adds to the sums over groups. Returns the uncertainty of a level."""
    groups.together = False
    for place in range(trail.counts[level]):
        cause = trail.members[level, place]
        weight = trail.weights[level, cause]
        groups.own[cause] = weight * weight if rule == PAIRS else weight * math.log2(weight)
        groups.together = groups.together or not groups.alone[cause]
    return uncertainty(problem, trail, level, groups, rule, -1, 0)


def _left(
    problem: Beliefs, groups: Groups, action: int, trail: Trail, level: int, rule: int
) -> float:
    """The uncertainty that is left after an action: the sum over the outcomes that do not end
    the case.
    """
    if not groups.together and problem._shown[action, 0] >= 0:
        return _left_surely(problem, groups, action, trail, level, rule)
    left = 0.0
    for outcome in range(problem.outcomes):
        if not problem._ends[action, outcome]:
            left += uncertainty(problem, trail, level, groups, rule, action, outcome)
    return left


def _left_surely(
    problem: Beliefs, groups: Groups, action: int, trail: Trail, level: int, rule: int
) -> float:
    """The same for a certain action, if every cause is alone in its group: sums of what each
    cause adds.
    """
    left = 0.0
    for outcome in range(problem.outcomes):
        groups.parts[outcome] = 0.0
        groups.sums[outcome] = 0.0
    for place in range(trail.counts[level]):
        cause = trail.members[level, place]
        outcome = problem._shown[action, cause]
        groups.parts[outcome] += trail.weights[level, cause]
        groups.sums[outcome] += groups.own[cause]
    for outcome in range(problem.outcomes):
        part = groups.parts[outcome]
        if part <= 0.0 or problem._ends[action, outcome]:
            continue
        if rule == PAIRS:
            left += max(0.0, 0.5 * (part * part - groups.sums[outcome]) / part)
        else:
            left += max(0.0, part * math.log2(part) - groups.sums[outcome])
    return left


def _ending(problem: Beliefs, trail: Trail, level: int, action: int) -> float:
    """The weight of the outcomes of an action that end the case."""
    ended = 0.0
    for outcome in range(problem.outcomes):
        if problem._ends[action, outcome]:
            for place in range(trail.counts[level]):
                cause = trail.members[level, place]
                ended += trail.weights[level, cause] * problem._likelihoods[action, outcome, cause]
    return ended


def _price(problem: Beliefs, trail: Trail, level: int, action: int, rule: int) -> float:
    """The cost of an action as a rule counts it.

    `MILD` gives costs less weight: it takes the square root of the cost or, with set-up, the cost
    without it.
    """
    cost = problem._costs[situation_of(problem, trail, level), action]
    if rule == MILD and problem.changes > 1:
        for situation in range(problem.changes):
            cost = min(cost, problem._costs[situation, action])
    elif rule == MILD:
        cost = math.sqrt(cost)
    return max(cost, 1e-9)


def index(
    problem: Beliefs,
    groups: Groups,
    action: int,
    trail: Trail,
    level: int,
    rule: int,
    before: float,
) -> float:
    """The worth of an action by a rule, per unit of cost; larger is better.

    `before` comes from `prepare`.
    """
    if rule == CURES:
        gain = _ending(problem, trail, level, action)
    else:
        gain = before - _left(problem, groups, action, trail, level, rule)
    return gain / _price(problem, trail, level, action, rule)


def _preferred(
    problem: Beliefs, groups: Groups, trail: Trail, level: int, rule: int
) -> tuple[int, float]:
    """The first action with the largest index, and this index; -1 if no action is useful."""
    best, value = -1, -inf
    before = prepare(problem, trail, level, groups, rule)
    for action in range(problem.actions):
        trail.poll.due(4 * problem.outcomes * trail.counts[level])
        if not trail.poll.stopped and tells(problem, trail, level, action):
            this = index(problem, groups, action, trail, level, rule, before)
            if best < 0 or this > value + 1e-12 * abs(value):
                best, value = action, this
    return best, value


def greedy(problem: Beliefs, groups: Groups, trail: Trail, level: int, rule: int) -> int:
    """The action that a rule prefers; -1 if no action is useful.

    By p/c, tests come only if no repair can cure.
    """
    best, value = _preferred(problem, groups, trail, level, rule)
    if rule == CURES and value <= 0.0:
        best, value = _preferred(problem, groups, trail, level, GAIN)
    return best


def at_most(problem: Beliefs, groups: Groups, trail: Trail, level: int) -> float:
    """What a state costs at most: stop now, or do everything that is left and then stop."""
    cost = groups.worst
    for action in range(problem.actions):
        if not is_done(problem, trail, level, action):
            cost += groups.dearest[action]
    return min(stop(problem, trail, level), cost * trail.mass(level))


def follow(
    problem: Beliefs, groups: Groups, table: Memo, trail: Trail, level: int, rule: int
) -> float:
    """The weighted cost of following a rule, and of stopping if that is cheaper.

    If the table is full, the value is of no use: the caller asks again with a longer table. If the
    search was stopped, it is what the case costs at most.
    """
    at = table.slot(trail.keys, level)
    if table.used[at] or table.full:
        return table.value[at]
    if trail.poll.stopped or trail.mass(level) < groups.least:
        return at_most(problem, groups, trail, level)
    value = stop(problem, trail, level)
    action = greedy(problem, groups, trail, level, rule) if value > 0.0 else -1
    if trail.poll.stopped:
        return at_most(problem, groups, trail, level)
    if action >= 0:
        value = min(value, followed(problem, groups, table, trail, level, rule, action))
    at = table.slot(trail.keys, level)
    if not table.used[at] and not table.full:
        table.enter(at, trail.keys, level, value, True)
    return value


def followed(
    problem: Beliefs, groups: Groups, table: Memo, trail: Trail, level: int, rule: int, action: int
) -> float:
    """The weighted cost of an action, and then of following a rule."""
    going = problem._costs[situation_of(problem, trail, level), action] * trail.mass(level)
    for outcome in range(problem.outcomes):
        if not problem._ends[action, outcome] and trail.follow(problem, level, action, outcome):
            going += follow(problem, groups, table, trail, level + 1, rule)
    return going


def base_cost(problem: Beliefs, groups: Groups, bases: Bases, trail: Trail, level: int) -> float:
    """The cost of the cheapest base policy."""
    least = follow(problem, groups, bases[0], trail, level, GAIN)
    least = min(least, follow(problem, groups, bases[1], trail, level, PAIRS))
    return min(least, follow(problem, groups, bases[2], trail, level, MILD))


def candidates(problem: Beliefs, groups: Groups, trail: Trail, level: int) -> int:
    """Rank the useful actions by how much a rule prefers them; in the declared order if all are to
    be tried.

    Returns the number of these actions.
    """
    count, several = 0, groups.width < problem.actions
    before = prepare(problem, trail, level, groups, GAIN) if several else 0.0
    for action in range(problem.actions):
        if tells(problem, trail, level, action):
            worth = index(problem, groups, action, trail, level, GAIN, before) if several else 0.0
            count = trail.ranking.insert(level, action, -worth, count)
    return count


def look_ahead(
    problem: Beliefs,
    groups: Groups,
    bases: Bases,
    trail: Trail,
    level: int,
    steps: int,
    limit: float,
) -> tuple[int, float]:
    """The best first action and its cost, by a lookahead of `steps` over the base policies; -1 to
    stop.

    Actions that cannot cost less than `limit` are left early; their cost is then at least `limit`.
    If the search is stopped, the best action so far is given.
    """
    best, value = -1, stop(problem, trail, level)
    if steps == 0 or value <= 0.0:
        return best, min(value, base_cost(problem, groups, bases, trail, level))
    count = min(candidates(problem, groups, trail, level), groups.width)
    for rank in range(count):
        if trail.poll.stopped and best >= 0:
            break
        action = trail.ranking.order[level, rank]
        going = _looked(problem, groups, bases, trail, level, steps, action, min(value, limit))
        if going < value * (1.0 - 1e-12):
            best, value = action, going
    return best, value


def _looked(
    problem: Beliefs,
    groups: Groups,
    bases: Bases,
    trail: Trail,
    level: int,
    steps: int,
    action: int,
    limit: float,
) -> float:
    """The cost of an action and of the lookahead after it; if it is not below `limit`, a part
    of it that is not.
    """
    going = problem._costs[situation_of(problem, trail, level), action] * trail.mass(level)
    for outcome in range(problem.outcomes):
        going_on = going < limit and not problem._ends[action, outcome]
        if going_on and trail.follow(problem, level, action, outcome):
            going += look_ahead(problem, groups, bases, trail, level + 1, steps - 1, limit - going)[
                1
            ]
    return going
