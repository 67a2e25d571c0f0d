"""Tours of the sequencer: visits, travel costs, constraints, and tours with bounds."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Ints, Longs
from cellwright.engine.model.time_limits import MeasurementWindow

PI, RADIUS_KM = 3.141592, 6378.388  # as TSPLIB prescribes
MICROMETRES_PER_METRE = 1e6


@dataclass(frozen=True, slots=True, eq=False)
class Metric:
    """Whole-number costs between points (n, d), d is 2 or 3: one of `KINDS`, by which TSPLIB
    rounds, or `micrometres`.
    """

    kind: str
    points: Floats

    def __len__(self) -> int:
        return len(self.points)

    def between(self, a: Ints, b: Ints) -> Longs:
        """The cost from each city of `a` to the city of `b` at the same place; shapes are
        broadcast.
        """
        u, v = self.points[a], self.points[b]
        costs = METRIC_KINDS[self.kind](u, v).astype(np.int64)
        return np.where(np.asarray(a) == np.asarray(b), 0, costs)

    def part(self, members: Sequence[int]) -> "Metric":
        """The costs between some of the points."""
        return Metric(self.kind, self.points[list(members)])

    def matrix(self) -> Longs:
        """All costs (n, n)."""
        n = len(self)
        every, made = np.arange(n, dtype=np.int32), np.empty((n, n), np.int64)
        for city in range(n):
            made[city] = self.between(every[city : city + 1], every)
        return made


def _euclidean_m(u: Floats, v: Floats) -> Floats:
    """Square roots of sums in the order of the coordinates, so that kernels compute the same
    figures.
    """
    squares = (u - v) ** 2
    total = squares[..., 0] + squares[..., 1]
    for axis in range(2, squares.shape[-1]):
        total = total + squares[..., axis]
    lengths: Floats = np.sqrt(total)
    return lengths


def _rounded_euclidean(u: Floats, v: Floats) -> Floats:
    return np.floor(_euclidean_m(u, v) + 0.5)


def _raised_euclidean(u: Floats, v: Floats) -> Floats:
    return np.ceil(_euclidean_m(u, v))


def _manhattan_distance(u: Floats, v: Floats) -> Floats:
    lengths: Floats = np.floor(np.abs(u - v).sum(axis=-1) + 0.5)
    return lengths


def _maximum_distance(u: Floats, v: Floats) -> Floats:
    lengths: Floats = np.floor(np.abs(u - v) + 0.5).max(axis=-1)
    return lengths


def _pseudo_euclidean(u: Floats, v: Floats) -> Floats:
    exact = np.sqrt(((u - v) ** 2).sum(axis=-1) / 10.0)
    near = np.floor(exact + 0.5)
    lengths: Floats = near + (near < exact)
    return lengths


def _micrometre_distance(u: Floats, v: Floats) -> Floats:
    return np.rint(_euclidean_m(u, v) * MICROMETRES_PER_METRE)


def _geographical_km(u: Floats, v: Floats) -> Floats:
    """Distances on the sphere in kilometres; coordinates are DDD.MM."""
    (a, c), (b, d) = np.moveaxis(tsplib_radians(u), -1, 0), np.moveaxis(tsplib_radians(v), -1, 0)
    q1, q2, q3 = np.cos(c - d), np.cos(a - b), np.cos(a + b)
    cosine = np.clip(0.5 * ((1.0 + q1) * q2 - (1.0 - q1) * q3), -1.0, 1.0)
    lengths: Floats = np.trunc(RADIUS_KM * np.arccos(cosine) + 1.0)
    return lengths


def tsplib_radians(coordinates: Floats) -> Floats:
    """Angles of coordinates that TSPLIB writes as degrees and minutes, DDD.MM."""
    degrees = np.trunc(coordinates)
    angles: Floats = PI * (degrees + 5.0 * (coordinates - degrees) / 3.0) / 180.0
    return angles


METRIC_KINDS: dict[str, Callable[[Floats, Floats], Floats]] = {
    "rounded": _rounded_euclidean,
    "raised": _raised_euclidean,
    "manhattan": _manhattan_distance,
    "largest": _maximum_distance,
    "pseudo_euclidean": _pseudo_euclidean,
    "micrometres": _micrometre_distance,
    "geographical": _geographical_km,
}


ENDLESS_WINDOW = 2**40  # the end of a window that has none: later than any tour


@dataclass(frozen=True, slots=True)
class Visit:
    """A place that a tour visits once.

    `position` serves for pictures and for first tours. `tool` is the tool that the visit needs. The
    visit begins within `window` (earliest, latest; both count from the start of the tour) and lasts
    `duration`. Times are in the unit of the costs. All visits of a lower `phase` come first. It is
    made from `station`, if one is given.
    """

    name: str
    position: tuple[float, ...] | None = None
    tool: str = ""
    duration: int = 0
    window: MeasurementWindow | None = None
    phase: int = 0
    station: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class TourProblem:
    """Which order of the visits costs least?

    `travel` (n, n) is the cost from visit i to visit j, not negative; for many visits it may be a
    metric. `changes` is the additional cost of going on with another tool, `shifts` that of going
    on from another station. With windows, costs are times. An open tour ends at its last visit; a
    closed one goes back to its first. `start` and `end` are the first and the last visit, if given.
    The visits of each pair in `precedence` come in that order.
    """

    name: str
    visits: tuple[Visit, ...]
    travel: Longs | Metric
    closed: bool = True
    start: int | None = None
    end: int | None = None
    changes: Mapping[tuple[str, str], int] = field(default_factory=dict)
    precedence: tuple[tuple[int, int], ...] = ()
    unit: str = ""
    shifts: Mapping[tuple[str, str], int] = field(default_factory=dict)

    @property
    def arcs(self) -> Longs:
        """The cost from visit to visit (n, n): travel and change of tool together."""
        travel = self.travel.matrix() if isinstance(self.travel, Metric) else self.travel
        if not (self.changes or self.shifts) or not self.visits:
            return travel
        kind, extra = self.kinds
        costs: Longs = travel + extra[kind[:, None], kind[None, :]]
        return costs

    @property
    def kinds(self) -> tuple[Ints, Longs]:
        """The number of each visit's tool and station (n,), and the cost of a change from one
        such pair to another.
        """
        pairs = [(visit.tool, visit.station) for visit in self.visits]
        names = {name: number for number, name in enumerate(sorted(set(pairs)))}
        extra = np.array([[self._change(a, b) for b in names] for a in names], np.int64)
        return np.array([names[pair] for pair in pairs], np.int32), extra

    def _change(self, one: tuple[str, str], other: tuple[str, str]) -> int:
        return self.changes.get((one[0], other[0]), 0) + self.shifts.get((one[1], other[1]), 0)

    def lengths(self, order: tuple[int, ...]) -> list[int]:
        """The costs from each visit of an order to the next, travel and change of tool together."""
        a, b = np.array(order[:-1], np.int32), np.array(order[1:], np.int32)
        lengths = (
            self.travel.between(a, b) if isinstance(self.travel, Metric) else self.travel[a, b]
        )
        if (self.changes or self.shifts) and len(order):
            kind, extra = self.kinds
            lengths = lengths + extra[kind[a], kind[b]]
        return [int(length) for length in lengths]

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
    """Which order of the visits, and which pose at each, make the fastest closed tour from the
    first visit?

    `poses` holds the configurations (m, k) of each visit, m >= 1. `speeds` (k,) are the speeds of
    the joints. Joints move at the same time: a move takes as long as the slowest joint needs.
    """

    name: str
    visits: tuple[Visit, ...]
    poses: tuple[Floats, ...]
    speeds: Floats


@dataclass(frozen=True, slots=True)
class Tour:
    """An order of all visits, its cost, and a lower bound on the cost of every tour.

    `work` says how long the search was. If visits have several poses, `poses` holds the chosen pose
    of each visit in `order`.
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
        """The difference of cost and lower bound, as a fraction of the bound; infinite without
        a bound.
        """
        if self.proved:
            return 0.0
        return (
            (self.cost - self.lower_bound) / self.lower_bound
            if self.lower_bound > 0
            else float("inf")
        )


