"""Which method suits which problem, and how problems become closed tours.

Fixed or free ends are modelled by one more city. The way from the last visit to this city and the way from it
to the first visit cost nothing. Every other way to it costs more than any order could save.
"""

from dataclasses import replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from engine.kernels.arrays import Floats, Ints, Longs
from engine.model.outcome import GaveUp, Infeasible
from engine.model.tour import Tour, TourProblem, cost_of, violations
from engine.stages.sequencing import phases, symmetric
from engine.stages.sequencing.chain1987 import chain
from engine.stages.sequencing.limits import Limits
from engine.stages.sequencing.ordered import best_first_order, solve_directed

METHODS = ("auto", "chain1987", "exact")
PROVABLE = 120  # the default method tries to prove its tour up to this number of visits
SMALL = 9  # up to this number of visits everything is solved exactly at once

Answer = Tour | Infeasible | GaveUp


def sequence(problem: TourProblem, limits: Limits = Limits(), method: str = "auto") -> Answer:
    """The best order found within the limits, with a lower bound; or why there is none.

    `method` is one of METHODS. The chain of 1987 works only with symmetric costs, without windows and
    precedence; in other cases the answer is `GaveUp`.
    """
    n = len(problem.visits)
    if n == 0:
        return Tour((), 0, 0, method=method)
    if (reason := phases.refused(problem) or _contradiction(problem)) is not None:
        return Infeasible(reason)
    if problem.phased and (problem.precedence or problem.timed or n <= SMALL):
        problem = phases.in_pairs(problem)
    if problem.phased:
        return phases.by_phases(problem, limits, method, sequence)
    if n == 1:
        single = Tour((0,), 0, 0, method=method)
        return Infeasible(wrong[0]) if (wrong := violations(problem, (0,))) else single
    plain = not problem.ordered and _symmetric(problem)
    if method == "chain1987" and not plain:
        return GaveUp(
            "the chain of 1987 works only with symmetric costs, without windows and precedence", "method"
        )
    if (n <= SMALL and method != "chain1987") or not plain:
        return solve_directed(problem, limits, exact=n <= SMALL or method == "exact")
    return _plain(problem, limits, method)


def _contradiction(problem: TourProblem) -> str | None:
    names = [visit.name for visit in problem.visits]
    if problem.start is not None and problem.start == problem.end and len(names) > 1:
        return f"{names[problem.start]} cannot be both the first and the last of several visits"
    for visit in problem.visits:
        if visit.window is not None and visit.window[0] > visit.window[1]:
            return f"the window of {visit.name} ends before it begins"
    if best_first_order(problem) is None:
        return "the precedence of the visits has a cycle"
    return None


def _symmetric(problem: TourProblem) -> bool:
    arcs = problem.arcs
    return bool((arcs == arcs.T).all())


def _plain(problem: TourProblem, limits: Limits, method: str) -> Tour:
    """The tour for symmetric costs without side conditions."""
    n, fixed = len(problem.visits), problem.start is not None and problem.end is not None
    circle = problem.closed and not fixed
    cost, extra = _circle(problem) if circle else _with_ends(problem)
    positions = _positions(problem) if circle else None
    narrow = _narrow(cost)
    if method == "chain1987":
        tour, work = chain(narrow, positions), 0
    else:
        start = chain(narrow, positions) if n <= 12 else nearest_first(narrow)
        found = symmetric.search(narrow, start, limits, positions)
        tour, work = found.order, found.work
    order = _unrolled(problem, tour)
    if violations(problem, order):
        order = best_first_order(problem) or tuple(range(n))
    made = Tour(order, cost_of(problem, order), 0, work, method)
    return _bounded(problem, made, cost, extra, limits)


def _circle(problem: TourProblem) -> tuple[Longs, int]:
    return problem.arcs, 0


