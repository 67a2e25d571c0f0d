"""Lower bounds and searches for tours whose arcs have a direction, windows or precedence.

What cannot come directly after what follows from the conditions. On the arcs that are left, a tour
costs no less than the best assignment of followers, and no less than the bound of Held and Karp.
That is raised first for the cheaper direction of each pair of cities, which takes few steps, and
from there on after the change of Jonker & Volgenant 1983: each city becomes two, joined by an edge
that every tour has.
"""

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs, Truths
from cellwright.engine.kernels.cancellation import Interrupted, never
from cellwright.engine.model.tour_problem import TourProblem, cost_of, tour_violations
from cellwright.engine.stages.sequencing import held_karp_bound, symmetric_tours
from cellwright.engine.stages.sequencing.city_costs import of_matrix
from cellwright.engine.stages.sequencing.first_tours import nearest_first_tour
from cellwright.engine.stages.sequencing.search_limits import TourLimits

LATEST_BEGINNING = 2**60
SHARPENING_ROUNDS = 3  # in which times and precedence sharpen each other
NEARLY_NONE = 1e-3  # a time of 0 would be no edge; so many of these are less than 1
MAX_PATH_VISITS = 400  # up to this number of visits times follow from shortest paths
MIN_CLUSTERED_CITIES = 20  # so few cities have no clusters
CLOSE_SHARE = 0.01  # a bound that is so near to the cost needs no clusters
QUICK_KICKS = 1  # of the search for a tour that the ascent aims at
EFFORT, STEPS = 200_000_000, 2000  # edges that the ascent looks at, and its steps


def directed_lower_bound(problem: TourProblem, upper: int, interrupted: Interrupted = never) -> int:
    """No order that keeps the conditions costs less. `upper` is the cost of one that does."""
    arcs, open_ = _with_the_other(problem)
    n, most = len(arcs), int(arcs.max(initial=0)) + 1
    dear = np.where(open_, arcs, 4 * most)
    np.fill_diagonal(dear, 8 * most)
    from scipy.optimize import linear_sum_assignment  # slow to import

    rows, columns = linear_sum_assignment(dear)
    best = int(dear[rows, columns].sum())
    if n >= 3 and not interrupted() and best < upper:
        symmetric_bound, penalties = _either_way_bound(np.minimum(dear, dear.T), upper, interrupted)
        best = max(best, symmetric_bound)
    if n >= 3 and not interrupted() and best < upper:
        begun = np.concatenate((penalties, penalties))
        symmetric_bound, _ = symmetric_tours.tour_lower_bound(
            _doubled_costs(dear, most), upper + n * most, _ascent_steps(2 * n), interrupted, begun
        )
        best = max(best, symmetric_bound - n * most)
    return max(0, min(best, upper))


def _either_way_bound(costs: Longs, upper: int, interrupted: Interrupted) -> tuple[int, Floats]:
    """The bound of Held and Karp for costs (n, n) without direction, and its penalties (n,).

    Where changes of tools make clusters, it is raised for whole clusters first.
    """
    n = len(costs)
    plain = symmetric_tours.tour_lower_bound(costs, upper, _ascent_steps(n), interrupted)
    if n < MIN_CLUSTERED_CITIES or plain[0] >= (1 - CLOSE_SHARE) * upper or interrupted():
        return plain
    cities = of_matrix(costs)
    near = symmetric_tours.tour_candidates(cities, None, interrupted)
    quick = TourLimits(work=QUICK_KICKS, interrupted=interrupted)
    tour = symmetric_tours.search_tour(cities, nearest_first_tour(costs), quick, near).order
    bound, penalties = held_karp_bound.sparse_lower_bound(cities, near, tour, interrupted)
    return max(plain, (min(bound, upper), penalties), key=lambda bound_pair: bound_pair[0])


