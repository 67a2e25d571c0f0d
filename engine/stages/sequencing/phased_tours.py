"""Tours in phases: all visits of one phase come before those of the next.

Where costs are the same in both directions and the ends are free, one search finds the tours of all
phases and where they meet. Else each phase is a tour from where the last one ends.
"""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np

from cellwright.engine.kernels.arrays import Longs
from cellwright.engine.model.outcome import GaveUp, Infeasible
from cellwright.engine.model.tour_problem import Metric, Tour, TourProblem, cost_of, tour_violations
from cellwright.engine.stages.sequencing.directed_bounds import directed_lower_bound
from cellwright.engine.stages.sequencing.first_tours import along_hilbert
from cellwright.engine.stages.sequencing.search_limits import TourLimits
from cellwright.engine.stages.sequencing.symmetric_tours import default_work

Answer = Tour | Infeasible | GaveUp
Solve = Callable[[TourProblem, TourLimits, str], Answer]
From = Callable[[TourProblem, TourLimits, tuple[int, ...]], Tour]
AT_ONCE, TOGETHER = (
    300,
    1200,
)  # visits whose phases are bounded together: always, and where time is given to bounds
TOLLS = (1, 4)  # long ways: the toll of a way to another phase, and what is tried next
BOUND_KICKS = 1  # kicks of a search that is made for its bound


def phase_contradiction(problem: TourProblem) -> str | None:
    """Why no order keeps the phases and the ends; None if one does."""
    phases = [visit.phase for visit in problem.visits]
    if problem.start is not None and phases[problem.start] > min(phases):
        return (
            f"{problem.visits[problem.start].name} cannot be first: visits of an earlier phase "
            "come before it"
        )
    if problem.end is not None and phases[problem.end] < max(phases):
        return (
            f"{problem.visits[problem.end].name} cannot be last: visits of a later phase come "
            "after it"
        )
    return None


def in_pairs(problem: TourProblem) -> TourProblem:
    """The problem with its phases as precedence: of each visit before each one of the next
    phase.
    """
    groups = _phase_groups(problem)
    pairs = tuple((a, b) for now, then in pairwise(groups) for a in now for b in then)
    visits = tuple(replace(visit, phase=0) for visit in problem.visits)
    return replace(problem, visits=visits, precedence=(*problem.precedence, *pairs))


def by_phases(
    problem: TourProblem,
    limits: TourLimits,
    method: str,
    solve: Solve,
    improved: From | None = None,
) -> Answer:
    """The tour of all phases: by one search from an order on, where `improved` can make one;
    else phase by phase.
    """
    if improved is None:
        return _one_by_one(problem, limits, method, solve)
    opened, way_back = _cut_at_ends(problem)
    toll_tour, bound = Tour((), 0, 0), 0
    for toll in TOLLS:
        toll_tour = _toll_tour(opened, limits, improved, toll)
        bound = max(bound, toll_tour.lower_bound + way_back)
        if toll_tour.order or limits.interrupted():
            break
    if toll_tour.order:
        order = tuple(visit for visit in toll_tour.order if visit < len(problem.visits))
        cost = cost_of(problem, order)
        return replace(toll_tour, order=order, cost=cost, lower_bound=min(bound, cost))
    tour = _one_by_one(problem, limits, method, solve)
    if not isinstance(tour, Tour):
        return tour
    return replace(tour, lower_bound=min(tour.cost, max(tour.lower_bound, bound)))


def _cut_at_ends(problem: TourProblem) -> tuple[TourProblem, int]:
    """A closed tour with a given first or last visit as an open one, and the cost of the way back
    that it lacks.

    If one of the two is given, a copy of it, in a phase of its own, is the other end.
    """
    if not problem.closed or (problem.start is None and problem.end is None):
        return problem, 0
    if problem.start is not None and problem.end is not None:
        back = problem.lengths((problem.end, problem.start))[0]
        return replace(problem, closed=False), back
    count, phases = len(problem.visits), [visit.phase for visit in problem.visits]
    members, forward = [*range(count)], problem.start is not None
    given = problem.start if forward else problem.end
    assert given is not None
    phase = max(phases) + 1 if forward else min(phases) - 1
    copy = replace(problem.visits[given], phase=phase)
    travel = _phase_travel(problem.travel, [*members, given])
    opened = replace(problem, visits=(*problem.visits, copy), travel=travel, closed=False)
    if forward:
        return replace(opened, end=count), 0
    return replace(opened, start=count), 0


def _toll_tour(problem: TourProblem, limits: TourLimits, improved: From, tolls: int) -> Tour:
    """The tour by one search in which a way to another phase costs a toll; without an order if the
    best one does not keep the phases.

    An order that pays as few tolls as possible keeps the phases, or does so the other way round. A
    closed tour pays one for the way back, too, from the last phase to the first. The bound without
    these tolls holds whatever the toll. A great one would disturb the search, which judges by the
    mean way. It is so many times a long way.
    """
    groups = _phase_groups(problem)
    phase = {visit: number for number, group in enumerate(groups) for visit in group}
    order = tuple(sorted(_neighbour_order(problem), key=lambda visit: phase[visit]))
    toll, count = tolls * (max(problem.lengths(tuple(range(len(order))))) + 1), len(groups)
    places = sorted({(visit.station, phase[n]) for n, visit in enumerate(problem.visits)})
    shifts = {
        (_phase_place(*first_place), _phase_place(*second_place)): toll
        * _phase_steps(first_place[1], second_place[1], count if problem.closed else 0)
        + problem.shifts.get((first_place[0], second_place[0]), 0)
        for first_place in places
        for second_place in places
    }
    visits = tuple(
        replace(visit, phase=0, station=_phase_place(visit.station, phase[n]))
        for n, visit in enumerate(problem.visits)
    )
    work = limits.work or default_work(len(visits))
    improved_tour = improved(
        replace(problem, visits=visits, shifts=shifts),
        replace(limits, work=work),
        _with_given_ends(problem, order),
    )
    lower = max(0, improved_tour.lower_bound - toll * (count if problem.closed else count - 1))
    for ways in (improved_tour.order, improved_tour.order[::-1]):
        turned = _from_first_phase(ways, phase, count) if problem.closed else ways
        if not tour_violations(problem, turned):
            cost = cost_of(problem, turned)
            return replace(improved_tour, order=turned, cost=cost, lower_bound=min(lower, cost))
    return Tour((), 0, lower)


