# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False
# cython: initializedcheck=False, cdivision=True
"""Exact search for uncertain outcomes: a state is the causes still possible and the outcomes seen.

The branch and bound is the same as over partitions. Beliefs are kept as weights: the prior times
the likelihoods of what was seen. The bound is the cost of the case if the cause were known.
"""

from math import inf

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs, Truths, real, whole
from cellwright.engine.kernels.cancellation import Poll
from cellwright.engine.stages.diagnosis.kernels.memo import Keys, Memo
from cellwright.engine.stages.diagnosis.kernels.ranking import Ranking


class Beliefs:
    """A problem in arrays: C causes, A actions, O outcomes, K situations, G conclusions.

    Each array has two names here: one for NumPy, and one with an underscore for the kernels. A key
    has `words` words: `sets` words for the causes, then those of the rest.
    """

    def __init__(
        self,
        likelihoods: Floats,
        ends: Truths,
        repairs: Truths,
        shown: Longs,
        costs: Floats,
        following: Longs,
        losses: Floats,
        known: Floats,
        shifts: Longs,
        widths: Longs,
        situations: int,
        slack: float = 0.0,
        before: Longs | None = None,
    ) -> None:
        """Takes the arrays of a problem. Raises `ValueError` if their shapes do not agree.

        `likelihoods` (A, O, C). `ends` (A, O): the outcomes that end the case; `repairs` (A,): the
        actions that have such an outcome. `shown` (A, C): the outcome of a certain action; -1
        everywhere if it is uncertain. `costs` and `following` (K, A). `losses` (G, C) of the
        conclusions. `known` (C,): a lower bound of the cost if c were known. The rest of a key has
        the situation in its lowest `situations` bits; at `shifts` (A,) the outcome of action a plus
        one, in `widths` (A,) bits (0 if it is certain). A conclusion is allowed where the causes
        that forbid it have at most the part `slack` of the weight. `before` (A,) is the action of
        which an action is a repetition, else -1: repetitions come one after the other, and which of
        them had which outcome does not matter.
        """
        self.actions, self.outcomes, self.causes = likelihoods.shape
        self.conclusions, self.changes = len(losses), len(costs)
        a, o, c, k = self.actions, self.outcomes, self.causes, self.changes
        arrays = (ends, repairs, shifts, widths, costs, following, shown, losses, known)
        shapes = [(a, o), (a,), (a,), (a,), (k, a), (k, a), (a, c), (len(losses), c), (c,)]
        if [each.shape for each in arrays] != shapes:
            raise ValueError(f"the arrays of a problem do not fit likelihoods {likelihoods.shape}")
        self.sets = (self.causes + 63) >> 6
        bits = int((shifts + widths).max(initial=situations))
        self.words = self.sets + max(1, (bits + 63) >> 6)
        self.likelihoods, self.ends, self.repairs, self.shown = likelihoods, ends, repairs, shown
        self.costs, self.following, self.losses, self.known = costs, following, losses, known
        self.shifts, self.widths, self.situations = shifts, widths, situations
        self.slack = slack * (1.0 + 1e-9)
        self.before = np.full(a, -1, np.int64) if before is None else before
        if self.before.shape != (a,) or (self.before >= np.arange(a)).any():
            raise ValueError("a repetition comes after the action that it repeats")
        self._before = whole(self.before)
        self._likelihoods, self._shown = real(likelihoods), whole(shown)
        self._ends, self._repairs = whole(ends.view(np.uint8)), whole(repairs.view(np.uint8))
        self._costs, self._following = real(costs), whole(following)
        self._losses, self._known, self._shifts = real(losses), real(known), whole(shifts)
        self._widths = whole(widths)


