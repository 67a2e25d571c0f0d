"""Tours under windows, precedence or directed costs: annealing, with CP-SAT for proofs."""

import graphlib
from heapq import heappop, heappush

import numpy as np

from cellwright.engine.kernels.arrays import Longs
from cellwright.engine.model.outcome import GaveUp, Infeasible
from cellwright.engine.model.tour_problem import Tour, TourProblem, cost_of, tour_violations
from cellwright.engine.stages.sequencing.city_costs import nearest_cities
from cellwright.engine.stages.sequencing.directed_bounds import (
    directed_lower_bound,
    search_directed,
)
from cellwright.engine.stages.sequencing.search_limits import TourLimits

MAX_DIRECTED_PROOF_VISITS = 40  # a proof is tried up to this number of visits
# between these numbers of visits, directed costs become costs of twice as many cities
FEW, DOUBLED = 9, 2500
ANNEALING_SLICE = 20_000
MAX_MOVES = 5_000_000  # the greatest number of moves, if the caller sets none
FAR_PRICE = 2**62
FINE, HEAVIEST = 2, 256  # the first and the greatest fine for each unit of lateness


def best_first_order(problem: TourProblem) -> tuple[int, ...] | None:
    """An order that keeps precedence and ends, urgent visits first; None if precedence and ends
    form a cycle.
    """
    n = len(problem.visits)
    before: dict[int, set[int]] = {visit: set() for visit in range(n)}
    for first, second in problem.precedence:
        before[second].add(first)
    for visit in range(n):
        if problem.start is not None and visit != problem.start:
            before[visit].add(problem.start)
        if problem.end is not None and visit != problem.end:
            before[problem.end].add(visit)
    sorter, order = graphlib.TopologicalSorter(before), []
    try:
        sorter.prepare()
    except graphlib.CycleError:
        return None
    ready: list[tuple[int, int]] = []
    while sorter.is_active():
        for visit in sorter.get_ready():
            heappush(ready, _visit_urgency(problem, visit))
        _, visit = heappop(ready)
        order.append(visit)
        sorter.done(visit)
    return tuple(order)


def _visit_urgency(problem: TourProblem, visit: int) -> tuple[int, int]:
    window = problem.visits[visit].window
    return (window[1] if window is not None else FAR_PRICE, visit)


def solve_directed(
    problem: TourProblem, limits: TourLimits, exact: bool = False
) -> Tour | Infeasible | GaveUp:
    """The best order found. A proof is tried if there are few visits or `exact` asks for it."""
    if FEW < len(problem.visits) <= DOUBLED and not problem.ordered:
        order, work = search_directed(problem, best_first_order(problem) or (), limits)
    else:
        order, work = _anneal_order(problem, limits)
    valid_order = _first_valid(problem, order, best_first_order(problem) or ())
    lower = (
        0
        if valid_order is None
        else directed_lower_bound(problem, cost_of(problem, valid_order), limits.interrupted)
    )
    if (
        (exact or len(problem.visits) <= MAX_DIRECTED_PROOF_VISITS)
        and limits.proof
        and not limits.interrupted()
    ):
        from cellwright.engine.stages.sequencing.exact_proofs import solve_ordered

        solved = solve_ordered(problem, valid_order, limits)
        if solved.infeasible:
            return Infeasible("no order of the visits keeps all windows and the precedence")
        if solved.order is not None:
            lower = max(lower, solved.lower_bound)
            exact_order = solved.order[:-1]
            if valid_order is None or cost_of(problem, exact_order) < cost_of(problem, valid_order):
                valid_order = exact_order
    if valid_order is None:
        return GaveUp("no order that keeps all windows was found within the limits", "expansions")
    cost = cost_of(problem, valid_order)
    return Tour(valid_order, cost, min(lower, cost), work, "annealing")


def _first_valid(problem: TourProblem, *orders: tuple[int, ...]) -> tuple[int, ...] | None:
    """The first of some orders that keeps all conditions; None if none does."""
    return next((order for order in orders if not tour_violations(problem, order)), None)


def _anneal_order(problem: TourProblem, limits: TourLimits) -> tuple[tuple[int, ...], int]:
    """The order of least price, and the moves made. Each annealing is twice as long as the one
    before.

    Broken windows and precedence are fined. The fines are light at first, so that the search can
    pass through such orders, and grow later.
    """
    from cellwright.engine.stages.sequencing.kernels.directed import anneal, price

    n, arcs = len(problem.visits), problem.arcs
    low, high = int(problem.start is not None), n - int(problem.end is not None)
    best = np.array(best_first_order(problem), np.int32)
    if high - low < 2:
        return tuple(map(int, best)), 0
    near = nearest_cities(arcs.T)
    pairs = np.array(problem.precedence, np.int64).reshape(-1, 2)
    mean, heavy = max(1, int(arcs.mean())), FINE
    rules, fine = (_visit_times(problem), pairs), np.zeros(2, np.int64)
    total, done, phase, seed = (
        limits.work or min(20_000 + 20_000 * n, MAX_MOVES),
        0,
        5000 + 500 * n,
        limits.seed,
    )
    while done < total and not limits.interrupted():
        if problem.ordered:
            fine = np.array([heavy, heavy * mean], np.int64)
            heavy = min(2 * heavy, HEAVIEST)
        moves = min(phase, total - done)
        warmth, order, moves_left = 0.5 * mean, best.copy(), moves
        cooling = 0.002 ** (1 / moves)
        value = int(price(best, arcs, problem.closed, *rules, fine))
        while moves_left > 0 and not limits.interrupted():
            seed, now = seed + 1, min(ANNEALING_SLICE, moves_left)
            annealed_order, cost, warmth = anneal(
                order,
                arcs,
                near,
                problem.closed,
                low,
                high,
                *rules,
                fine,
                now,
                warmth,
                cooling,
                seed,
            )
            if cost < value:
                best, value = annealed_order, cost
            moves_left, done = moves_left - now, done + now
        phase *= 2
    return tuple(map(int, best)), done


def _visit_times(problem: TourProblem) -> Longs:
    """Durations, earliest beginnings and latest beginnings (3, n)."""
    windows = [visit.window or (0, FAR_PRICE) for visit in problem.visits]
    rows = (
        [visit.duration for visit in problem.visits],
        [w[0] for w in windows],
        [w[1] for w in windows],
    )
    return np.array(rows, np.int64)