def _phase_steps(one: int, other: int, around: int) -> int:
    """How many phases one is from another one; in a circle of so many of them, if they are."""
    apart = abs(one - other)
    return min(apart, around - apart) if around else apart


def _with_given_ends(problem: TourProblem, order: tuple[int, ...]) -> tuple[int, ...]:
    """The order with the first and the last visit at its ends, if they are given."""
    ends = {problem.start, problem.end}
    inner = tuple(visit for visit in order if visit not in ends)
    first, last = (() if end is None else (end,) for end in (problem.start, problem.end))
    return (*first, *inner, *last)


def _from_first_phase(order: tuple[int, ...], phase: dict[int, int], count: int) -> tuple[int, ...]:
    """A closed tour from where its last phase ends and its first one begins."""
    for place, visit in enumerate(order):
        if phase[order[place - 1]] == count - 1 and phase[visit] == 0:
            return order[place:] + order[:place]
    return order


def _neighbour_order(problem: TourProblem) -> list[int]:
    """All visits, neighbours near each other where their places are known."""
    metric = problem.travel if isinstance(problem.travel, Metric) else None
    return (
        list(range(len(problem.visits)))
        if metric is None
        else along_hilbert(metric.points).tolist()
    )


def _one_by_one(problem: TourProblem, limits: TourLimits, method: str, solve: Solve) -> Answer:
    """The tours of all phases, one after another.

    The bound is that of each phase alone, with the shortest ways between. Of not too many visits
    there is another one, of all phases together, which knows that the ways between end where tours
    begin.
    """
    order: list[int] = []
    bound = work = 0
    for group in _phase_groups(problem):
        phase_tour = solve(
            _phase_problem(problem, [*order[-1:], *group], bool(order)), limits, method
        )
        if not isinstance(phase_tour, Tour):
            return phase_tour
        work += phase_tour.work
        bound += _phase_bound(problem, group, order, phase_tour, limits, solve)
        members = [*order[-1:], *group]
        order += [members[member_index] for member_index in phase_tour.order[len(order[-1:]) :]]
    visit_order = tuple(order)
    cost = cost_of(problem, visit_order)
    if (
        len(visit_order) <= (TOGETHER if limits.sharp else AT_ONCE)
        and bound < cost
        and not limits.interrupted()
    ):
        bound = max(bound, directed_lower_bound(in_pairs(problem), cost, limits.interrupted))
    return Tour(visit_order, cost, min(bound, cost), work, method)


def _phase_place(station: str, phase: int) -> str:
    return f"{station} {phase}"


def _phase_groups(problem: TourProblem) -> list[list[int]]:
    phases = sorted({visit.phase for visit in problem.visits})
    return [
        [n for n, visit in enumerate(problem.visits) if visit.phase == phase] for phase in phases
    ]


def _phase_problem(problem: TourProblem, members: list[int], led: bool) -> TourProblem:
    """The open tour of some visits; it begins with the first of them if it is `led` there by
    the phase before.
    """
    place = {visit: number for number, visit in enumerate(members)}
    return replace(
        problem,
        visits=tuple(replace(problem.visits[member], phase=0) for member in members),
        travel=_phase_travel(problem.travel, members),
        closed=False,
        start=0 if led else place.get(-1 if problem.start is None else problem.start),
        end=place.get(-1 if problem.end is None else problem.end),
    )


def _phase_bound(
    problem: TourProblem,
    group: list[int],
    order: list[int],
    phase_tour: Tour,
    limits: TourLimits,
    solve: Solve,
) -> int:
    """What a phase costs at least, wherever the one before ends."""
    if not order:
        return phase_tour.lower_bound
    alone = solve(
        _phase_problem(problem, group, False), replace(limits, work=BOUND_KICKS, proof=0.0), "auto"
    )
    return _least_way(problem, order, group) + (alone.lower_bound if isinstance(alone, Tour) else 0)


def _phase_travel(travel: Longs | Metric, members: list[int]) -> Longs | Metric:
    return travel.part(members) if isinstance(travel, Metric) else travel[np.ix_(members, members)]


def _least_way(problem: TourProblem, order: list[int], group: list[int]) -> int:
    """No way from a visit of the order to one of the group costs less."""
    if isinstance(problem.travel, Metric):
        order_array = np.array(order, np.int32)
        return min(
            int(problem.travel.between(order_array, np.full(len(order_array), visit)).min())
            for visit in group
        )
    return int(problem.arcs[np.ix_(order, group)].min())
