"""Which method suits which problem, and how problems become closed tours.

Fixed or free ends are modelled by one more city. The way from the last visit to this city and the way from it
to the first visit cost nothing. Every other way to it costs more than any order could save.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cellwright.engine.kernels.arrays import Floats, Ints, Longs
from cellwright.engine.model.metric import Metric
from cellwright.engine.model.outcome import GaveUp, Infeasible
from cellwright.engine.model.tour import Tour, TourProblem, cost_of, violations
from cellwright.engine.stages.sequencing import heldkarp, phases, symmetric, windows
from cellwright.engine.stages.sequencing.chain1987 import chain
from cellwright.engine.stages.sequencing.costs import Costs, of_matrix
from cellwright.engine.stages.sequencing.curve import along_hilbert
from cellwright.engine.stages.sequencing.limits import Limits
from cellwright.engine.stages.sequencing.ordered import best_first_order, solve_directed

METHODS = ("auto", "chain1987", "exact")
FEW = 20  # so few cities have no clusters
PROVABLE = 120  # the default method tries to prove its tour up to this number of visits
MATRIX = 8000  # more visits have no matrix of costs, which some methods need
CHAINED = 12  # up to this number of visits the search begins with the chain of 1987
CLOSE = 0.01  # a bound farther below the tour is raised after the search, if there is time
LATER = 6_000_000  # cities that are looked at then
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
        free = not problem.closed and problem.start is None and problem.end is None
        improved = _from if method == "auto" and free and _symmetric(problem) else None
        return phases.by_phases(problem, limits, method, sequence, improved)
    return _alone(problem, method) if n == 1 else _in_one(problem, limits, method)


def _alone(problem: TourProblem, method: str) -> Answer:
    """The tour of one visit."""
    wrong = violations(problem, (0,))
    return Infeasible(wrong[0]) if wrong else Tour((0,), 0, 0, method=method)


def _in_one(problem: TourProblem, limits: Limits, method: str) -> Answer:
    """The tour of two visits or more without phases."""
    n, plain = len(problem.visits), not problem.ordered and _symmetric(problem)
    if method == "chain1987" and not plain:
        return GaveUp(
            "the chain of 1987 works only with symmetric costs, without windows and precedence", "method"
        )
    if n > MATRIX and (method != "auto" or not plain):
        return GaveUp(
            f"{_beyond(method, plain)} needs all costs between visits: at most {MATRIX} visits", "memory"
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
    return windows.clash(problem)


def _beyond(method: str, plain: bool) -> str:
    """What cannot be done for so many visits."""
    if plain:
        return f"the method {method}"
    return "a tour with windows, precedence or costs that depend on the direction"


def _symmetric(problem: TourProblem) -> bool:
    _, extra = problem.kinds
    if not isinstance(problem.travel, Metric):
        return bool((problem.arcs == problem.arcs.T).all())
    return bool((extra == extra.T).all())


def _from(problem: TourProblem, limits: Limits, order: tuple[int, ...]) -> Tour:
    """The tour for symmetric costs without side conditions, of which a good order is known."""
    return _plain(problem, limits, "auto", order)


def _plain(problem: TourProblem, limits: Limits, method: str, begun: tuple[int, ...] = ()) -> Tour:
    """The tour for symmetric costs without side conditions. The search begins with an order, if one is known."""
    n, fixed = len(problem.visits), problem.start is not None and problem.end is not None
    circle = problem.closed and not fixed
    costs, extra = (_costs(problem), 0) if circle else _with_ends(problem)
    start = np.array(_rolled(problem, begun, costs), np.int32) if begun else _start(problem, costs, method)
    if method == "chain1987":
        return _bounded(problem, _made(problem, start, 0, method), costs, extra, limits)
    near = symmetric.candidates(costs, _positions(problem) if circle else None, limits.interrupted)
    provable = n <= PROVABLE or method == "exact"
    quick = symmetric.search(costs, start, replace(limits, work=1), near)
    opened = not circle
    lower = 0 if provable else heldkarp.bound(costs, near, quick.order, limits.interrupted, opened=opened)[0]
    found = symmetric.search(costs, quick.order, limits, near)
    made = _made(problem, found.order, found.work, method)
    if provable:
        return _bounded(problem, made, costs, extra, limits)
    if limits.sharp and not limits.interrupted() and found.cost - lower > CLOSE * found.cost:
        lower = max(lower, heldkarp.bound(costs, near, found.order, limits.interrupted, LATER, opened)[0])
    return replace(made, lower_bound=max(0, min(lower + extra, made.cost)))


def _made(problem: TourProblem, tour: Ints, work: int, method: str) -> Tour:
    """The tour of the problem that a closed tour of cities stands for."""
    order = _unrolled(problem, tour)
    if violations(problem, order):
        order = best_first_order(problem) or tuple(range(len(order)))
    return Tour(order, cost_of(problem, order), 0, work, method)


def _start(problem: TourProblem, costs: Costs, method: str) -> symmetric.Order:
    """The first tour of the search."""
    n = len(problem.visits)
    if isinstance(problem.travel, Metric) and method != "chain1987":
        others = np.arange(n, len(costs), dtype=np.int32)
        return np.concatenate((along_hilbert(problem.travel.points), others))
    matrix = _matrix(costs)
    if n <= CHAINED or method == "chain1987":
        return chain(matrix, _positions(problem) if len(costs) == n else None)
    return nearest_first(matrix)


def _matrix(costs: Costs) -> symmetric.Matrix:
    """All costs."""
    every = np.arange(len(costs))
    matrix = costs.between(every[:, None], every[None]) if costs.matrix is None else costs.matrix
    narrow = of_matrix(matrix).matrix
    assert narrow is not None
    return narrow


def _costs(problem: TourProblem, ends: Longs | None = None) -> Costs:
    """The costs between visits, and to one more city if there are `ends`. A metric stays a metric."""
    if isinstance(problem.travel, Metric):
        kind, extra = problem.kinds
        groups = (kind, extra) if problem.changes else (kind[:0], extra[:1, :1])
        return Costs(None, problem.travel, *groups, np.zeros(0, np.int64) if ends is None else ends)
    if ends is None:
        return of_matrix(problem.arcs)
    n = len(problem.visits)
    cost = np.zeros((n + 1, n + 1), np.int64)
    cost[:n, :n] = problem.arcs
    cost[n], cost[:, n] = ends, ends
    return of_matrix(cost)


def _with_ends(problem: TourProblem) -> tuple[Costs, int]:
    """Costs with one more city, and what must be added to the cost of a tour with it."""
    n, named = len(problem.visits), {each for each in (problem.start, problem.end) if each is not None}
    toward, extra = np.zeros(n + 1, np.int64), 0
    if named:
        dear = 4 * _dearest(problem) + 1
        toward[:n] = dear
        toward[list(named)] = 0
        extra = -dear * (2 - len(named))
    if problem.closed and problem.start is not None and problem.end is not None:
        extra += problem.lengths((problem.end, problem.start))[0]
    return _costs(problem, toward), extra


def _dearest(problem: TourProblem) -> int:
    """No arc costs more."""
    if not isinstance(problem.travel, Metric):
        return int(problem.arcs.max(initial=0))
    points = problem.travel.points
    corners = Metric(problem.travel.kind, np.array((points.min(axis=0), points.max(axis=0))))
    across = corners.between(np.array([0], np.int32), np.array([1], np.int32))
    return int(across[0]) + 1 + int(problem.kinds[1].max(initial=0))


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


def _rolled(problem: TourProblem, order: tuple[int, ...], costs: Costs) -> tuple[int, ...]:
    return (*order, len(order)) if len(costs) > len(problem.visits) else order


def _lower(
    costs: Costs, matrix: symmetric.Matrix, tour: Ints, opened: bool, limits: Limits, provable: bool
) -> tuple[int, Floats]:
    """A lower bound and its penalties (n,). Where clusters keep it far from the tour, it is raised for whole clusters first."""
    upper, steps = costs.of_tour(tour), 2000 if provable else 0
    found = symmetric.bound(matrix, upper, steps, limits.interrupted)
    if not provable or len(costs) < FEW or upper - found[0] <= CLOSE * upper or limits.interrupted():
        return found
    near = symmetric.candidates(costs, None, limits.interrupted)
    _, penalties = heldkarp.bound(costs, near, tour, limits.interrupted, opened=opened)
    again = symmetric.bound(matrix, upper, steps, limits.interrupted, penalties)
    return max(found, again, key=lambda each: each[0])


def _bounded(problem: TourProblem, made: Tour, costs: Costs, extra: int, limits: Limits) -> Tour:
    """The tour with a lower bound by a matrix. If a proof seems possible, it is proved or replaced by a better tour."""
    from cellwright.engine.stages.sequencing.kernels.bounds import excess

    upper, matrix = made.cost - extra, _matrix(costs)
    provable = len(problem.visits) <= PROVABLE or made.method == "exact"
    rolled = np.array(_rolled(problem, made.order, costs), np.int32)
    lower, penalties = _lower(costs, matrix, rolled, len(costs) > len(problem.visits), limits, provable)
    made = replace(made, lower_bound=max(0, min(lower + extra, made.cost)))
    if made.proved or not provable or made.method == "chain1987" or limits.interrupted() or not limits.proof:
        return made
    from cellwright.engine.stages.sequencing.exact import solve_circuit

    allowed = lower + excess(matrix, penalties) <= upper + 1
    allowed[rolled, np.roll(rolled, -1)] = True
    allowed |= allowed.T
    solved = solve_circuit(matrix.astype(np.int64), allowed, upper, tuple(rolled.tolist()), limits)
    if solved.order is None:
        return made
    order = _unrolled(problem, np.array(solved.order, np.int32))
    found = cost_of(problem, order)
    bound = max(made.lower_bound, min(solved.lower_bound + extra, found))
    if found <= made.cost and not violations(problem, order):
        return replace(made, order=order, cost=found, lower_bound=bound)
    return replace(made, lower_bound=min(bound, made.cost))
