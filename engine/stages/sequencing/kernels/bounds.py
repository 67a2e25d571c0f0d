# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False
# cython: initializedcheck=False, cdivision=True
"""Minimum 1-trees and the ascent over penalties, under costs (n, n) of 32 or 64 bits.

Held & Karp 1970, 1971; the step as in Volgenant & Jonker 1982. Penalties are whole multiples of
1/64. So sums of them with integer costs are exact in floating point, and a bound has no rounding
error.
"""

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Ints
from cellwright.engine.kernels.cancellation import Interrupted, never
from cellwright.engine.stages.sequencing.kernels.chain import Costs

GRAIN = 64.0
WHOLE = float(1 << 52)  # from here on all floating-point numbers are whole
INFINITE = float("inf")
SLICE = 50_000_000  # edges between two checks whether to stop: a tenth of a second
LEAST = 8  # an ascent makes this many slices even when the time is up


class Ascent:
    """Where an ascent stands.

    It has the penalties, the best ones and the last turns (n,), the best bound, the size of a step,
    the number of steps since the bound was last raised, and whether the ascent has ended.
    """

    def __init__(self, penalty: Floats, upper: float, size: float, patience: int) -> None:
        n = len(penalty)
        self.penalty, self.kept, self.last, self.near = (
            penalty,
            penalty.copy(),
            np.zeros(n),
            np.zeros(n),
        )
        self.degree, self.parent, self.outside = (np.zeros(n, np.int32) for _ in range(3))
        self.upper, self.size, self.patience = upper, size, patience
        self.best, self.vain, self.ended = -INFINITE, 0, False


