"""Choice of the method for a tour problem, its closed tour of cities, and clashing windows."""

from dataclasses import replace

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Ints, Longs
from cellwright.engine.model.outcome import GaveUp, Infeasible
from cellwright.engine.model.tour_problem import Metric, Tour, TourProblem, cost_of, tour_violations
from cellwright.engine.stages.sequencing import (
    farthest,
    held_karp_bound,
    phased_tours,
    symmetric_tours,
)
from cellwright.engine.stages.sequencing.city_costs import CityCosts, of_matrix
from cellwright.engine.stages.sequencing.directed_tours import best_first_order, solve_directed
from cellwright.engine.stages.sequencing.first_tours import (
    along_hilbert,
    chain_tour,
    nearest_first_tour,
)
from cellwright.engine.stages.sequencing.search_limits import TourLimits
from cellwright.engine.stages.sequencing.subset_orders import MAX_SUBSET_VISITS, least_order_of

MAX_WINDOW_VISITS = 400  # visits; of more, shortest ways by way of other visits take too long


def clashing_windows(problem: TourProblem) -> str | None:
    """Two visits that cannot both begin in their windows, in words; None if no two of them
    exclude each other.
    """
    timed = [n for n, visit in enumerate(problem.visits) if visit.window is not None]
    if len(timed) < 2 or len(problem.visits) > MAX_WINDOW_VISITS:
        return None
    ways = _least_times(problem)
    for n, first_visit in enumerate(timed):
        for second_visit in timed[n + 1 :]:
            if _too_late(problem, ways, first_visit, second_visit) and _too_late(
                problem, ways, second_visit, first_visit
            ):
                return _clash_text(problem, ways, first_visit, second_visit)
    return None


def _least_times(problem: TourProblem) -> Longs:
    """The least time (n, n) from the start of one visit to that of another, by way of any
    others (Floyd 1962).
    """
    lasts = np.array([visit.duration for visit in problem.visits], np.int64)
    ways: Longs = problem.arcs + lasts[:, None]
    for through in range(len(ways)):
        np.minimum(ways, ways[:, through, None] + ways[None, through], out=ways)
    return ways


def _too_late(problem: TourProblem, ways: Longs, first: int, second: int) -> bool:
    """Whether a visit begins too late if it comes after another one."""
    first_window, second_window = problem.visits[first].window, problem.visits[second].window
    return (
        first_window is not None
        and second_window is not None
        and first_window[0] + int(ways[first, second]) > second_window[1]
    )


def _clash_text(problem: TourProblem, ways: Longs, first_visit: int, second_visit: int) -> str:
    a, b = problem.visits[first_visit].name, problem.visits[second_visit].name
    unit = f" {problem.unit}" if problem.unit else ""
    way_there, back = (
        f"{ways[first_visit, second_visit]}{unit}",
        f"{ways[second_visit, first_visit]}{unit}",
    )
    return (
        f"{a} and {b} cannot both begin in their windows: {b} begins {way_there} after {a} at "
        "the soonest, "
        f"and {a} {back} after {b}"
    )


METHODS = ("auto", "chain1987", "exact")
MAX_UNCLUSTERED_CITIES = 20  # so few cities have no clusters
MAX_PROOF_VISITS = 120  # the default method tries to prove its tour up to this number of visits
MAX_MATRIX_VISITS = 8000  # more visits have no matrix of costs, which some methods need
CHAINED = 12  # up to this number of visits the search begins with the chain of 1987
# a bound farther below the tour is raised after the search, if there is time
CLOSE_BOUND_SHARE = 0.01
LATER_CITIES = 6_000_000  # cities that are looked at then
MAX_EXACT_VISITS = 9  # up to this number of visits everything is solved exactly at once

Answer = Tour | Infeasible | GaveUp


def sequence_tour(
    problem: TourProblem, limits: TourLimits = TourLimits(), method: str = "auto"
) -> Answer:
    """The best order found within the limits, with a lower bound; or why there is none.

    `method` is one of METHODS. The chain of 1987 works only with symmetric costs, without windows
    and precedence; in other cases the answer is `GaveUp`.
    """
    found = _sequenced(problem, limits, method)
    if not isinstance(found, Tour) or limits.interrupted():
        return found
    if method != "chain1987" and limits.proof:
        found = _proved_by_subsets(problem, found)
    return farthest.raised(problem, found, limits.interrupted)