def _ascent_steps(n: int) -> int:
    """The steps of an ascent that suit n cities."""
    return max(20, min(STEPS, EFFORT // n**2))


def search_directed(
    problem: TourProblem, order: tuple[int, ...], limits: TourLimits
) -> tuple[tuple[int, ...], int]:
    """An order of a problem without windows and precedence that costs no more than a given one, and
    the kicks made.

    It is a tour of the entries and exits of all cities, under costs that are the same in both
    directions.
    """
    arcs, open_ = _with_the_other(problem)
    n, most = len(arcs), int(arcs.max(initial=0)) + 1
    costs = of_matrix(_doubled_costs(np.where(open_, arcs, 4 * most), most))
    ring = np.array([*order, n - 1] if n > len(order) else order, np.int32)
    every = np.arange(n, dtype=np.int32)
    start = np.stack((ring + n, ring), axis=1).ravel().astype(np.int32)
    search_result = symmetric_tours.search_tour(
        costs, start, limits, mates=np.concatenate((every + n, every))
    )
    turned = np.roll(search_result.order, -int(np.flatnonzero(search_result.order == 2 * n - 1)[0]))
    if turned[1] != n - 1:
        turned[1:] = turned[:0:-1]
    directed_order = _cut_ring(problem, [int(city) for city in turned if city < n])
    if tour_violations(problem, directed_order) or cost_of(problem, directed_order) > cost_of(
        problem, order
    ):
        directed_order = order
    return directed_order, search_result.work


def _cut_ring(problem: TourProblem, ring: list[int]) -> tuple[int, ...]:
    """The order of visits in a ring; where the one more city is cut out, or at the right end."""
    if len(ring) > len(problem.visits):
        return tuple(ring[1:])
    if problem.start is not None:
        at = ring.index(problem.start)
    else:
        at = 0 if problem.end is None else ring.index(problem.end) + 1
    return (*ring[at:], *ring[:at])


def _doubled_costs(dear: Longs, most: int) -> Longs:
    """Symmetric costs (2n, 2n) between the exits (first n) and the entries of all cities; a
    tour costs n * most more.
    """
    n = len(dear)
    doubled_costs = np.full((2 * n, 2 * n), 16 * most, np.int64)
    doubled_costs[:n, n:] = dear + most
    doubled_costs[n:, :n] = dear.T + most
    every = np.arange(n)
    doubled_costs[every, n + every] = doubled_costs[n + every, every] = 0
    return doubled_costs


def _with_the_other(problem: TourProblem) -> tuple[Longs, Truths]:
    """Arcs with one more city between the last visit and the first if the tour is open; and
    which arcs a tour may have.
    """
    n, arcs = len(problem.visits), problem.arcs.astype(np.int64)
    before = _precedence_closure(problem, arcs)
    allowed = _allowed_arcs(problem, arcs, before)
    may_begin = np.asarray(~before.any(axis=0), np.bool_)
    may_end = np.asarray(~before.any(axis=1), np.bool_)
    if problem.closed:
        allowed |= may_end[:, None] & may_begin[None]
        return arcs, allowed
    wider, open_ = np.zeros((n + 1, n + 1), np.int64), np.zeros((n + 1, n + 1), bool)
    wider[:n, :n], open_[:n, :n] = arcs, allowed
    open_[n, :n], open_[:n, n] = may_begin, may_end
    return wider, open_


def _precedence_closure(problem: TourProblem, arcs: Longs) -> Truths:
    """Which visit comes before which in every order (n, n), by precedence, ends and windows."""
    n = len(problem.visits)
    before = np.zeros((n, n), bool)
    for first, second in problem.precedence:
        before[first, second] = True
    if problem.start is not None:
        before[problem.start] = True
    if problem.end is not None:
        before[:, problem.end] = True
    np.fill_diagonal(before, False)
    if problem.timed and n <= MAX_PATH_VISITS:
        early, late, least_times = _beginning_times(problem, arcs)
        for _ in range(SHARPENING_ROUNDS):
            before = _close_precedence(before)
            early = np.maximum(
                early, np.where(before, early[:, None] + least_times, 0).max(axis=0, initial=0)
            )
            late = np.minimum(
                late,
                np.where(before, late[None] - least_times, LATEST_BEGINNING).min(
                    axis=1, initial=LATEST_BEGINNING
                ),
            )
            too_late = early[:, None] + least_times > late[None]
            before |= too_late.T & ~np.eye(n, dtype=bool)
    return _close_precedence(before)


def _close_precedence(before: Truths) -> Truths:
    """What follows from before: a before b before c."""
    for _ in range(len(before).bit_length()):
        wider = before | np.asarray(before.astype(np.float32) @ before.astype(np.float32) > 0)
        if (wider == before).all():
            break
        before = wider
    return before


def _beginning_times(problem: TourProblem, arcs: Longs) -> tuple[Longs, Longs, Longs]:
    """The earliest and latest beginnings (n,), and the least time from beginning to beginning
    (n, n).
    """
    windows = [visit.window or (0, LATEST_BEGINNING) for visit in problem.visits]
    lasts = np.array([visit.duration for visit in problem.visits], np.int64)
    steps = (arcs + lasts[:, None]).astype(float)
    from scipy.sparse.csgraph import shortest_path  # slow to import

    least_times = shortest_path(np.where(steps > 0, steps, NEARLY_NONE)).astype(np.int64)
    return np.array([w[0] for w in windows]), np.array([w[1] for w in windows]), least_times


def _allowed_arcs(problem: TourProblem, arcs: Longs, before: Truths) -> Truths:
    """Whether b may come directly after a (n, n): nothing has to come between them, and b is
    not before a.
    """
    between: Truths = before.astype(np.float32) @ before.astype(np.float32) > 0
    allowed: Truths = ~(before.T | between)
    np.fill_diagonal(allowed, False)
    if problem.timed:
        early = np.array([(visit.window or (0, 0))[0] + visit.duration for visit in problem.visits])
        late = np.array([(visit.window or (0, LATEST_BEGINNING))[1] for visit in problem.visits])
        allowed &= early[:, None] + arcs <= late[None]
    return allowed