def ascend(
    cost: Costs,
    penalty: Floats,
    upper: float,
    steps: int,
    size: float,
    interrupted: Interrupted = never,
) -> tuple[float, Floats, int]:
    """Raise the bound by subgradient steps.

    They are `size` times the gap to `upper` at first, and are halved when they do not help.
    `penalty` (n,) is changed in place. Returns the best bound, its penalties, and the number of
    steps. The ascent ends early if the bound reaches `upper`, if a 1-tree is a tour, or if it is
    interrupted; it makes at least a second's worth of steps.
    """
    n = cost.shape[0]
    _check(n, cost.shape[1], len(penalty))
    state, made, share = Ascent(penalty, upper, size, max(5, steps // 20)), 0, max(1, SLICE // n**2)
    while made < steps and not state.ended and (made < LEAST * share or not interrupted()):
        made += _climb(cost, state, min(share, steps - made))
    return state.best, np.asarray(state.kept), made


def _check(n: int, width: int, penalties: int) -> None:
    """Raises ValueError if the shapes of costs and penalties do not agree: compiled loops do
    not check this.
    """
    if n < 3 or width != n or penalties != n:
        raise ValueError(
            f"costs (n, n) and penalties (n,) of three cities or more were expected, n is {n}"
        )


def _climb(cost: Costs, state: Ascent, steps: int) -> int:
    """Make some steps of an ascent. Returns their number."""
    n = cost.shape[0]
    for step in range(steps):
        bound = _grow(cost, state.penalty, state.degree, state.parent, state.near, state.outside)
        state.vain += 1
        if bound > state.best:
            state.best, state.vain = bound, 0
            _copy(state.penalty, state.kept)
        square = 0.0
        for city in range(n):
            square += (state.degree[city] - 2) * (state.degree[city] - 2)
        if square == 0 or state.best > state.upper - 1:
            state.ended = True
            return step + 1
        if state.vain >= state.patience:
            state.size, state.vain = state.size / 2, 0
            _copy(state.kept, state.penalty)
        length = state.size * max(state.upper - bound, 1.0) / square
        for city in range(n):
            turn = state.degree[city] - 2.0
            way = GRAIN * length * (0.7 * turn + 0.3 * state.last[city])
            state.penalty[city] += _rounded(way) / GRAIN
            state.last[city] = turn
    return steps


def _copy(source: Floats, target: Floats) -> None:
    for city in range(source.shape[0]):
        target[city] = source[city]


def _rounded(value: float) -> float:
    """The nearest whole number; the even one if two are equally near."""
    if value >= 0.0:
        return (value + WHOLE) - WHOLE if value < WHOLE else value
    return (value - WHOLE) + WHOLE if value > -WHOLE else value


def one_tree(cost: Costs, penalty: Floats, degree: Ints, parent: Ints) -> float:
    """The weight of a minimum 1-tree under cost + penalties, less twice the penalties: no tour
    costs less.

    The 1-tree is a minimum spanning tree of all cities but 0 (Prim 1957) with root 1, and the two
    cheapest edges of city 0; n >= 3. `degree` and `parent` (n,) are written.
    """
    n = cost.shape[0]
    _check(n, cost.shape[1], min(len(penalty), len(degree), len(parent)))
    near, outside = np.zeros(n), np.zeros(n, np.int32)
    return _grow(cost, penalty, degree, parent, near, outside)


def _grow(
    cost: Costs, penalty: Floats, degree: Ints, parent: Ints, near: Floats, outside: Ints
) -> float:
    """The same as `one_tree`, with scratch space: `near` (n,), and the cities outside the tree
    in order (n,).
    """
    n = cost.shape[0]
    for city in range(n):
        near[city], degree[city], outside[city] = INFINITE, 0, city + 2
    total, city = 0.0, 1
    for size in range(n - 2, 0, -1):
        chosen = _nearest(cost, penalty, city, near, parent, outside, size)
        city = outside[chosen]
        for place in range(chosen, size - 1):
            outside[place] = outside[place + 1]
        total += near[city]
        degree[city] += 1
        degree[parent[city]] += 1
    for rank in range(2):
        end = _cheapest(cost, penalty, rank)
        total += cost[0, end] + penalty[end] + penalty[0]
        degree[end] += 1
        degree[0] += 1
    penalties = 0.0
    for city in range(n):
        penalties += penalty[city]
    return total - 2 * penalties


def _nearest(
    cost: Costs, penalty: Floats, city: int, near: Floats, parent: Ints, outside: Ints, size: int
) -> int:
    """Offer the edges of `city`, which has just joined the tree, to the `size` cities outside.

    Returns the index of the nearest of these.
    """
    own, chosen, least = penalty[city], 0, INFINITE
    for place in range(size):
        other = outside[place]
        weight = cost[city, other] + own + penalty[other]
        if weight < near[other]:
            near[other], parent[other] = weight, city
        else:
            weight = near[other]
        if weight < least:
            chosen, least = place, weight
    return chosen


def _cheapest(cost: Costs, penalty: Floats, rank: int) -> int:
    """The city to which city 0 has its cheapest edge (rank 0) or its second cheapest edge (rank
    1).
    """
    first, second = 1, 2
    if cost[0, 2] + penalty[2] < cost[0, 1] + penalty[1]:
        first, second = 2, 1
    for other in range(3, cost.shape[0]):
        weight = cost[0, other] + penalty[other]
        if weight < cost[0, first] + penalty[first]:
            first, second = other, first
        elif weight < cost[0, second] + penalty[second]:
            second = other
    return second if rank else first


def excess(cost: Costs, penalty: Floats) -> Floats:
    """How much the minimum 1-tree grows if it must contain an edge (n, n); 0 for its own (Helsgaun
    2000: alpha).
    """
    n = cost.shape[0]
    _check(n, cost.shape[1], len(penalty))
    degree, parent, order = np.zeros(n, np.int32), np.zeros(n, np.int32), np.zeros(n, np.int32)
    heaviest, weights, found = np.zeros(n), np.zeros(n), np.zeros((n, n))
    one_tree(cost, penalty, degree, parent)
    _from_the_root(parent, order, degree)
    for city in range(2, n):
        weights[city] = cost[city, parent[city]] + penalty[city] + penalty[parent[city]]
    second = _cheapest(cost, penalty, 1)
    least = cost[0, second] + penalty[0] + penalty[second]
    for city in range(n):
        if city:
            _heaviest(city, parent, order, weights, heaviest, degree)
        for other in range(n):
            instead = heaviest[other] if city and other else least
            weight = cost[city, other] + penalty[city] + penalty[other]
            found[city, other] = max(0.0, weight - instead)
    return np.asarray(found)


def _from_the_root(parent: Ints, order: Ints, trail: Ints) -> None:
    """Write the n - 1 cities of the tree into `order` (n,), each after its parent; `trail` (n,)
    is scratch.
    """
    n, size = parent.shape[0], 1
    placed = np.zeros(n, np.bool_)
    order[0] = 1
    placed[1] = True
    for city in range(2, n):
        depth, at = 0, city
        while not placed[at]:
            trail[depth] = at
            depth += 1
            at = parent[at]
        for level in range(depth - 1, -1, -1):
            order[size] = trail[level]
            placed[trail[level]] = True
            size += 1


def _heaviest(
    start: int, parent: Ints, order: Ints, weights: Floats, heaviest: Floats, seen: Ints
) -> None:
    """Write the weight of the heaviest edge on the tree's path from one city to each other; 0 for
    the city itself.

    `weights` (n,) are those of the edges to the parents; `seen` (n,) is scratch.
    """
    at, value = start, -INFINITE
    heaviest[start], seen[start] = value, -start
    while at != 1:
        value = max(value, weights[at])
        at = parent[at]
        heaviest[at], seen[at] = value, -start
    for index in range(1, order.shape[0] - 1):
        at = order[index]
        if seen[at] != -start:
            heaviest[at] = max(weights[at], heaviest[parent[at]])
    heaviest[start] = 0.0
