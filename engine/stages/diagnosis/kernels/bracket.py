# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False
# cython: initializedcheck=False, cdivision=True
"""Search for uncertain outcomes: each state has a lower and an upper bound of its value.

A dive goes from a state to its most promising action and to the outcome whose bounds are farthest
apart, and expands what it reaches for the first time. On its way back it brings the bounds together
(McMahan, Likhachev & Gordon 2005, bounded real-time dynamic programming; Smith & Simmons 2004,
heuristic search value iteration). A state is what was seen, in whatever order, so that ways which
differ in their order alone meet in one state.

The upper bound of a new state is the cost of repairs alone, in the order of their chance per cost,
with a safe stop where that is cheaper. Its lower bound adds up pairs of causes. The value is
concave and homogeneous in the weights, so that it is no less than the sum of the values of parts
which add up to the weights (Lovejoy 1991). Each part has two causes. The value of two causes is
known beforehand, as if every test could be repeated independently.
"""

import math
from math import inf

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs, real, whole
from cellwright.engine.stages.diagnosis.kernels.belief import (
    Beliefs,
    Trail,
    floor_of,
    is_done,
    situation_of,
    stop,
    tells,
)
from cellwright.engine.stages.diagnosis.kernels.memo import Keys

MASK = 0xFFFFFFFFFFFFFFFF
SPREAD, MIX = 0x9E3779B97F4A7C15, 0x94D049BB133111EB
NONE, USELESS = -1, -2  # as a child: an outcome that leads nowhere, and an action that is of no use
STOP = -1  # as a choice
# a dive ends where bounds are closer than this part of those of the state in which it began
NARROW = 0.02


class Brackets:
    """The states that were seen, by numbers, each with bounds of its value.

    `pairs` (P, S, N) are lower bounds of the values of pairs of causes: at point k the first has
    `ratios[k]` (N,) times the weight of the second, which has the weight 1. The ratios grow by one
    factor, from 1 / r to r. Bit n of the number s says that repair n of those that the pair has to
    do with, `unsure` (P, U), has been tried. There are no rows if the bound does not hold for this
    problem. A table has room for `length` states and for the children of `room` expanded ones.
    Raises `ValueError` unless `length` is a power of two.
    """

    def __init__(
        self, problem: Beliefs, ratios: Floats, pairs: Floats, unsure: Longs, length: int, room: int
    ) -> None:
        count, points = problem.causes * (problem.causes - 1) // 2, len(ratios)
        if len(pairs) not in (0, count) or pairs.shape[2:] != (points,) or points < 2:
            raise ValueError(
                f"values of {count} pairs at {points} points were expected, not {pairs.shape}"
            )
        bits = (unsure >= 0).sum(axis=1).max(initial=0)
        if (
            len(unsure) != len(pairs)
            or pairs.shape[1] < 1 << bits
            or (unsure >= problem.actions).any()
        ):
            raise ValueError(f"the repairs of {count} pairs were expected, not {unsure.shape}")
        if length < 1 or length & (length - 1):
            raise ValueError(f"a table has a power of two of slots, not {length}")
        self.problem, self.given, self.length, self.room = (
            problem,
            (ratios, pairs, unsure),
            length,
            room,
        )
        self.pairs, self.paired = real(pairs), len(pairs) > 0
        self.ratios, self.last = real(ratios), points - 1
        self.unsure, self.bits = whole(unsure), unsure.shape[1]
        self.octave = 1.0 / math.log2(ratios[1] / ratios[0])
        self.keys = Keys(length, problem.words)
        self.index = whole(np.full(2 * length, NONE, np.int64))
        self.low, self.high = real(np.zeros(length)), real(np.zeros(length))
        self.mass = real(np.zeros(length))
        self.choice = whole(np.full(length, STOP, np.int64))
        self.first = whole(np.full(length, NONE, np.int64))
        self.width = problem.actions * problem.outcomes
        self.children = whole(np.full(max(1, room * self.width), NONE, np.int64))
        repairs = np.flatnonzero(problem.repairs).astype(np.int64)
        self.repairs, self.cures = (
            whole(repairs),
            real((problem.likelihoods * problem.ends[:, :, None]).sum(axis=1)),
        )
        self.left, self.tried = (
            real(np.zeros(problem.causes)),
            whole(np.zeros(problem.actions + 1, np.int64)),
        )
        self.states = self.expanded = 0
        self.full = False

    def slot(self, keys: Keys, row: int) -> int:
        """The slot of the state in a row of keys, or the empty slot where it would go."""
        last, mixed = 2 * self.length - 1, 0
        for word in range(self.keys.width):
            mixed = ((mixed ^ keys.words[row, word]) * SPREAD) & MASK
            mixed ^= mixed >> 31
        mixed = (mixed * MIX) & MASK
        at = (mixed ^ (mixed >> 29)) & last
        while self.index[at] >= 0 and not self._holds(self.index[at], keys, row):
            at = (at + 1) & last
        return at

    def _holds(self, state: int, keys: Keys, row: int) -> bool:
        for word in range(self.keys.width):
            if self.keys.words[state, word] != keys.words[row, word]:
                return False
        return True

    def numbered(self, at: int, keys: Keys, row: int) -> int:
        """A new state in an empty slot, without bounds. Returns its number."""
        state = self.states
        for word in range(self.keys.width):
            self.keys.words[state, word] = keys.words[row, word]
        self.index[at] = state
        self.states += 1
        return state

    def lacks_room(self) -> bool:
        """Whether one more expansion could need more room than there is; then the table is
        `full`.
        """
        self.full = self.states + self.width > self.length or self.expanded >= self.room
        return self.full

    def grown(self, length: int, room: int) -> "Brackets":
        """A table with more room, with the same states under the same numbers."""
        larger = Brackets(self.problem, *self.given, length, room)
        for state in range(self.states):
            larger.numbered(larger.slot(self.keys, state), self.keys, state)
            larger.low[state], larger.high[state] = self.low[state], self.high[state]
            larger.mass[state], larger.choice[state] = self.mass[state], self.choice[state]
            larger.first[state] = self.first[state]
        for place in range(self.expanded * self.width):
            larger.children[place] = self.children[place]
        larger.expanded = self.expanded
        return larger