def _with_ends(problem: TourProblem) -> tuple[Longs, int]:
    """Costs (n + 1, n + 1) with one more city, and what must be added to the cost of a tour with it."""
    n, arcs = len(problem.visits), problem.arcs
    dear = 4 * int(arcs.max(initial=0)) + 1
    cost = np.zeros((n + 1, n + 1), np.int64)
    cost[:n, :n] = arcs
    ends = {problem.start, problem.end} - {None}
    extra = 0
    if ends:
        cost[n, :n] = cost[:n, n] = dear
        for end in ends:
            cost[n, end] = cost[end, n] = 0
        extra = -dear * (2 - len(ends))
    if problem.closed and problem.start is not None and problem.end is not None:
        extra += int(arcs[problem.end, problem.start])
    return cost, extra


def _narrow(cost: Longs) -> symmetric.Matrix:
    """The costs in 32 bits if sums of four of them fit, else unchanged."""
    return cost.astype(np.int32) if cost.max(initial=0) < 2**28 else cast(symmetric.Matrix, cost)


def nearest_first(cost: NDArray[np.integer]) -> symmetric.Order:
    """A tour that always goes to the nearest city not yet visited."""
    n, at = len(cost), 0
    order, left = np.zeros(n, np.int32), np.ones(n, bool)
    for index in range(1, n):
        left[at] = False
        row = np.where(left, cost[at], np.iinfo(cost.dtype).max)
        at = int(np.argmin(row))
        order[index] = at
    return order


def _positions(problem: TourProblem) -> Floats | None:
    """The positions of the visits (n, 2), if all have two coordinates and there are no changes of tool."""
    if problem.changes:
        return None
    found = [visit.position for visit in problem.visits]
    if any(each is None or len(each) != 2 for each in found):
        return None
    return np.array(found, float)


def _unrolled(problem: TourProblem, tour: Ints) -> tuple[int, ...]:
    """The order of the visits in a closed tour, from the right visit on and in the right direction."""
    n, order = len(problem.visits), [int(each) for each in tour]
    if n in order:
        at = order.index(n)
        order = order[at + 1 :] + order[:at]
        if (problem.start is not None and order[0] != problem.start) or (
            problem.end is not None and order[-1] != problem.end
        ):
            order.reverse()
        return tuple(order)
    if problem.start is None and problem.end is not None:
        at = order.index(problem.end) + 1
    else:
        at = order.index(problem.start or 0)
    order = order[at:] + order[:at]
    return tuple(order)


def _rolled(problem: TourProblem, order: tuple[int, ...], cost: Longs) -> tuple[int, ...]:
    return (*order, len(order)) if len(cost) > len(problem.visits) else order


def _bounded(problem: TourProblem, made: Tour, cost: Longs, extra: int, limits: Limits) -> Tour:
    """The tour with a lower bound. If a proof seems possible, it is proved or replaced by a better tour."""
    from engine.stages.sequencing.kernels.bounds import excess

    upper = made.cost - extra
    provable = len(problem.visits) <= PROVABLE or made.method == "exact"
    narrow = _narrow(cost)
    lower, penalties = symmetric.bound(narrow, upper, 2000 if provable else 0, limits.interrupted)
    made = replace(made, lower_bound=max(0, min(lower + extra, made.cost)))
    if made.proved or not provable or made.method == "chain1987" or limits.interrupted() or not limits.proof:
        return made
    from engine.stages.sequencing.exact import solve_circuit

    allowed = lower + excess(narrow, penalties) <= upper + 1
    rolled = _rolled(problem, made.order, cost)
    allowed[list(rolled), [*rolled[1:], rolled[0]]] = True
    allowed |= allowed.T
    solved = solve_circuit(cost, allowed, upper, rolled, limits)
    if solved.order is None:
        return made
    order = _unrolled(problem, np.array(solved.order, np.int32))
    found = cost_of(problem, order)
    bound = max(made.lower_bound, min(solved.lower_bound + extra, found))
    if found <= made.cost and not violations(problem, order):
        return replace(made, order=order, cost=found, lower_bound=bound)
    return replace(made, lower_bound=min(bound, made.cost))