def _proved_by_subsets(problem: TourProblem, tour: Tour) -> Tour:
    """The least tour of few visits, where the search has not proved its own; windows are left to
    the search.
    """
    if tour.proved or problem.timed or len(problem.visits) > MAX_SUBSET_VISITS:
        return tour
    least = least_order_of(problem)
    if least is None:
        return tour
    cost, order = least
    return replace(
        tour, order=order if cost < tour.cost else tour.order, cost=cost, lower_bound=cost
    )


def _sequenced(problem: TourProblem, limits: TourLimits, method: str) -> Answer:
    """The best order found, with the bounds of the search."""
    n = len(problem.visits)
    if n == 0:
        return Tour((), 0, 0, method=method)
    if (
        reason := phased_tours.phase_contradiction(problem) or _find_contradiction(problem)
    ) is not None:
        return Infeasible(reason)
    if problem.phased and (problem.precedence or problem.timed or n <= MAX_EXACT_VISITS):
        problem = phased_tours.in_pairs(problem)
        if best_first_order(problem) is None:
            return Infeasible("the precedence of the visits contradicts their phases")
    if problem.phased:
        plain = method == "auto" and not problem.timed and not problem.precedence
        improved = _tour_from if plain and _is_symmetric(problem) else None
        return phased_tours.by_phases(problem, limits, method, sequence_tour, improved)
    return _single_visit_tour(problem, method) if n == 1 else _in_one(problem, limits, method)


def _single_visit_tour(problem: TourProblem, method: str) -> Answer:
    """The tour of one visit."""
    wrong = tour_violations(problem, (0,))
    return Infeasible(wrong[0]) if wrong else Tour((0,), 0, 0, method=method)


def _in_one(problem: TourProblem, limits: TourLimits, method: str) -> Answer:
    """The tour of two visits or more without phases."""
    n, plain = len(problem.visits), not problem.ordered and _is_symmetric(problem)
    if method == "chain1987" and not plain:
        return GaveUp(
            "the chain of 1987 works only with symmetric costs, without windows and precedence",
            "method",
        )
    if n > MAX_MATRIX_VISITS and (method != "auto" or not plain):
        return GaveUp(
            f"{_method_limit(method, plain)} needs all costs between visits: at most "
            f"{MAX_MATRIX_VISITS} visits",
            "memory",
        )
    if (n <= MAX_EXACT_VISITS and method != "chain1987") or not plain:
        return solve_directed(problem, limits, exact=n <= MAX_EXACT_VISITS or method == "exact")
    return _plain_tour(problem, limits, method)


def _find_contradiction(problem: TourProblem) -> str | None:
    names = [visit.name for visit in problem.visits]
    if problem.start is not None and problem.start == problem.end and len(names) > 1:
        return f"{names[problem.start]} cannot be both the first and the last of several visits"
    for visit in problem.visits:
        if visit.window is not None and visit.window[0] > visit.window[1]:
            return f"the window of {visit.name} ends before it begins"
    if best_first_order(problem) is None:
        return "the precedence of the visits has a cycle"
    return clashing_windows(problem)


def _method_limit(method: str, plain: bool) -> str:
    """What cannot be done for so many visits."""
    if plain:
        return f"the method {method}"
    return "a tour with windows, precedence or costs that depend on the direction"


def _is_symmetric(problem: TourProblem) -> bool:
    _, extra = problem.kinds
    if not isinstance(problem.travel, Metric):
        return bool((problem.arcs == problem.arcs.T).all())
    return bool((extra == extra.T).all())


def _tour_from(problem: TourProblem, limits: TourLimits, order: tuple[int, ...]) -> Tour:
    """The tour for symmetric costs without side conditions, of which a good order is known."""
    return _plain_tour(problem, limits, "auto", order)