def pair_value(
    table: Brackets,
    pair: int,
    tried: int,
    one: float,
    two: float,
    known_one: float,
    known_two: float,
) -> float:
    """A lower bound for two causes with these weights, from the values at the ratios next to
    theirs.

    What is over the largest ratio is a part of one cause alone, whose cost is known.
    """
    place = table.octave * math.log2(one / two) + 0.5 * table.last
    if place >= table.last:
        return (
            two * table.pairs[pair, tried, table.last]
            + (one - two * table.ratios[table.last]) * known_one
        )
    if place <= 0.0:
        part = one * table.ratios[table.last]
        return part * table.pairs[pair, tried, 0] + (two - part) * known_two
    point = int(place)
    share = (one / two - table.ratios[point]) / (table.ratios[point + 1] - table.ratios[point])
    share = min(1.0, max(0.0, share))
    return two * (
        (1.0 - share) * table.pairs[pair, tried, point]
        + share * table.pairs[pair, tried, point + 1]
    )


def _tried(table: Brackets, trail: Trail, level: int, pair: int) -> int:
    """The number that says which repairs of a pair have been tried."""
    tried, bit = 0, 1
    for place in range(table.bits):
        action = table.unsure[pair, place]
        if action < 0:
            break
        if is_done(table.problem, trail, level, action):
            tried |= bit << place
    return tried


def floor_in_pairs(table: Brackets, trail: Trail, level: int) -> float:
    """A lower bound of the value of a state: each cause shares its weight among the others by
    their weights.
    """
    problem, count = table.problem, trail.counts[level]
    if not table.paired or count < 2:
        return floor_of(problem, trail, level)
    total, mass = 0.0, trail.mass(level)
    for later in range(1, count):
        two = trail.members[level, later]
        for place in range(later):
            one = trail.members[level, place]
            both = trail.weights[level, one] * trail.weights[level, two]
            first, second = (
                both / (mass - trail.weights[level, one]),
                both / (mass - trail.weights[level, two]),
            )
            if first > 0.0 and second > 0.0:
                pair = two * (two - 1) // 2 + one
                known_one, known_two = problem._known[one], problem._known[two]
                tried = _tried(table, trail, level, pair)
                total += pair_value(table, pair, tried, first, second, known_one, known_two)
    return total


def _repairing(table: Brackets, trail: Trail, level: int) -> int:
    """The repair that is not tried yet and cures most weight in `left` per cost; -1 if none
    cures any.
    """
    problem, best, most = table.problem, -1, 0.0
    situation = table.tried[problem.actions]
    for number in range(len(table.repairs)):
        action = table.repairs[number]
        if table.tried[action]:
            continue
        cured = 0.0
        for place in range(trail.counts[level]):
            cause = trail.members[level, place]
            cured += table.left[cause] * table.cures[action, cause]
        worth = cured / max(problem._costs[situation, action], 1e-9)
        if worth > most:
            best, most = action, worth
    return best


def _repaired(table: Brackets, trail: Trail, level: int, action: int) -> float:
    """Take from `left` what a repair cures. Returns the cost of the repair."""
    problem, mass = table.problem, 0.0
    situation = table.tried[problem.actions]
    for place in range(trail.counts[level]):
        cause = trail.members[level, place]
        mass += table.left[cause]
        table.left[cause] *= 1.0 - table.cures[action, cause]
    table.tried[action] = 1
    table.tried[problem.actions] = problem._following[situation, action]
    return problem._costs[situation, action] * mass


def stop_left(table: Brackets, trail: Trail, level: int) -> float:
    """The least loss of a conclusion that is allowed whatever is left; infinite if there is
    none.
    """
    problem, best = table.problem, inf
    for conclusion in range(problem.conclusions):
        loss = 0.0
        for place in range(trail.counts[level]):
            cause = trail.members[level, place]
            if table.left[cause] > 0.0:
                loss += table.left[cause] * problem._losses[conclusion, cause]
        best = min(best, loss)
    return best


