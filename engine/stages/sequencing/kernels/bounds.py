"""Compiled minimum 1-trees and the ascent over penalties.

Held & Karp 1970, 1971; the step as in Volgenant & Jonker 1982. Penalties are whole multiples of 1/64, so that sums of
them with integer costs are exact in floating point: a bound is a bound, not one up to rounding.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from engine.stages.sequencing.kernels import compiled
from engine.stages.sequencing.kernels.arrays import Ints

Floats = NDArray[np.float64]
Truths = NDArray[np.bool_]
GRAIN = 64.0
SLICE = 50_000_000  # edges looked at between two questions whether to stop, a tenth of a second
LEAST = 8  # such slices that a bound is worth, even when the time is up


@compiled
def _nearest(cost: Ints, penalty: Floats, city: int, near: Floats, parent: Ints, done: Truths) -> int:
    """Offer the edges of `city`, just joined to the tree, to the cities outside; the one that is nearest to the tree."""
    row, own, chosen, least = cost[city], penalty[city], -1, np.inf
    for other in range(1, near.shape[0]):
        if done[other]:
            continue
        weight = row[other] + own + penalty[other]
        if weight < near[other]:
            near[other], parent[other] = weight, city
        if near[other] < least:
            chosen, least = other, near[other]
    return chosen


@compiled
def cheapest_two(cost: Ints, penalty: Floats) -> tuple[int, int]:
    """The cities to which city 0 has its cheapest and its second cheapest edge."""
    first, second = 1, 2
    if cost[0, 2] + penalty[2] < cost[0, 1] + penalty[1]:
        first, second = 2, 1
    for other in range(3, cost.shape[0]):
        weight = cost[0, other] + penalty[other]
        if weight < cost[0, first] + penalty[first]:
            first, second = other, first
        elif weight < cost[0, second] + penalty[second]:
            second = other
    return first, second


@compiled
def one_tree(cost: Ints, penalty: Floats, degree: Ints, parent: Ints) -> float:
    """The weight of a minimum 1-tree under cost + penalties, less twice the penalties: a lower bound on all tours.

    A minimum spanning tree of all cities but 0 (Prim 1957), its root being city 1, and the two cheapest edges of city
    0; n >= 3. `degree` and `parent` (n,) are written.
    """
    n = cost.shape[0]
    near, done = np.full(n, np.inf), np.zeros(n, np.bool_)
    degree[:] = 0
    total, city = 0.0, 1
    done[1] = True
    for _ in range(n - 2):
        city = _nearest(cost, penalty, city, near, parent, done)
        total += near[city]
        done[city] = True
        degree[city] += 1
        degree[parent[city]] += 1
    for end in cheapest_two(cost, penalty):
        total += cost[0, end] + penalty[end] + penalty[0]
        degree[end] += 1
        degree[0] += 1
    return float(total - 2 * penalty.sum())


class Ascent(NamedTuple):
    """Where an ascent stands: penalties, the best ones, the last turns (n,), and in `pace` the best bound, the size of
    a step, and the steps since the bound was last raised."""

    penalty: Floats
    kept: Floats
    last: Floats
    pace: Floats


def ascend(
    cost: Ints,
    penalty: Floats,
    upper: float,
    steps: int,
    size: float,
    interrupted: Callable[[], bool] = lambda: False,
) -> tuple[float, Floats, int]:
    """Raise the bound by subgradient steps, of `size` times the gap to `upper` at first, halved when they do not help.

    `penalty` (n,) is changed in place. The best bound, its penalties, and the steps that were made; it ends early when
    the bound reaches `upper` or a 1-tree is a tour, and when interrupted, but not before a second's worth of steps.
    """
    state = Ascent(penalty, penalty.copy(), np.zeros(len(cost)), np.array([-np.inf, size, 0.0]))
    patience, made = max(5, steps // 20), 0
    share = max(1, SLICE // len(cost) ** 2)
    while made < steps and (made < LEAST * share or not interrupted()):
        now = min(share, steps - made)
        done, ended = _climb(cost, state, upper, now, patience)
        made += done
        if ended:
            break
    return float(state.pace[0]), state.kept, made


@compiled
def _climb(cost: Ints, state: Ascent, upper: float, steps: int, patience: int) -> tuple[int, bool]:
    """Some steps of an ascent; how many were made, and whether it has ended."""
    n = cost.shape[0]
    degree, parent = np.zeros(n, np.int32), np.zeros(n, np.int32)
    penalty, kept, last, pace = state
    for step in range(steps):
        bound = one_tree(cost, penalty, degree, parent)
        pace[2] += 1
        if bound > pace[0]:
            pace[0], pace[2] = bound, 0
            kept[:] = penalty
        square = 0.0
        for city in range(n):
            square += (degree[city] - 2) ** 2
        if square == 0 or pace[0] > upper - 1:
            return step + 1, True
        if pace[2] >= patience:
            pace[1], pace[2] = pace[1] / 2, 0
            penalty[:] = kept
        length = pace[1] * max(upper - bound, 1.0) / square
        for city in range(n):
            turn = degree[city] - 2.0
            penalty[city] += np.rint(GRAIN * length * (0.7 * turn + 0.3 * last[city])) / GRAIN
            last[city] = turn
    return steps, False


@compiled
def _from_the_root(parent: Ints) -> Ints:
    """The cities of the tree (n - 1,), each after its parent."""
    n = parent.shape[0]
    order, placed, size = np.empty(n - 1, np.int32), np.zeros(n, np.bool_), 1
    order[0] = 1
    placed[1] = True
    trail = np.empty(n, np.int32)
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
    return order


@compiled
def excess(cost: Ints, penalty: Floats) -> Floats:
    """How much (n, n) the minimum 1-tree grows when it has to contain an edge (Helsgaun 2000: alpha); 0 for its own."""
    n = cost.shape[0]
    degree, parent = np.zeros(n, np.int32), np.zeros(n, np.int32)
    one_tree(cost, penalty, degree, parent)
    order, heaviest = _from_the_root(parent), np.zeros((n, n))
    for index in range(1, n - 1):
        city = order[index]
        above = parent[city]
        weight = cost[city, above] + penalty[city] + penalty[above]
        for earlier in range(index):
            other = order[earlier]
            value = max(weight, heaviest[above, other]) if other != above else weight
            heaviest[city, other] = heaviest[other, city] = value
    _, second = cheapest_two(cost, penalty)
    heaviest[0, :] = heaviest[:, 0] = cost[0, second] + penalty[0] + penalty[second]
    for city in range(n):
        for other in range(n):
            weight = cost[city, other] + penalty[city] + penalty[other]
            heaviest[city, other] = max(0.0, weight - heaviest[city, other])
    return heaviest