def _plain_tour(
    problem: TourProblem, limits: TourLimits, method: str, begun: tuple[int, ...] = ()
) -> Tour:
    """The tour for symmetric costs without side conditions.

    The search begins with an order, if one is known.
    """
    n, fixed = len(problem.visits), problem.start is not None and problem.end is not None
    circle = problem.closed and not fixed
    costs, extra = (_visit_costs(problem), 0) if circle else _with_ends(problem)
    start = (
        np.array(_roll_order(problem, begun, costs), np.int32)
        if begun
        else _first_tour(problem, costs, method)
    )
    if method == "chain1987":
        return _bound_tour(
            problem, _tour_of_cities(problem, start, 0, method), costs, extra, limits
        )
    near = symmetric_tours.tour_candidates(
        costs, _visit_positions(problem) if circle else None, limits.interrupted
    )
    provable = n <= MAX_PROOF_VISITS or method == "exact"
    quick = symmetric_tours.search_tour(costs, start, replace(limits, work=1), near)
    opened = not circle
    lower = (
        0
        if provable
        else held_karp_bound.sparse_lower_bound(
            costs, near, quick.order, limits.interrupted, opened=opened
        )[0]
    )
    search_result = symmetric_tours.search_tour(costs, quick.order, limits, near)
    best_tour = _tour_of_cities(problem, search_result.order, search_result.work, method)
    if provable:
        return _bound_tour(problem, best_tour, costs, extra, limits)
    if (
        limits.sharp
        and not limits.interrupted()
        and search_result.cost - lower > CLOSE_BOUND_SHARE * search_result.cost
    ):
        lower = max(
            lower,
            held_karp_bound.sparse_lower_bound(
                costs, near, search_result.order, limits.interrupted, LATER_CITIES, opened
            )[0],
        )
    return replace(best_tour, lower_bound=max(0, min(lower + extra, best_tour.cost)))


def _tour_of_cities(problem: TourProblem, tour: Ints, work: int, method: str) -> Tour:
    """The tour of the problem that a closed tour of cities stands for."""
    order = _unroll_tour(problem, tour)
    if tour_violations(problem, order):
        order = best_first_order(problem) or tuple(range(len(order)))
    return Tour(order, cost_of(problem, order), 0, work, method)


def _first_tour(problem: TourProblem, costs: CityCosts, method: str) -> symmetric_tours.Order:
    """The first tour of the search."""
    n = len(problem.visits)
    if isinstance(problem.travel, Metric) and method != "chain1987":
        end_cities = np.arange(n, len(costs), dtype=np.int32)
        return np.concatenate((along_hilbert(problem.travel.points), end_cities))
    matrix = _cost_matrix(costs)
    if n <= CHAINED or method == "chain1987":
        return chain_tour(matrix, _visit_positions(problem) if len(costs) == n else None)
    return nearest_first_tour(matrix)


def _cost_matrix(costs: CityCosts) -> symmetric_tours.Matrix:
    """All costs."""
    every = np.arange(len(costs))
    matrix = costs.between(every[:, None], every[None]) if costs.matrix is None else costs.matrix
    narrow = of_matrix(matrix).matrix
    assert narrow is not None
    return narrow


def _visit_costs(problem: TourProblem, ends: Longs | None = None) -> CityCosts:
    """The costs between visits, and to one more city if there are `ends`.

    A metric stays a metric.
    """
    if isinstance(problem.travel, Metric):
        kind, extra = problem.kinds
        groups = (kind, extra) if problem.changes else (kind[:0], extra[:1, :1])
        return CityCosts(
            None, problem.travel, *groups, np.zeros(0, np.int64) if ends is None else ends
        )
    if ends is None:
        return of_matrix(problem.arcs)
    n = len(problem.visits)
    cost = np.zeros((n + 1, n + 1), np.int64)
    cost[:n, :n] = problem.arcs
    cost[n], cost[:, n] = ends, ends
    return of_matrix(cost)


def _with_ends(problem: TourProblem) -> tuple[CityCosts, int]:
    """Costs with one more city, and what must be added to the cost of a tour with it."""
    n, named = (
        len(problem.visits),
        {end_visit for end_visit in (problem.start, problem.end) if end_visit is not None},
    )
    toward, extra = np.zeros(n + 1, np.int64), 0
    if named:
        dear = 4 * _dearest_arc(problem) + 1
        toward[:n] = dear
        toward[list(named)] = 0
        extra = -dear * (2 - len(named))
    if problem.closed and problem.start is not None and problem.end is not None:
        extra += problem.lengths((problem.end, problem.start))[0]
    return _visit_costs(problem, toward), extra


