"""Lower bound of a tour from its two places that are farthest apart: every tour visits both.

Ways are shortest ways, over other visits if that is shorter: rounded distances do not always keep
the triangle inequality. On a line, where the ascent of Held and Karp comes to its bound very
slowly, this one is the tour itself. Many points have exact distances instead, less what rounding
takes from the edges of a tour.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.cancellation import Interrupted
from cellwright.engine.model.tour_problem import Metric, Tour, TourProblem

FEW = 3_000  # up to this number of visits shortest ways are looked for
CLOSE = 0.01  # a bound that is so near to the cost is not raised
FAR = float(1 << 60)
ROUNDING = 0.5  # a rounded distance is at most so much too small
EXACT: dict[str, Callable[[Floats], Floats]] = {  # of differences of coordinates (n, d)
    "rounded": lambda by: np.sqrt((by**2).sum(axis=1)),
    "raised": lambda by: np.sqrt((by**2).sum(axis=1)),
    "manhattan": lambda by: np.abs(by).sum(axis=1),
    "largest": lambda by: np.abs(by).max(axis=1),
    "pseudo_euclidean": lambda by: np.sqrt((by**2).sum(axis=1) / 10.0),
    "micrometres": lambda by: np.sqrt((by**2).sum(axis=1)) * 1e6,
}

Ways = Callable[[int, bool], Floats]
"""The least ways from a visit to all, or from all to it."""


def raised(problem: TourProblem, tour: Tour, interrupted: Interrupted) -> Tour:
    """The tour with the bound by two far places, if that is higher than its own."""
    if (
        tour.cost - tour.lower_bound <= CLOSE * tour.cost
        or len(problem.visits) < 2
        or interrupted()
    ):
        return tour
    least = min(farthest(problem), tour.cost)
    return replace(tour, lower_bound=max(tour.lower_bound, least))


def farthest(problem: TourProblem) -> int:
    """A lower bound on the cost of every tour of two visits or more; 0 if nothing is known."""
    count = len(problem.visits)
    if count <= FEW:
        return int(_least(problem, _shortest_ways(problem)))
    if not isinstance(problem.travel, Metric) or problem.travel.kind not in EXACT:
        return 0
    edges = count if problem.closed else count - 1
    least = _least(problem, _straight_ways(problem.travel)) * (1 - 1e-12)
    return max(0, int(np.ceil(least - ROUNDING * edges)))


def _least(problem: TourProblem, ways: Ways) -> float:
    """The least cost of a tour that passes two places which are far from each other."""
    begin = problem.start if problem.start is not None else int(np.argmax(ways(0, True)))
    far = int(np.argmax(ways(begin, True)))
    there, back = ways(far, True), ways(far, False)
    if problem.closed:
        return float((there + back).max())
    other = int(np.argmax(np.minimum(there, back)))
    return min(_by_way_of(problem, ways, far, other), _by_way_of(problem, ways, other, far))


def _by_way_of(problem: TourProblem, ways: Ways, first: int, second: int) -> float:
    """The least cost of an open tour that passes the first place before the second."""
    begin = 0.0 if problem.start is None else float(ways(problem.start, True)[first])
    end = 0.0 if problem.end is None else float(ways(second, True)[problem.end])
    return begin + float(ways(first, True)[second]) + end


def _straight_ways(metric: Metric) -> Ways:
    exact = EXACT[metric.kind]

    def ways(place: int, _away: bool) -> Floats:
        return exact(metric.points - metric.points[place])

    return ways


def _shortest_ways(problem: TourProblem) -> Ways:
    """The shortest ways over other visits (Dijkstra 1959)."""
    arcs = problem.arcs.astype(float)

    def ways(source: int, away: bool) -> Floats:
        costs = arcs if away else arcs.T
        best: Floats = costs[source].copy()
        left: Floats = np.zeros(len(costs))
        best[source] = 0.0
        for _ in range(len(best)):
            here = int(np.argmin(best + left))
            left[here] = FAR
            np.minimum(best, best[here] + costs[here], out=best)
        return best

    return ways