def ceiling_of(table: Brackets, trail: Trail, level: int, state: int) -> float:
    """The cost of repairs alone, with the best conclusion after the best number of them.

    Notes what comes first.
    """
    problem = table.problem
    for place in range(trail.counts[level]):
        cause = trail.members[level, place]
        table.left[cause] = trail.weights[level, cause]
    for number in range(len(table.repairs)):
        action = table.repairs[number]
        table.tried[action] = is_done(problem, trail, level, action)
    table.tried[problem.actions] = situation_of(problem, trail, level)
    best, spent, first = stop(problem, trail, level), 0.0, STOP
    action = _repairing(table, trail, level)
    begin = action
    while action >= 0:
        spent += _repaired(table, trail, level, action)
        ending = spent + stop_left(table, trail, level)
        if ending < best:
            best, first = ending, begin
        action = _repairing(table, trail, level) if spent < best else STOP
    table.choice[state] = first
    return best


def number_of(table: Brackets, trail: Trail, level: int) -> int:
    """The number of the state at a level. A new one gets its first bounds."""
    at = table.slot(trail.keys, level)
    if table.index[at] >= 0:
        return table.index[at]
    state = table.numbered(at, trail.keys, level)
    table.mass[state] = trail.mass(level)
    table.high[state] = ceiling_of(table, trail, level, state)
    table.low[state] = min(table.high[state], floor_in_pairs(table, trail, level))
    return state


def expand(table: Brackets, trail: Trail, level: int, state: int) -> None:
    """Number the states that follow a state."""
    problem, first = table.problem, table.expanded * table.width
    table.first[state] = first
    table.expanded += 1
    for action in range(problem.actions):
        place = first + action * problem.outcomes
        if not tells(problem, trail, level, action):
            table.children[place] = USELESS
            continue
        for outcome in range(problem.outcomes):
            child = NONE
            if not problem._ends[action, outcome] and trail.follow(problem, level, action, outcome):
                child = number_of(table, trail, level + 1)
            table.children[place + outcome] = child


def back_up(table: Brackets, trail: Trail, level: int, state: int) -> int:
    """Bring the bounds of an expanded state up to date.

    Returns the action of the least lower bound, or `STOP`.
    """
    problem, stopping = table.problem, stop(table.problem, trail, level)
    situation = situation_of(problem, trail, level)
    least, low, high = STOP, stopping, stopping
    choice = STOP
    for action in range(problem.actions):
        place = table.first[state] + action * problem.outcomes
        if table.children[place] == USELESS:
            continue
        under = over = problem._costs[situation, action] * table.mass[state]
        for outcome in range(problem.outcomes):
            child = table.children[place + outcome]
            if child >= 0:
                under += table.low[child]
                over += table.high[child]
        if under < low:
            least, low = action, under
        if over < high:
            choice, high = action, over
    table.low[state] = max(table.low[state], low)
    if high < table.high[state] or (high <= table.high[state] and choice == STOP):
        table.high[state], table.choice[state] = high, choice
    table.low[state] = min(table.low[state], table.high[state])
    return least


def _widest(table: Brackets, state: int, action: int) -> int:
    """The outcome of an action whose bounds are farthest apart."""
    best, gap = 0, -1.0
    place = table.first[state] + action * table.problem.outcomes
    for outcome in range(table.problem.outcomes):
        child = table.children[place + outcome]
        if child >= 0 and table.high[child] - table.low[child] > gap:
            best, gap = outcome, table.high[child] - table.low[child]
    return best


def dive(table: Brackets, trail: Trail, level: int, state: int, gap: float) -> None:
    """Go down from a state to one whose bounds are closer than `gap`, and bring them together on
    the way back.

    At least one state is expanded, if there is one whose bounds are apart.
    """
    problem, fresh = table.problem, table.first[state] < 0
    if fresh:
        if table.lacks_room() or trail.poll.due(
            table.width * (20 + trail.counts[level] * trail.counts[level])
        ):
            return
        expand(table, trail, level, state)
    action = back_up(table, trail, level, state)
    if action == STOP or (fresh and table.high[state] - table.low[state] <= gap):
        return
    outcome = _widest(table, state, action)
    child = table.children[table.first[state] + action * problem.outcomes + outcome]
    if child < 0 or table.high[child] <= table.low[child]:
        return
    trail.follow(problem, level, action, outcome)
    dive(table, trail, level + 1, child, gap)
    back_up(table, trail, level, state)


def search(table: Brackets, trail: Trail, limit: float, expansions: int, close: float) -> int:
    """Search from the state at level 0 until its bounds are `close`, its lower bound reaches
    `limit`, or work is spent.

    Returns the number of the state. If the table is `full`, the caller goes on with a larger one.
    """
    state, last = number_of(table, trail, 0), table.expanded + expansions
    while (
        table.high[state] - table.low[state] > close * table.high[state]
        and table.low[state] < limit
    ):
        if table.expanded >= last or table.full or trail.poll.stopped:
            break
        dive(table, trail, 0, state, NARROW * (table.high[state] - table.low[state]))
    return state
