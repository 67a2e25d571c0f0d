"""Tours in phases: all visits of one phase come before those of the next.

Where costs are the same in both directions and the ends are free, one search finds the tours of all phases and where they
meet. Else each phase is a tour from where the last one ends.
"""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np

from cellwright.engine.kernels.arrays import Longs
from cellwright.engine.model.metric import Metric
from cellwright.engine.model.outcome import GaveUp, Infeasible
from cellwright.engine.model.tour import Tour, TourProblem, cost_of, violations
from cellwright.engine.stages.sequencing.arborescent import lower_bound
from cellwright.engine.stages.sequencing.curve import along_hilbert
from cellwright.engine.stages.sequencing.limits import Limits
from cellwright.engine.stages.sequencing.symmetric import default_work

Answer = Tour | Infeasible | GaveUp
Solve = Callable[[TourProblem, Limits, str], Answer]
From = Callable[[TourProblem, Limits, tuple[int, ...]], Tour]
AT_ONCE, TOGETHER = (
    300,
    1200,
)  # visits whose phases are bounded together: always, and where time is given to bounds
QUICK = 1  # kicks of a search that is made for its bound


def refused(problem: TourProblem) -> str | None:
    """Why no order keeps the phases and the ends; None if one does."""
    phases = [visit.phase for visit in problem.visits]
    if problem.start is not None and phases[problem.start] > min(phases):
        return (
            f"{problem.visits[problem.start].name} cannot be first: visits of an earlier phase come before it"
        )
    if problem.end is not None and phases[problem.end] < max(phases):
        return f"{problem.visits[problem.end].name} cannot be last: visits of a later phase come after it"
    return None


def in_pairs(problem: TourProblem) -> TourProblem:
    """The problem with its phases as precedence: of each visit before each one of the next phase."""
    groups = _groups(problem)
    pairs = tuple((a, b) for now, then in pairwise(groups) for a in now for b in then)
    visits = tuple(replace(visit, phase=0) for visit in problem.visits)
    return replace(problem, visits=visits, precedence=(*problem.precedence, *pairs))


def by_phases(
    problem: TourProblem, limits: Limits, method: str, solve: Solve, improved: From | None = None
) -> Answer:
    """The tour of all phases: by one search from an order on, where `improved` can make one; else phase by phase."""
    found = _together(problem, limits, improved) if improved is not None else None
    return _one_by_one(problem, limits, method, solve) if found is None else found


def _together(problem: TourProblem, limits: Limits, improved: From) -> Tour | None:
    """The tour by one search in which a way to another phase costs a toll; None if the best order does not keep the phases.

    An order that pays as few tolls as possible keeps the phases, or does so the other way round. The bound without these tolls
    holds whatever the toll. A great one would disturb the search, which judges by the mean way.
    """
    groups = _groups(problem)
    phase = {visit: number for number, group in enumerate(groups) for visit in group}
    order = tuple(sorted(_along(problem), key=lambda visit: phase[visit]))
    toll = max(problem.lengths(tuple(range(len(order))))) + 1
    places = sorted({(visit.station, phase[n]) for n, visit in enumerate(problem.visits)})
    shifts = {
        (_place(*one), _place(*other)): toll * abs(one[1] - other[1])
        + problem.shifts.get((one[0], other[0]), 0)
        for one in places
        for other in places
    }
    visits = tuple(
        replace(visit, phase=0, station=_place(visit.station, phase[n]))
        for n, visit in enumerate(problem.visits)
    )
    work = limits.work or default_work(len(visits))
    found = improved(replace(problem, visits=visits, shifts=shifts), replace(limits, work=work), order)
    ways = found.order if phase[found.order[0]] == 0 else found.order[::-1]
    if violations(problem, ways):
        return None
    lower = found.lower_bound - toll * (len(groups) - 1)
    return replace(found, order=ways, cost=cost_of(problem, ways), lower_bound=max(0, lower))


def _along(problem: TourProblem) -> list[int]:
    """All visits, neighbours near each other where their places are known."""
    metric = problem.travel if isinstance(problem.travel, Metric) else None
    return list(range(len(problem.visits))) if metric is None else along_hilbert(metric.points).tolist()


def _one_by_one(problem: TourProblem, limits: Limits, method: str, solve: Solve) -> Answer:
    """The tours of all phases, one after another.

    The bound is that of each phase alone, with the shortest ways between. Of not too many visits there is another one, of all
    phases together, which knows that the ways between end where tours begin.
    """
    order: list[int] = []
    bound = work = 0
    for group in _groups(problem):
        found = solve(_part(problem, [*order[-1:], *group], bool(order)), limits, method)
        if not isinstance(found, Tour):
            return found
        work += found.work
        bound += _bound(problem, group, order, found, limits, solve)
        members = [*order[-1:], *group]
        order += [members[each] for each in found.order[len(order[-1:]) :]]
    made = tuple(order)
    cost = cost_of(problem, made)
    if len(made) <= (TOGETHER if limits.sharp else AT_ONCE) and bound < cost and not limits.interrupted():
        bound = max(bound, lower_bound(in_pairs(problem), cost, limits.interrupted))
    return Tour(made, cost, min(bound, cost), work, method)


def _place(station: str, phase: int) -> str:
    return f"{station} {phase}"


def _groups(problem: TourProblem) -> list[list[int]]:
    phases = sorted({visit.phase for visit in problem.visits})
    return [[n for n, visit in enumerate(problem.visits) if visit.phase == phase] for phase in phases]


def _part(problem: TourProblem, members: list[int], led: bool) -> TourProblem:
    """The open tour of some visits; it begins with the first of them if it is `led` there by the phase before."""
    place = {visit: number for number, visit in enumerate(members)}
    return replace(
        problem,
        visits=tuple(replace(problem.visits[each], phase=0) for each in members),
        travel=_travel(problem.travel, members),
        closed=False,
        start=0 if led else place.get(-1 if problem.start is None else problem.start),
        end=place.get(-1 if problem.end is None else problem.end),
    )


def _bound(
    problem: TourProblem, group: list[int], order: list[int], found: Tour, limits: Limits, solve: Solve
) -> int:
    """What a phase costs at least, wherever the one before ends."""
    if not order:
        return found.lower_bound
    alone = solve(_part(problem, group, False), replace(limits, work=QUICK, proof=0.0), "auto")
    return _least_way(problem, order, group) + (alone.lower_bound if isinstance(alone, Tour) else 0)


def _travel(travel: Longs | Metric, members: list[int]) -> Longs | Metric:
    return travel.part(members) if isinstance(travel, Metric) else travel[np.ix_(members, members)]


def _least_way(problem: TourProblem, order: list[int], group: list[int]) -> int:
    """No way from a visit of the order to one of the group costs less."""
    if isinstance(problem.travel, Metric):
        here = np.array(order, np.int32)
        return min(int(problem.travel.between(here, np.full(len(here), each)).min()) for each in group)
    return int(problem.arcs[np.ix_(order, group)].min())
