# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False
# cython: initializedcheck=False, cdivision=True
"""Problems of two causes each, and the lower bound of a whole problem that they add up to.

Their prices are shares of its costs. `cellwright.engine.stages.diagnosis.pair_bounds` says why the
sum is a lower bound, and finds the shares.
A state of two causes is the ratio of their weights, and its value is a row over ratios that grow by
one factor. An outcome moves every ratio by the same number of points, and by the same part of the
way to the next point. Between points a value is linear in the weights, which is no more than the
value, because that is concave.
"""

import math

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs, real, whole
from cellwright.engine.stages.diagnosis.kernels.belief import (
    Beliefs,
    Trail,
    digit_of,
    floor_of,
)

CHANCE = 1e-6  # a part of the weight that is no longer followed
TINY = 1e-200  # so that nothing is divided by 0
DEPTH = 400  # steps after which usage is no longer counted


class PairProblems:
    """The problems of all pairs of causes: P pairs, A actions, O outcomes, G conclusions, N ratios.

    The causes one < two have row two (two - 1) / 2 + one. At point k the weight of one is
    `ratios[k]` (N,), that of two is 1. `moves` (P, A, O) is by how many points an outcome moves a
    ratio, `parts` by which part of the way to the next point, `kept` how much weight of two is left
    (0 if one of both causes is ruled out: what a single cause costs is counted elsewhere). `useful`
    (P, A) are the actions that tell or cure something, first, in the order of their numbers; then
    -1. `values` (P, 3 N) are those of the last prices, with N more points on either side;
    `choices` (P, N) the actions that have them, or -1 - g for conclusion g.
    """

    def __init__(
        self, ratios: Floats, moves: Longs, parts: Floats, kept: Floats, useful: Longs
    ) -> None:
        """Raises `ValueError` if a ratio could be moved beyond the points on either side."""
        count, actions, outcomes = moves.shape
        points = len(ratios)
        if useful.shape != (count, actions) or (useful >= actions).any() or points < 2:
            raise ValueError(f"useful actions of {count} pairs were expected, not {useful.shape}")
        if moves.size and not ((moves >= -points) & (moves < points)).all():
            raise ValueError(f"an outcome moves a ratio by less than {points} points")
        self.count, self.actions, self.outcomes, self.points = count, actions, outcomes, points
        self.values, self.choices = (
            np.zeros((count, 3 * points)),
            np.full((count, points), -1, np.int64),
        )
        self._ratios, self._moves, self._useful = real(ratios), whole(moves), whole(useful)
        self._parts, self._kept = real(parts), real(kept)
        self._values, self._choices = real(self.values), whole(self.choices)
        self._best, self._now, self._next = (
            real(np.zeros(points)),
            real(np.zeros(points)),
            real(np.zeros(points)),
        )

    def solve(self, prices: Floats, losses: Floats, sweeps: int, close: float) -> None:
        """Bring the values nearer to those of prices (P, A, 2) and losses (P, G, 2), under one
        and under two.

        From values of 0 they stay lower bounds. Ends when no value changes by more than its part
        `close`.
        """
        if prices.shape != (self.count, self.actions, 2) or len(losses) != self.count:
            raise ValueError(f"prices of {self.count} pairs were expected, not {prices.shape}")
        price, loss, count = real(prices), real(losses), losses.shape[1]
        for pair in range(self.count):
            for _ in range(sweeps):
                if sweep(self, pair, price, loss, count) <= close:
                    break

    def usage(self, ones: Floats, twos: Floats) -> Floats:
        """How often each action comes (P, A, 2), under one and under two.

        The weights of both causes (P,) are those at the start. Follows the choices of the last
        values.
        """
        acts = np.zeros((self.count, self.actions, 2))
        for pair in range(self.count):
            if ones[pair] > 0.0 and twos[pair] > 0.0:
                follow_choices(self, pair, ones[pair], twos[pair], real(acts))
        return acts


def sweep(
    pairs: PairProblems,
    pair: int,
    prices: "memoryview[float]",
    losses: "memoryview[float]",
    conclusions: int,
) -> float:
    """One step of value iteration for a pair. Returns the largest relative change."""
    weigh_conclusions(pairs, pair, losses, conclusions)
    for place in range(pairs.actions):
        action = pairs._useful[pair, place]
        if action < 0:
            break
        weigh_action(pairs, pair, action, prices[pair, action, 0], prices[pair, action, 1])
    return settle(pairs, pair)


