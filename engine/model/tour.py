"""Visits, what it costs to travel between them, and tours: what the sequencer is asked and what it answers."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from engine.kernels.arrays import Floats as Floats
from engine.kernels.arrays import Longs as Longs

Window = tuple[int, int]


@dataclass(frozen=True, slots=True)
class Visit:
    """Something that a tour passes once.

    `position` is for pictures and construction; `tool` is what has to be set up for it. The visit begins within
    `window` (earliest, latest; both count from the start of the tour) and lasts `duration`, in the unit of the costs.
    """

    name: str
    position: tuple[float, ...] | None = None
    tool: str = ""
    duration: int = 0
    window: Window | None = None


@dataclass(frozen=True, slots=True, eq=False)
class TourProblem:
    """Which order of the visits costs least?

    `travel` (n, n) is the cost from visit i to visit j, not negative; `changes` is what it costs besides to go on with
    another tool. With windows costs are times. An open tour ends at its last visit, a closed one goes back to its
    first. `start` and `end` are the first and the last visit, if they are given. Each pair of `precedence` is in order.
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
        """Travel and change of tool together (n, n)."""
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
    def ordered(self) -> bool:
        """Whether it matters where a tour begins beyond its cost: precedence or windows."""
        return bool(self.precedence) or self.timed


@dataclass(frozen=True, slots=True, eq=False)
class PoseProblem:
    """Which order of the visits, and which pose at each, take least time on a closed tour from the first visit?

    `poses` has for each visit its configurations (m, k), m >= 1; `speeds` (k,) are those of the joints, which move at
    the same time: going from one pose to another takes as long as the slowest joint needs.
    """

    name: str
    visits: tuple[Visit, ...]
    poses: tuple[Floats, ...]
    speeds: Floats


@dataclass(frozen=True, slots=True)
class Tour:
    """An order of all visits, its cost, and a lower bound on the cost of any; `work` says how long was searched.

    `poses` names the chosen pose of each visit in `order`, where visits have several.
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
        """How far the cost may lie above the least one, as a fraction of the lower bound; infinite without a bound."""
        if self.proved:
            return 0.0
        return (self.cost - self.lower_bound) / self.lower_bound if self.lower_bound > 0 else float("inf")


def cost_of(problem: TourProblem, order: tuple[int, ...]) -> int:
    """What an order costs: its arcs, and the way back when the tour is closed."""
    arcs = problem.arcs
    total = sum(int(arcs[a, b]) for a, b in pairwise(order))
    return total + int(arcs[order[-1], order[0]]) if problem.closed and len(order) > 1 else total


def violations(problem: TourProblem, order: tuple[int, ...]) -> list[str]:
    """What an order does against the problem; empty when it is a tour that was asked for."""
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
