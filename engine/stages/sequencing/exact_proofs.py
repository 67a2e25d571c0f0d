"""Proofs of tours by CP-SAT: a circuit over the visits, with times and ranks.

The solver runs with one worker and a limit on its deterministic time, so the same problem gives the
same answer.
"""

from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass
from typing import Any

import numpy as np
from ortools.sat.python import cp_model

from cellwright.engine.kernels.arrays import Longs, Truths
from cellwright.engine.model.tour_problem import TourProblem
from cellwright.engine.stages.sequencing.search_limits import TourLimits

Arcs = dict[tuple[int, int], cp_model.IntVar]
STOP_CHECK_PERIOD_S = 0.05  # seconds between two checks whether to stop


@dataclass(frozen=True, slots=True)
class ExactAnswer:
    """The best order found, if any; a lower bound; and whether it is proved that there is no
    order.
    """

    order: tuple[int, ...] | None
    lower_bound: int
    infeasible: bool = False


def solve_circuit(
    cost: Longs, allowed: Truths, upper: int, order: tuple[int, ...], limits: TourLimits
) -> ExactAnswer:
    """A closed tour of least cost along the `allowed` arcs (n, n), from a known `order` of cost
    `upper`.
    """
    model = cp_model.CpModel()
    arcs = {(int(a), int(b)): model.new_bool_var("") for a, b in np.argwhere(allowed) if a != b}
    model.add_circuit([(a, b, arc) for (a, b), arc in arcs.items()])
    total = cp_model.LinearExpr.weighted_sum(
        list(arcs.values()), [int(cost[pair]) for pair in arcs]
    )
    model.add(total <= upper)
    model.minimize(total)
    _hint_order(model, arcs, order)
    return _solve_model(model, arcs, len(cost), limits)


def solve_ordered(
    problem: TourProblem, order: tuple[int, ...] | None, limits: TourLimits
) -> ExactAnswer:
    """An order of least cost that keeps all conditions of the problem; `order` is a hint."""
    model, n = cp_model.CpModel(), len(problem.visits)
    cost = problem.arcs
    arcs = {(a, b): model.new_bool_var("") for a in range(n) for b in range(n) if a != b}
    first, last = _end_literals(model, problem, arcs)
    model.add_circuit([(a, b, arc) for (a, b), arc in arcs.items()])
    inner = [pair for pair in arcs if n not in pair]
    total = cp_model.LinearExpr.weighted_sum(
        [arcs[pair] for pair in inner], [int(cost[pair]) for pair in inner]
    )
    model.minimize(total + _way_back(model, problem, cost, first, last))
    if problem.precedence:
        _rank_visits(model, problem, arcs)
    if problem.timed:
        _time_visits(model, problem, cost, arcs)
    if order is not None:
        _hint_order(model, arcs, (*order, n))
    return _solve_model(model, arcs, n + 1, limits)


def _end_literals(
    model: cp_model.CpModel, problem: TourProblem, arcs: Arcs
) -> tuple[list[cp_model.IntVar], list[cp_model.IntVar]]:
    """Literals for the first and the last visit: arcs from and to one more node, n, between the
    two.
    """
    n = len(problem.visits)
    first = [model.new_bool_var("") for _ in range(n)]
    last = [model.new_bool_var("") for _ in range(n)]
    for visit in range(n):
        arcs[n, visit], arcs[visit, n] = first[visit], last[visit]
    if problem.start is not None:
        model.add(first[problem.start] == 1)
    if problem.end is not None:
        model.add(last[problem.end] == 1)
    return first, last


def _way_back(
    model: cp_model.CpModel,
    problem: TourProblem,
    cost: Longs,
    first: list[cp_model.IntVar],
    last: list[cp_model.IntVar],
) -> cp_model.IntVar:
    """The cost of the arc that closes the tour; 0 if the tour is open."""
    n = len(first)
    if not problem.closed or n == 1:
        return model.new_constant(0)
    back = model.new_int_var(0, int(cost.max()), "")
    for a in range(n):
        for b in range(n):
            if a != b:
                model.add(back >= int(cost[a, b])).only_enforce_if(last[a], first[b])
    return back


def _rank_visits(model: cp_model.CpModel, problem: TourProblem, arcs: Arcs) -> None:
    n = len(problem.visits)
    rank = [model.new_int_var(0, n - 1, "") for _ in range(n)]
    for (a, b), arc in arcs.items():
        if a < n and b < n:
            model.add(rank[b] == rank[a] + 1).only_enforce_if(arc)
    for before, after in problem.precedence:
        model.add(rank[before] < rank[after])


def _time_visits(model: cp_model.CpModel, problem: TourProblem, cost: Longs, arcs: Arcs) -> None:
    n = len(problem.visits)
    longest = int(cost.max()) * n + sum(visit.duration for visit in problem.visits)
    horizon = longest + max(visit.window[0] for visit in problem.visits if visit.window is not None)
    clock = []
    for visit in problem.visits:
        early, late = visit.window or (0, horizon)
        if early > late:
            model.add_bool_or([])
        clock.append(
            model.new_int_var(min(early, horizon), max(min(late, horizon), min(early, horizon)), "")
        )
    for (a, b), arc in arcs.items():
        if a < n and b < n:
            wait = problem.visits[a].duration + int(cost[a, b])
            model.add(clock[b] >= clock[a] + wait).only_enforce_if(arc)


def _hint_order(model: cp_model.CpModel, arcs: Arcs, order: tuple[int, ...]) -> None:
    used = {(order[index - 1], order[index]) for index in range(len(order))}
    for pair, arc in arcs.items():
        model.add_hint(arc, pair in used)


def _run_solver(solver: cp_model.CpSolver, model: cp_model.CpModel, limits: TourLimits) -> Any:
    """Solve in a thread of its own, so that this thread can notice an interrupt and end the
    search.
    """
    with ThreadPoolExecutor(1) as pool:
        running = pool.submit(solver.solve, model)
        while not wait([running], STOP_CHECK_PERIOD_S).done:
            if limits.interrupted():
                solver.stop_search()
        return running.result()


def _solve_model(model: cp_model.CpModel, arcs: Arcs, n: int, limits: TourLimits) -> ExactAnswer:
    """The best order that the solver finds; it begins after the last node."""
    solver = cp_model.CpSolver()
    solver.parameters.num_workers = 1
    solver.parameters.random_seed = limits.seed
    solver.parameters.linearization_level = 2
    solver.parameters.max_deterministic_time = limits.proof
    solver.parameters.catch_sigint_signal = False
    status = _run_solver(solver, model, limits)
    if status == cp_model.INFEASIBLE:
        return ExactAnswer(None, 0, True)
    if status not in (cp_model.OPTIMAL, cp_model.FEASIBLE):
        return ExactAnswer(None, 0)
    follower = {a: b for (a, b), arc in arcs.items() if solver.boolean_value(arc)}
    order, at = list[int](), follower[n - 1]
    while at != n - 1:
        order.append(at)
        at = follower[at]
    return ExactAnswer((*order, n - 1), int(np.ceil(solver.best_objective_bound - 1e-6)))