class Trail:
    """States on the way from one state to others: one level for each.

    A level has the causes still possible (`members`, `counts` of them), their `weights` (C,), the
    key of the state and the `ranking` of the actions. No way is longer than the number of actions,
    because an action that was done brings no new information.
    """

    def __init__(
        self, problem: Beliefs, weights: Floats, rest: int = 0, poll: Poll | None = None
    ) -> None:
        """Begins at level 0 with weights (C,) and the rest of the key.

        Raises `ValueError` unless there is one weight for each cause.
        """
        if weights.shape != (problem.causes,):
            raise ValueError(f"{problem.causes} weights were expected, not {weights.shape}")
        levels = problem.actions + 2
        self.weights = real(np.empty((levels, problem.causes)))
        self.members = whole(np.empty((levels, problem.causes), np.int64))
        self.counts = whole(np.zeros(levels, np.int64))
        self.keys = Keys(levels, problem.words)
        self.ranking = Ranking(levels, problem.actions)
        self.poll = Poll() if poll is None else poll
        self.keys.write(0, problem.sets, problem.words, rest)
        self.enter(real(np.ascontiguousarray(weights)))

    def enter(self, weights: "memoryview[float]") -> None:
        """Put these weights (C,) at level 0."""
        count = 0
        for word in range(self.keys.width):
            if 64 * word < len(weights):
                self.keys.words[0, word] = 0
        for cause in range(len(weights)):
            if weights[cause] > 0.0:
                self.weights[0, cause] = weights[cause]
                self.members[0, count] = cause
                count += 1
                self.keys.words[0, cause >> 6] |= self._bit(cause)
        self.counts[0] = count

    def _bit(self, cause: int) -> int:
        bit = 1
        return bit << (cause & 63)

    def mass(self, level: int) -> float:
        """The sum of the weights."""
        total = 0.0
        for place in range(self.counts[level]):
            total += self.weights[level, self.members[level, place]]
        return total

    def follow(self, problem: Beliefs, level: int, action: int, outcome: int) -> int:
        """Write the next level: the state after an outcome of an action.

        Returns the number of causes still possible. If there is none, the key is not written.
        """
        count = 0
        for place in range(self.counts[level]):
            cause = self.members[level, place]
            likelihood = problem._likelihoods[action, outcome, cause]
            if likelihood > 0.0:
                self.weights[level + 1, cause] = self.weights[level, cause] * likelihood
                self.members[level + 1, count] = cause
                count += 1
        self.counts[level + 1] = count
        if count:
            self._name(problem, level, action, outcome)
        return count

    def _name(self, problem: Beliefs, level: int, action: int, outcome: int) -> None:
        """Write the key of the next level."""
        for word in range(problem.sets):
            self.keys.words[level + 1, word] = 0
        for place in range(self.counts[level + 1]):
            cause = self.members[level + 1, place]
            self.keys.words[level + 1, cause >> 6] |= self._bit(cause)
        for word in range(problem.sets, problem.words):
            self.keys.words[level + 1, word] = self.keys.words[level, word]
        situation = situation_of(problem, self, level)
        self.keys.words[level + 1, problem.sets] ^= (
            situation ^ problem._following[situation, action]
        )
        if problem._widths[action]:
            self._note(problem, level + 1, action, outcome + 1)

    def _note(self, problem: Beliefs, level: int, action: int, digit: int) -> None:
        """Write an outcome plus one. The outcomes of repetitions are kept in descending order."""
        while problem._before[action] >= 0:
            earlier = problem._before[action]
            seen = digit_of(problem, self, level, earlier)
            if seen >= digit:
                break
            self._put(problem, level, action, seen)
            self._put(problem, level, earlier, 0)
            action = earlier
        self._put(problem, level, action, digit)

    def _put(self, problem: Beliefs, level: int, action: int, digit: int) -> None:
        """Write a digit in place of what is there."""
        shift = problem._shifts[action]
        word, mask = problem.sets + (shift >> 6), self._bit(problem._widths[action]) - 1
        self.keys.words[level, word] &= ~(mask << (shift & 63))
        self.keys.words[level, word] |= self._bit(shift) * digit


def stop(problem: Beliefs, trail: Trail, level: int) -> float:
    """The loss of the best conclusion; infinite if none is allowed."""
    best, most = inf, 0.0
    if problem.slack > 0.0:
        most = problem.slack * trail.mass(level)
    for conclusion in range(problem.conclusions):
        loss, barred = 0.0, 0.0
        for place in range(trail.counts[level]):
            cause = trail.members[level, place]
            if problem._losses[conclusion, cause] == inf:
                barred += trail.weights[level, cause]
            else:
                loss += trail.weights[level, cause] * problem._losses[conclusion, cause]
            if loss >= best or barred > most:
                loss = inf
                break
        best = min(best, loss)
    return best


def floor_of(problem: Beliefs, trail: Trail, level: int) -> float:
    """The least that the case costs with these weights."""
    total = 0.0
    for place in range(trail.counts[level]):
        cause = trail.members[level, place]
        total += trail.weights[level, cause] * problem._known[cause]
    return total


def digit_of(problem: Beliefs, trail: Trail, level: int, action: int) -> int:
    """What the key has of an action: its outcome plus one, or 0.

    It has nothing of actions whose outcomes are certain.
    """
    width, shift = problem._widths[action], problem._shifts[action]
    if width == 0:
        return 0
    word = trail.keys.words[level, problem.sets + (shift >> 6)]
    return (word >> (shift & 63)) & ((1 << width) - 1)


def is_done(problem: Beliefs, trail: Trail, level: int, action: int) -> bool:
    """Whether an action is done, or repeats one that is not done yet."""
    if digit_of(problem, trail, level, action):
        return True
    earlier = problem._before[action]
    return earlier >= 0 and not digit_of(problem, trail, level, earlier)