def weigh_conclusions(
    pairs: PairProblems, pair: int, losses: "memoryview[float]", conclusions: int
) -> None:
    """Begin the best values with those of the conclusions."""
    for point in range(pairs.points):
        pairs._best[point] = math.inf
        for number in range(conclusions):
            worth = losses[pair, number, 0] * pairs._ratios[point] + losses[pair, number, 1]
            if worth < pairs._best[point]:
                pairs._best[point], pairs._choices[pair, point] = worth, -1 - number


def weigh_action(pairs: PairProblems, pair: int, action: int, one: float, two: float) -> None:
    """Compare an action of these prices with the best values."""
    points = pairs.points
    for point in range(points):
        pairs._next[point] = one * pairs._ratios[point] + two
    for outcome in range(pairs.outcomes):
        kept = pairs._kept[pair, action, outcome]
        if kept > 0.0:
            at = points + pairs._moves[pair, action, outcome]
            high = kept * pairs._parts[pair, action, outcome]
            low = kept - high
            for point in range(points):
                pairs._next[point] += (
                    low * pairs._values[pair, at + point]
                    + high * (pairs._values[pair, at + point + 1])
                )
    for point in range(points):
        if pairs._next[point] < pairs._best[point]:
            pairs._best[point], pairs._choices[pair, point] = pairs._next[point], action


def settle(pairs: PairProblems, pair: int) -> float:
    """Take the best values over. Returns the largest relative change."""
    points, largest = pairs.points, 0.0
    for point in range(points):
        change = math.fabs(pairs._best[point] - pairs._values[pair, points + point])
        if change > largest * (pairs._best[point] + TINY):
            largest = change / (pairs._best[point] + TINY)
        pairs._values[pair, points + point] = pairs._best[point]
    extend(pairs, pair)
    return largest


def extend(pairs: PairProblems, pair: int) -> None:
    """Set the values on either side: what is over the last ratio is a part of one cause alone."""
    points = pairs.points
    first = pairs._values[pair, points] / pairs._ratios[0]
    growth = pairs._ratios[1] / pairs._ratios[0]
    ratio = pairs._ratios[0]
    for point in range(points):
        ratio = ratio / growth
        pairs._values[pair, points - 1 - point] = first * ratio
        pairs._values[pair, 2 * points + point] = pairs._values[pair, 2 * points - 1]


def follow_choices(
    pairs: PairProblems,
    pair: int,
    one: float,
    two: float,
    acts: "memoryview[float]",
) -> None:
    """Add to `acts` how often each action comes from these weights on."""
    points = pairs.points
    for point in range(points):
        pairs._now[point] = 0.0
    place = math.log2(one / two / pairs._ratios[0]) / math.log2(pairs._ratios[1] / pairs._ratios[0])
    point = int(min(max(place, 0.0), points - 2.0))
    part = (one / two - pairs._ratios[point]) / (pairs._ratios[point + 1] - pairs._ratios[point])
    part = min(1.0, max(0.0, part))
    pairs._now[point], pairs._now[point + 1] = two * (1.0 - part), two * part
    for _ in range(DEPTH):
        if follow_step(pairs, pair, one, two, acts) < CHANCE * (one + two):
            break
        for point in range(points):
            pairs._now[point] = pairs._next[point]


def follow_step(
    pairs: PairProblems, pair: int, one: float, two: float, acts: "memoryview[float]"
) -> float:
    """Move the weights on by one choice. Returns how much goes on."""
    points, going = pairs.points, 0.0
    for point in range(points):
        pairs._next[point] = 0.0
    for point in range(points):
        mass, choice = pairs._now[point], pairs._choices[pair, point]
        if choice < 0 or mass * (1.0 + pairs._ratios[point]) <= CHANCE * (one + two):
            continue
        acts[pair, choice, 0] += mass * pairs._ratios[point] / one
        acts[pair, choice, 1] += mass / two
        for outcome in range(pairs.outcomes):
            kept = mass * pairs._kept[pair, choice, outcome]
            if kept > 0.0:
                at = point + pairs._moves[pair, choice, outcome]
                going += arrive(pairs, at, pairs._parts[pair, choice, outcome], kept)
    return going


def arrive(pairs: PairProblems, at: int, part: float, kept: float) -> float:
    """Add weights at two points. Returns how much they are."""
    if at < 0:  # a part as at the first point, and the rest of one cause alone
        growth = pairs._ratios[1] / pairs._ratios[0]
        kept *= (1.0 + part * (growth - 1.0)) * growth**at
        at, part = 0, 0.0
    elif at >= pairs.points - 1:
        at, part = pairs.points - 2, 1.0
    pairs._next[at] += kept * (1.0 - part)
    pairs._next[at + 1] += kept * part
    return kept * (1.0 + pairs._ratios[at])