def cost_of(problem: TourProblem, order: tuple[int, ...]) -> int:
    """The cost of an order: its arcs, and the way back if the tour is closed."""
    circle = (*order, order[0]) if problem.closed and len(order) > 1 else order
    return sum(problem.lengths(circle))


def times_of(problem: TourProblem, order: tuple[int, ...]) -> list[tuple[int, int]]:
    """When each visit of an order is reached, and when it begins: it waits until its window
    opens.
    """
    clock, times = 0, list[tuple[int, int]]()
    ways = problem.lengths(order)
    for index, at in enumerate(order):
        if index:
            clock += problem.visits[order[index - 1]].duration + ways[index - 1]
        window = problem.visits[at].window
        begin = clock if window is None else max(clock, window[0])
        times.append((clock, begin))
        clock = begin
    return times


def slack_of(problem: TourProblem, order: tuple[int, ...]) -> list[int]:
    """How much later each visit of an order may begin so that no window is missed; ENDLESS or
    so if none can be.
    """
    slack, slacks = ENDLESS_WINDOW, list[int]()
    for at, (arrives, begins) in zip(
        reversed(order), reversed(times_of(problem, order)), strict=True
    ):
        window = problem.visits[at].window
        slack = min(slack, ENDLESS_WINDOW if window is None else window[1] - begins)
        slacks.append(slack)
        slack += begins - arrives
    return slacks[::-1]