def _ended(problem: Beliefs, trail: Trail, level: int, action: int) -> float:
    """How much of the least cost an action saves by the outcomes that end the case."""
    saved = 0.0
    for outcome in range(problem.outcomes):
        if problem._ends[action, outcome]:
            for place in range(trail.counts[level]):
                cause = trail.members[level, place]
                likelihood = problem._likelihoods[action, outcome, cause]
                saved += trail.weights[level, cause] * likelihood * problem._known[cause]
    return saved


def tells(problem: Beliefs, trail: Trail, level: int, action: int) -> bool:
    """Whether an action is still open and may end the case or change the belief."""
    if is_done(problem, trail, level, action):
        return False
    for outcome in range(problem.outcomes):
        first, ends = -1.0, problem._ends[action, outcome] != 0
        for place in range(trail.counts[level]):
            value = problem._likelihoods[action, outcome, trail.members[level, place]]
            if (ends and value > 0.0) or (first >= 0.0 and value != first):
                return True
            first = value
    return False


def situation_of(problem: Beliefs, trail: Trail, level: int) -> int:
    """The situation in the key of a level."""
    return trail.keys.words[level, problem.sets] & ((1 << problem.situations) - 1)


def lower(problem: Beliefs, table: Memo, trail: Trail, level: int) -> float:
    """The lower bound known so far: stop now, or pay for a step and then the bounds of what
    follows.
    """
    at = table.slot(trail.keys, level)
    if table.used[at]:
        return table.value[at]
    stopping, base = stop(problem, trail, level), floor_of(problem, trail, level)
    least, total, situation = inf, trail.mass(level), situation_of(problem, trail, level)
    for action in range(problem.actions):
        if base < stopping and not is_done(problem, trail, level, action):
            value = problem._costs[situation, action] * total + base
            if problem._repairs[action]:
                value -= _ended(problem, trail, level, action)
            least = min(least, value)
    least = max(least, base)
    table.enter(at, trail.keys, level, min(stopping, least), stopping <= least)
    return table.value[at]


def estimate(problem: Beliefs, table: Memo, trail: Trail, level: int, action: int) -> float:
    """A lower bound on the cost of beginning with an action."""
    value = problem._costs[situation_of(problem, trail, level), action] * trail.mass(level)
    for outcome in range(problem.outcomes):
        if not problem._ends[action, outcome] and trail.follow(problem, level, action, outcome):
            value += lower(problem, table, trail, level + 1)
    return value


def ranked(problem: Beliefs, table: Memo, trail: Trail, level: int) -> int:
    """Rank the useful actions by the lower bounds of beginning with them.

    Returns the number of these actions.
    """
    count = 0
    for action in range(problem.actions):
        if trail.poll.due(problem.outcomes * problem.actions * trail.counts[level]):
            table.halt()
        if not trail.poll.stopped and not table.full and tells(problem, trail, level, action):
            value = estimate(problem, table, trail, level, action)
            count = trail.ranking.insert(level, action, value, count)
    return count


def begun(
    problem: Beliefs, table: Memo, trail: Trail, level: int, action: int, best: float
) -> float:
    """The cost of beginning with an action.

    If it is not below `best`, or the search ends, a lower bound.
    """
    # the table may have a better bound by now
    value = estimate(problem, table, trail, level, action)
    for outcome in range(problem.outcomes):
        going = value < best and not table.full and not problem._ends[action, outcome]
        if going and trail.follow(problem, level, action, outcome):
            guess = lower(problem, table, trail, level + 1)
            value += solve(problem, table, trail, level + 1, inf) - guess
    return value


def solve(problem: Beliefs, table: Memo, trail: Trail, level: int, limit: float) -> float:
    """The value of a state if it is below `limit`.

    Otherwise, or if the budget is spent, a lower bound.
    """
    known = lower(problem, table, trail, level)
    if table.exact[table.slot(trail.keys, level)] or known >= limit or table.spent or table.full:
        return known
    table.expand()
    count = ranked(problem, table, trail, level)
    if trail.poll.stopped:
        return known
    floor = stop(problem, trail, level)
    best = min(limit, floor)
    for rank in range(count):
        if table.full:
            return known
        value = begun(problem, table, trail, level, trail.ranking.order[level, rank], best)
        floor, best = min(floor, value), min(best, value)
        if rank + 1 < count and trail.ranking.values[level, rank + 1] >= best:
            # the following actions are no better
            floor = min(floor, trail.ranking.values[level, rank + 1])
            break
    return table.conclude(trail.keys, level, floor, limit)
