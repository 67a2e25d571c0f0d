"""Lower bound of a tour from its places that are far apart: every tour visits them in some order.

Ways are shortest ways, over other visits if that is shorter: rounded distances do not always keep
the triangle inequality. Where points lie on a few lines, the ascent of Held and Karp comes to its
bound very slowly, and this one is the tour itself: the far places are the ends and corners, those
of each tool and phase too. Many points have exact distances instead, less what rounding takes from
the edges of a tour.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.cancellation import Interrupted
from cellwright.engine.model.tour_problem import Metric, Tour, TourProblem
from cellwright.engine.stages.sequencing.subset_orders import comes_before, least_order

FEW = 3_000  # up to this number of visits shortest ways are looked for
CLOSE = 0.01  # a bound that is so near to the cost is not raised
FAR = float(1 << 60)
MAX_FAR_PLACES = 12  # of more, the least order takes long
LITTLE_GAIN = 1e-4  # of the bound: what so little is added to is not worth another place
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
    least = _least(problem, _straight_ways(problem, problem.travel)) * (1 - 1e-12)
    return max(0, int(np.ceil(least - ROUNDING * edges)))


def _least(problem: TourProblem, ways: Ways) -> float:
    """The least cost of a tour that passes some places which are far from each other."""
    marks = _FarPlaces(problem, ways)
    for end in (problem.start, problem.end):
        if end is not None:
            marks.add(end)
    for pair in _farthest_pairs(problem, ways):
        for place in pair[: MAX_FAR_PLACES - len(marks.places)]:
            marks.add(place)
    least = 0.0
    while len(marks.places) < min(MAX_FAR_PLACES, len(problem.visits)):
        order = marks.least_order()
        if order is None:
            return least
        least = max(least, order[0])
        gains = marks.gains(order[1])
        place = int(np.argmax(gains))
        if gains[place] <= LITTLE_GAIN * least:
            return least
        marks.add(place)
    order = marks.least_order()
    return least if order is None else max(least, order[0])


def _farthest_pairs(problem: TourProblem, ways: Ways) -> list[list[int]]:
    """Two visits of each phase and tool that are far from each other, the farthest pair first.

    A place of another phase may add nothing before its counterpart at the other end is there, too.
    """
    kinds = [
        (visit.phase, int(kind))
        for visit, kind in zip(problem.visits, problem.kinds[0], strict=True)
    ]
    pairs = list[tuple[float, list[int]]]()
    for kind in sorted(set(kinds))[: 2 * MAX_FAR_PLACES]:
        members = np.flatnonzero([other == kind for other in kinds])
        one = int(members[np.argmax(ways(int(members[0]), True)[members])])
        away = ways(one, True)[members] + ways(one, False)[members]
        pairs.append((-float(away.max()), [one, int(members[np.argmax(away)])]))
    return [pair for _, pair in sorted(pairs)]


class _FarPlaces:
    """Some visits, with the ways from them to all visits and back."""

    def __init__(self, problem: TourProblem, ways: Ways) -> None:
        self.problem, self.ways = problem, ways
        self.phase = np.array([visit.phase for visit in problem.visits], np.int64)
        self.places = list[int]()
        self.away, self.back = list[Floats](), list[Floats]()

    def add(self, place: int) -> None:
        """Take a visit as another far place."""
        if place not in self.places:
            self.places.append(place)
            self.away.append(self.ways(place, True))
            self.back.append(self.ways(place, False))

    def least_order(self) -> tuple[float, tuple[int, ...]] | None:
        """The least order of the places, numbered as they were taken, and its cost."""
        costs = np.array([row[self.places] for row in self.away])
        problem, before = self.problem, comes_before(self.problem, self.places)
        first, last = (
            None if end is None else self.places.index(end) for end in (problem.start, problem.end)
        )
        return least_order(costs, before, first, last, problem.closed)

    def gains(self, order: tuple[int, ...]) -> Floats:
        """How much longer the order becomes by each visit (n,), where its phase lets it in."""
        problem, phase = self.problem, self.phase
        phases = phase[[self.places[place] for place in order]]
        least: Floats = np.full(len(phase), np.inf)
        pairs = zip(order[:-1], order[1:], phases[:-1], phases[1:], strict=True)
        for one, other, low, high in pairs:
            way = self.away[one] + self.back[other] - self.away[one][self.places[other]]
            least = np.minimum(least, np.where((low <= phase) & (phase <= high), way, np.inf))
        begin, end = self.back[order[0]], self.away[order[-1]]
        if problem.closed:
            way = end + begin - end[self.places[order[0]]]
            least = np.minimum(
                least, np.where((phase <= phases[0]) | (phases[-1] <= phase), way, np.inf)
            )
        else:
            if problem.start is None:
                least = np.minimum(least, np.where(phase <= phases[0], begin, np.inf))
            if problem.end is None:
                least = np.minimum(least, np.where(phases[-1] <= phase, end, np.inf))
        least[self.places] = 0.0
        return np.where(np.isfinite(least), least, 0.0)


def _straight_ways(problem: TourProblem, metric: Metric) -> Ways:
    """Straight ways, with the least changes of tools and stations from one visit to another."""
    exact, (kind, extra) = EXACT[metric.kind], problem.kinds
    changes: Floats = extra.astype(float)
    for through in range(len(changes)):  # Floyd 1962
        np.minimum(changes, changes[:, through, None] + changes[None, through], out=changes)
    np.fill_diagonal(changes, 0.0)

    def ways(place: int, away: bool) -> Floats:
        own = kind[place]
        more = changes[own, kind] if away else changes[kind, own]
        lengths: Floats = exact(metric.points - metric.points[place]) + more
        return lengths

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