def _dearest_arc(problem: TourProblem) -> int:
    """No arc costs more."""
    if not isinstance(problem.travel, Metric):
        return int(problem.arcs.max(initial=0))
    points = problem.travel.points
    corners = Metric(problem.travel.kind, np.array((points.min(axis=0), points.max(axis=0))))
    across = corners.between(np.array([0], np.int32), np.array([1], np.int32))
    return int(across[0]) + 1 + int(problem.kinds[1].max(initial=0))


def _visit_positions(problem: TourProblem) -> Floats | None:
    """The positions of the visits (n, 2), if all have two coordinates and there are no changes
    of tool.
    """
    if problem.changes:
        return None
    places = [visit.position for visit in problem.visits]
    if any(place is None or len(place) != 2 for place in places):
        return None
    return np.array(places, float)


def _unroll_tour(problem: TourProblem, tour: Ints) -> tuple[int, ...]:
    """The order of the visits in a closed tour, from the right visit on and in the right
    direction.
    """
    n, order = len(problem.visits), [int(city) for city in tour]
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


def _roll_order(problem: TourProblem, order: tuple[int, ...], costs: CityCosts) -> tuple[int, ...]:
    return (*order, len(order)) if len(costs) > len(problem.visits) else order


def _lower_bound(
    costs: CityCosts,
    matrix: symmetric_tours.Matrix,
    tour: Ints,
    opened: bool,
    limits: TourLimits,
    provable: bool,
) -> tuple[int, Floats]:
    """A lower bound and its penalties (n,).

    Where clusters keep it far from the tour, it is raised for whole clusters first.
    """
    upper, steps = costs.of_tour(tour), 2000 if provable else 0
    plain_bound = symmetric_tours.tour_lower_bound(matrix, upper, steps, limits.interrupted)
    if (
        not provable
        or len(costs) < MAX_UNCLUSTERED_CITIES
        or upper - plain_bound[0] <= CLOSE_BOUND_SHARE * upper
        or limits.interrupted()
    ):
        return plain_bound
    near = symmetric_tours.tour_candidates(costs, None, limits.interrupted)
    _, penalties = held_karp_bound.sparse_lower_bound(
        costs, near, tour, limits.interrupted, opened=opened
    )
    again = symmetric_tours.tour_lower_bound(matrix, upper, steps, limits.interrupted, penalties)
    return max(plain_bound, again, key=lambda bound_pair: bound_pair[0])


def _bound_tour(
    problem: TourProblem, best_tour: Tour, costs: CityCosts, extra: int, limits: TourLimits
) -> Tour:
    """The tour with a lower bound by a matrix.

    If a proof seems possible, it is proved or replaced by a better tour.
    """
    from cellwright.engine.stages.sequencing.kernels.bounds import excess

    upper, matrix = best_tour.cost - extra, _cost_matrix(costs)
    provable = len(problem.visits) <= MAX_PROOF_VISITS or best_tour.method == "exact"
    rolled = np.array(_roll_order(problem, best_tour.order, costs), np.int32)
    lower, penalties = _lower_bound(
        costs, matrix, rolled, len(costs) > len(problem.visits), limits, provable
    )
    best_tour = replace(best_tour, lower_bound=max(0, min(lower + extra, best_tour.cost)))
    if (
        best_tour.proved
        or not provable
        or best_tour.method == "chain1987"
        or limits.interrupted()
        or not limits.proof
    ):
        return best_tour
    from cellwright.engine.stages.sequencing.exact_proofs import solve_circuit

    allowed = lower + excess(matrix, penalties) <= upper + 1
    allowed[rolled, np.roll(rolled, -1)] = True
    allowed |= allowed.T
    solved = solve_circuit(matrix.astype(np.int64), allowed, upper, tuple(rolled.tolist()), limits)
    if solved.order is None:
        return best_tour
    order = _unroll_tour(problem, np.array(solved.order, np.int32))
    order_cost = cost_of(problem, order)
    bound = max(best_tour.lower_bound, min(solved.lower_bound + extra, order_cost))
    if order_cost <= best_tour.cost and not tour_violations(problem, order):
        return replace(best_tour, order=order, cost=order_cost, lower_bound=bound)
    return replace(best_tour, lower_bound=min(bound, best_tour.cost))