def tour_violations(problem: TourProblem, order: tuple[int, ...]) -> list[str]:
    """How an order violates the problem; empty if it is a valid tour."""
    names = [visit.name for visit in problem.visits]
    problems = []
    if sorted(order) != list(range(len(names))):
        return ["not every visit is passed exactly once"]
    if problem.start is not None and order[0] != problem.start:
        problems.append(f"does not begin at {names[problem.start]}")
    if problem.end is not None and order[-1] != problem.end:
        problems.append(f"does not end at {names[problem.end]}")
    place = {visit: index for index, visit in enumerate(order)}
    problems += [
        f"{names[second]} comes before {names[first]}"
        for first, second in problem.precedence
        if place[first] >= place[second]
    ]
    problems += [
        f"{names[second]} comes before {names[first]}"
        for second, first in pairwise(order)
        if problem.visits[first].phase < problem.visits[second].phase
    ]
    return problems + _late_visits(problem, order)


def _late_visits(problem: TourProblem, order: tuple[int, ...]) -> list[str]:
    if not problem.timed:
        return []
    problems = []
    for at, (_, begin) in zip(order, times_of(problem, order), strict=True):
        visit = problem.visits[at]
        if visit.window is not None and begin > visit.window[1]:
            problems.append(f"{visit.name} is reached at {begin}, later than {visit.window[1]}")
    return problems


@dataclass(frozen=True, slots=True, eq=False)
class SharedProblem:
    """Which arm makes which visits, so that all are done soonest?

    Each arm has a tour problem with all visits that it can make, which last their `duration` in it.
    A visit of several arms has the same name in each. Every arm makes an open tour of its share,
    and all begin at once.
    """

    tours: Mapping[str, TourProblem]


@dataclass(frozen=True, slots=True)
class Shares:
    """The visits of each arm in their order, by names; how long each arm is busy with them; and
    what no way to share them is below.
    """

    orders: Mapping[str, tuple[str, ...]]
    busy: Mapping[str, int]
    lower_bound: int
    common: int = 0

    @property
    def makespan(self) -> int:
        """When the last arm is done."""
        return max(self.busy.values(), default=0)


def busy_with(problem: TourProblem, order: tuple[int, ...]) -> int:
    """How long an open tour of some of the visits of a problem takes: its arcs, and how long
    visits last.
    """
    return sum(problem.lengths(order)) + sum(
        problem.visits[visit_number].duration for visit_number in order
    )
