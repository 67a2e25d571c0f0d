"""The least order of few visits, by dynamic programming over their subsets (Held & Karp 1962).

Costs may have directions, visits may come before others, and either end may be fixed.
"""

from collections.abc import Sequence

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs, Truths
from cellwright.engine.model.tour_problem import TourProblem

MAX_SUBSET_VISITS = 15  # 32,768 subsets


def least_order(
    costs: Floats, before: Truths, first: int | None, last: int | None, closed: bool
) -> tuple[float, tuple[int, ...]] | None:
    """The cost and the order that costs least; None if no order keeps all conditions.

    `costs` (n, n) is the cost from each visit to each other one, `before` (n, n) says which visit
    comes before which, in the order from its first visit on.
    """
    n = len(costs)
    starts = [visit for visit in range(n) if not before[:, visit].any()]
    if first is not None:
        starts = [first] if first in starts else []
    elif closed and last is None and not before.any():
        starts = [0]  # a closed tour may be said from any visit on
    groups = [[start] for start in starts] if closed else [starts]
    best: tuple[float, tuple[int, ...]] | None = None
    for group in groups:
        table = _subset_costs(costs, before, group, last)
        ends = table[-1] + (costs[:, group[0]] if closed and n > 1 else 0.0)
        if last is not None:
            ends = np.where(np.arange(n) == last, ends, np.inf)
        end = int(np.argmin(ends))
        if np.isfinite(ends[end]) and (best is None or ends[end] < best[0]):
            best = float(ends[end]), _order_back(table, costs, end)
    return best


def least_order_of(problem: TourProblem) -> tuple[int, tuple[int, ...]] | None:
    """The same for a problem without windows."""
    least = least_order(
        problem.arcs.astype(np.float64),
        comes_before(problem, range(len(problem.visits))),
        problem.start,
        problem.end,
        problem.closed,
    )
    return None if least is None else (round(least[0]), least[1])


def comes_before(problem: TourProblem, members: Sequence[int]) -> Truths:
    """Which of some visits comes before which (k, k), by precedence and phases."""
    place = {visit: number for number, visit in enumerate(members)}
    phases = np.array([problem.visits[visit].phase for visit in members], np.int64)
    before: Truths = phases[:, None] < phases[None, :]
    for one, other in problem.precedence:
        if one in place and other in place:
            before[place[one], place[other]] = True
    return before


def _subset_costs(costs: Floats, before: Truths, starts: list[int], last: int | None) -> Floats:
    """What it costs at least to make the visits of a subset and end at one of them (2^n, n)."""
    n = len(costs)
    table: Floats = np.full((1 << n, n), np.inf)
    for start in starts:
        table[1 << start, start] = 0.0
    subsets = np.arange(1 << n, dtype=np.int64)
    sizes = np.array([((subsets >> visit) & 1) for visit in range(n)]).sum(axis=0)
    earlier = [sum(1 << int(visit) for visit in np.flatnonzero(row)) for row in before.T]
    for size in range(1, n):
        own: Longs = subsets[sizes == size]
        own = own[np.isfinite(table[own]).any(axis=1)]
        going = table[own]
        for visit in range(n):
            may = ((own >> visit) & 1 == 0) & (own & earlier[visit] == earlier[visit])
            if visit == last and size < n - 1:
                continue
            table[own[may] | (1 << visit), visit] = (going[may] + costs[:, visit]).min(
                axis=1, initial=np.inf
            )
    return table


def _order_back(table: Floats, costs: Floats, end: int) -> tuple[int, ...]:
    """The order of all visits whose cost the table has for its last one."""
    order, subset = [end], len(table) - 1
    while subset & (subset - 1):
        subset ^= 1 << order[-1]
        order.append(int(np.argmin(table[subset] + costs[:, order[-1]])))
    return tuple(order[::-1])