class PairBounds:
    """A lower bound of a problem, the sum over pairs of causes.

    `values` (P, N) are those of the pairs at `ratios` (N,); none if there is no bound. `excess`
    (A, C) is by how much the prices of an action under a cause are together above its cost:
    allowed, because it is paid back for every action that is still to be done once at most. `sole`
    (C,) is the least loss that is charged for a cause by itself, `cures` (C, M) the repairs that
    are charged to it, the worst ones first; then -1.
    """

    def __init__(
        self, ratios: Floats, values: Floats, excess: Floats, sole: Floats, cures: Longs
    ) -> None:
        """Raises `ValueError` if the shapes do not agree."""
        causes = len(sole)
        pairs, points = causes * (causes - 1) // 2, len(ratios)
        if values.shape not in ((pairs, points), (0, points)) or excess.shape[1] != causes:
            raise ValueError(
                f"values of {pairs} pairs at {points} points were expected, not {values.shape}"
            )
        if len(cures) != causes or points < 2:
            raise ValueError(f"repairs of {causes} causes were expected, not {cures.shape}")
        self.count, self.last, self.repairs = len(values), points - 1, cures.shape[1]
        self.octave = 1.0 / math.log2(ratios[1] / ratios[0])
        self.step = ratios[1] / ratios[0] - 1.0
        self.ratios, self.values, self.excess = real(ratios), real(values), real(excess)
        self.total, self.sole, self.cures = real(excess.sum(axis=0)), real(sole), whole(cures)
        self.places = real(np.zeros(causes))


def cost_alone(bounds: PairBounds, problem: Beliefs, trail: Trail, level: int, cause: int) -> float:
    """What a cause costs by itself: the repairs that may cure it and were not tried, then a
    stop.
    """
    least = bounds.sole[cause]
    for place in range(bounds.repairs):
        action = bounds.cures[cause, place]
        if action < 0:
            break
        if digit_of(problem, trail, level, action):
            continue
        chance = problem._cures[action, cause]
        cost = problem._least[action]
        after = cost / chance
        if least < math.inf:
            after = cost + (1.0 - chance) * least
        least = min(least, after)
    return least


def charged(bounds: PairBounds, problem: Beliefs, trail: Trail, level: int) -> float:
    """What causes cost by themselves, less what prices of open actions are above costs."""
    total = 0.0
    for place in range(trail.counts[level]):
        cause = trail.members[level, place]
        alone = cost_alone(bounds, problem, trail, level, cause) - bounds.total[cause]
        total += trail.weights[level, cause] * alone
    for action in range(problem.actions):
        if digit_of(problem, trail, level, action):
            for place in range(trail.counts[level]):
                cause = trail.members[level, place]
                total += trail.weights[level, cause] * bounds.excess[action, cause]
    return total


def floor_in_pairs(bounds: PairBounds, problem: Beliefs, trail: Trail, level: int) -> float:
    """A lower bound of the value of a state."""
    least, count = floor_of(problem, trail, level), trail.counts[level]
    if bounds.count == 0 or count < 2:
        return least
    total = charged(bounds, problem, trail, level)
    for place in range(count):
        cause = trail.members[level, place]
        bounds.places[place] = bounds.octave * math.log2(trail.weights[level, cause])
    for later in range(1, count):
        two = trail.members[level, later]
        for earlier in range(later):
            one = trail.members[level, earlier]
            at = bounds.places[earlier] - bounds.places[later] + 0.5 * bounds.last
            pair = two * (two - 1) // 2 + one
            total += pair_value(
                bounds, pair, at, trail.weights[level, one], trail.weights[level, two]
            )
    return max(least, total)


def pair_value(bounds: PairBounds, pair: int, at: float, one: float, two: float) -> float:
    """The value of a pair with these weights; `at` is where their ratio lies."""
    if at >= bounds.last:
        return two * bounds.values[pair, bounds.last]
    if at <= 0.0:
        return one * bounds.ratios[bounds.last] * bounds.values[pair, 0]
    point = int(at)
    high = (one / bounds.ratios[point] - two) / bounds.step
    high = min(two, max(0.0, high))
    value: float = (two - high) * bounds.values[pair, point]
    value += high * bounds.values[pair, point + 1]
    return value
