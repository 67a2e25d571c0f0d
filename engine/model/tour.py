"""Visits, travel costs between them, and tours: the questions and the answers of the sequencer."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from engine.kernels.arrays import Floats as Floats
from engine.kernels.arrays import Longs as Longs

Window = tuple[int, int]


@dataclass(frozen=True, slots=True)
class Visit:
    """A place that a tour visits once.

    `position` serves for pictures and for first tours. `tool` is the tool that the visit needs. The visit
    begins within `window` (earliest, latest; both count from the start of the tour) and lasts `duration`.
    Times are in the unit of the costs. All visits of a lower `phase` come first.
    """

    name: str
    position: tuple[float, ...] | None = None
    tool: str = ""
    duration: int = 0
    window: Window | None = None
    phase: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class TourProblem:
    """Which order of the visits costs least?

    `travel` (n, n) is the cost from visit i to visit j, not negative. `changes` is the additional cost of
    going on with another tool. With windows, costs are times. An open tour ends at its last visit; a closed
    one goes back to its first. `start` and `end` are the first and the last visit, if given. The visits of
    each pair in `precedence` come in that order.
    """

    name: str
    visits: tuple[Visit, ...]
    travel: Longs
    closed: bool = True
    start: int | None = None
    end: int | None = None
    changes: Mapping[tuple[str, str], int] = field(default_factory=dict)
    precedence: tuple[tuple[int, int], ...] = ()
    unit: str = ""

    @property
    def arcs(self) -> Longs:
        """The cost from visit to visit (n, n): travel and change of tool together."""
        if not self.changes or not self.visits:
            return self.travel
        tools = [visit.tool for visit in self.visits]
        names = sorted(set(tools))
        extra = np.array([[self.changes.get((a, b), 0) for b in names] for a in names], np.int64)
        kind = np.array([names.index(tool) for tool in tools], np.intp)
        found: Longs = self.travel + extra[kind[:, None], kind[None, :]]
        return found

    @property
    def timed(self) -> bool:
        """Whether any visit has a window."""
        return any(visit.window is not None for visit in self.visits)

    @property
    def phased(self) -> bool:
        """Whether some visits come before others because of their phases."""
        return len({visit.phase for visit in self.visits}) > 1

    @property
    def ordered(self) -> bool:
        """Whether some orders are forbidden, by precedence, phases or windows.

        Then it also matters where a tour begins.
        """
        return bool(self.precedence) or self.timed or self.phased


@dataclass(frozen=True, slots=True, eq=False)
class PoseProblem:
    """Which order of the visits, and which pose at each, make the fastest closed tour from the first visit?

    `poses` holds the configurations (m, k) of each visit, m >= 1. `speeds` (k,) are the speeds of the joints.
    Joints move at the same time: a move takes as long as the slowest joint needs.
    """

    name: str
    visits: tuple[Visit, ...]
    poses: tuple[Floats, ...]
    speeds: Floats


@dataclass(frozen=True, slots=True)
class Tour:
    """An order of all visits, its cost, and a lower bound on the cost of every tour.

    `work` says how long the search was. If visits have several poses, `poses` holds the chosen pose of each
    visit in `order`.
    """

    order: tuple[int, ...]
    cost: int
    lower_bound: int
    work: int = 0
    method: str = ""
    poses: tuple[int, ...] = ()

    @property
    def proved(self) -> bool:
        """Whether no tour costs less."""
        return self.cost <= self.lower_bound

    @property
    def gap(self) -> float:
        """The difference of cost and lower bound, as a fraction of the bound; infinite without a bound."""
        if self.proved:
            return 0.0
        return (self.cost - self.lower_bound) / self.lower_bound if self.lower_bound > 0 else float("inf")


def cost_of(problem: TourProblem, order: tuple[int, ...]) -> int:
    """The cost of an order: its arcs, and the way back if the tour is closed."""
    arcs = problem.arcs
    total = sum(int(arcs[a, b]) for a, b in pairwise(order))
    return total + int(arcs[order[-1], order[0]]) if problem.closed and len(order) > 1 else total


def violations(problem: TourProblem, order: tuple[int, ...]) -> list[str]:
    """How an order violates the problem; empty if it is a valid tour."""
    names = [visit.name for visit in problem.visits]
    found = []
    if sorted(order) != list(range(len(names))):
        return ["not every visit is passed exactly once"]
    if problem.start is not None and order[0] != problem.start:
        found.append(f"does not begin at {names[problem.start]}")
    if problem.end is not None and order[-1] != problem.end:
        found.append(f"does not end at {names[problem.end]}")
    place = {visit: index for index, visit in enumerate(order)}
    found += [
        f"{names[second]} comes before {names[first]}"
        for first, second in problem.precedence
        if place[first] >= place[second]
    ]
    found += [
        f"{names[second]} comes before {names[first]}"
        for second, first in pairwise(order)
        if problem.visits[first].phase < problem.visits[second].phase
    ]
    return found + _late(problem, order)


def _late(problem: TourProblem, order: tuple[int, ...]) -> list[str]:
    arcs, clock, found = problem.arcs, 0, []
    for index, at in enumerate(order):
        visit = problem.visits[at]
        if index:
            before = order[index - 1]
            clock += problem.visits[before].duration + int(arcs[before, at])
        if visit.window is not None:
            clock = max(clock, visit.window[0])
            if clock > visit.window[1]:
                found.append(f"{visit.name} is reached at {clock}, later than {visit.window[1]}")
    return found
