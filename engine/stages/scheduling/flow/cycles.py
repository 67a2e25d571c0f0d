"""A pattern: the course of one object, begun again and again after the same time.

Many alike objects follow one another best where each does the same at the same time after its
start, and no two are in each other's way (cyclic scheduling: Levner et al. 2010). A constraint
model decides the course for a given period: what is taken is taken again after each period, before
and after. Then all objects can follow, however many there are, and nobody waits for anybody.
"""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

from ortools.sat.python import cp_model
from ortools.sat.python.cp_model import IntervalVar, LiteralT

from cellwright.engine.model.flow import Course, Flow, Route, RouteLag
from cellwright.engine.stages.scheduling.flow.board import Board
from cellwright.engine.stages.scheduling.flow.model import FlowModel, Time, _Line
from cellwright.engine.stages.scheduling.schedule_limits import ScheduleLimits
from cellwright.engine.stages.scheduling.shop_solver import run_solver

SOLVED = (cp_model.OPTIMAL, cp_model.FEASIBLE)
LONGER = 2  # times what the object needs alone: the longest course that is looked at
STRETCH = (1.06, 1.2, 1.5, 2.0)  # of the least period, tried first
NARROWER = 4  # periods that are tried between one that fits and one that does not
WORK = 0.12  # of the whole, spent on one period at most


@dataclass
class RepeatedModel(FlowModel):
    """The model of one item of a flow that is followed by others like it, each so long after the
    one before.
    """

    period: int = 1
    endless: bool = field(default=False, init=False)  # something is held for ever
    taken: dict[str, list[tuple[Time, Time, LiteralT]]] = field(
        default_factory=lambda: defaultdict(list), init=False
    )

    def _use(self, route: Route, line: _Line) -> None:
        for layer, start, literals in zip(route.layers, line.starts, line.done, strict=True):
            for act, literal in zip(layer, literals, strict=True):
                for use in act.uses:
                    if use.resource in self.flow.capacity:
                        lasts = use.end - use.begin
                        self.taken[use.resource].append((start + use.begin, lasts, literal))

    def _interval(self, place: str, begin: Time, end: Time, present: LiteralT) -> None:
        if isinstance(begin, int) or isinstance(end, int):
            self.endless = True
        size = self.cp.new_int_var(0, self.horizon + 1, "")
        self.cp.add(size == end - begin).only_enforce_if(present)
        self.taken[place].append((begin, size, present))

    def _limit(self) -> None:
        """No more is taken at any time within a period than there is."""
        for name, capacity in self.flow.capacity.items():
            spans = self.taken.get(name, [])
            whole = capacity * self.period
            for _, lasts, present in spans:
                self.cp.add(lasts <= whole).only_enforce_if(present)
            if len(spans) < 2:
                continue  # nothing but itself is in its way
            copies = [copy for span in spans for copy in self._copies(capacity, *span)]
            if capacity == 1:
                self.cp.add_no_overlap(copies)
            else:
                self.cp.add_cumulative(copies, [1] * len(copies), capacity)

    def _copies(
        self, capacity: int, begin: Time, lasts: Time, present: LiteralT
    ) -> Iterator[IntervalVar]:
        """What is taken, counted from the begin of its period, and again after each period.

        So many copies that what lasts longer than all of them does not fit.
        """
        since = self.cp.new_int_var(0, self.period - 1, "")
        until = self.cp.new_int_var(0, (capacity + 1) * self.period, "")
        periods = self.cp.new_int_var(0, self.horizon // self.period + 1, "")
        self.cp.add(since == begin - self.period * periods)
        self.cp.add(until == since + lasts).only_enforce_if(present)
        for number in range(capacity + 1):
            shift = number * self.period
            yield self.cp.new_optional_interval_var(
                since + shift, lasts, until + shift, present, ""
            )


@dataclass(frozen=True)
class Pattern:
    """A course, and the time after which the next object may begin the same."""

    course: Course
    period: int

    def courses(self, count: int) -> list[Course]:
        """The courses of so many objects."""
        return [
            Course(self.course.acts, tuple(s + n * self.period for s in self.course.starts))
            for n in range(count)
        ]

    def makespan(self, count: int) -> int:
        """When the last of so many objects ends."""
        return self.course.end + (count - 1) * self.period


def best_pattern(flow: Flow, lag: float, limits: ScheduleLimits) -> Pattern | None:
    """The pattern found with which the objects of a flow end first, all of one route; None if there
    is none. No period less than `lag` is tried.

    What is said about times after the start of the plan, or has a price, no pattern keeps.
    """
    if flow.calendars or not all(
        _is_repeated(window) for route in flow.routes for window in route.lags
    ):
        return None
    if len(flow.routes) != 1 or len({item.release for item in flow.items}) != 1:
        return None
    if (alone := Board(flow).earliest(0)) is None:
        return None
    (route,) = flow.routes
    straight = replace(flow, routes=(replace(route, layers=route.straight(())),))
    search = _Periods(straight, LONGER * alone.end, replace(limits, work=limits.work * WORK))
    return search.best(max(1, round(lag)), alone.end)


def _is_repeated(window: RouteLag) -> bool:
    """Whether a window is about two acts of one object, and is never broken."""
    return window.price is None and None not in (window.earlier.layer, window.later.layer)


@dataclass(frozen=True)
class _Periods:
    flow: Flow
    horizon: int
    limits: ScheduleLimits

    def best(self, least: int, alone: int) -> Pattern | None:
        """The best pattern found whose period is not below the least one. With the time that an
        object takes `alone` there is one.
        """
        before = least - 1
        for period in (*(round(least * stretch) for stretch in STRETCH), max(least, alone)):
            if self.limits.interrupted():
                return None
            if (pattern := self._with(period)) is not None:
                return self._narrowed(before, pattern)
            before = period
        return None

    def _narrowed(self, low: int, pattern: Pattern) -> Pattern:
        """The best of some patterns with periods between one that did not fit and one that did."""
        best, count = pattern, len(self.flow.items)
        for _ in range(NARROWER):
            middle = (low + pattern.period) // 2
            if middle in (low, pattern.period):
                break
            if (shorter := self._with(middle)) is None:
                low = middle
                continue
            pattern = shorter
            best = min(best, pattern, key=lambda each: each.makespan(count))
        return best

    def _with(self, period: int) -> Pattern | None:
        """The shortest course found that fits with a period."""
        model = RepeatedModel(self.flow, [0], {}, self.horizon, period=period)
        if model.endless:
            return None
        model.cp.minimize(model.makespan)
        solver = cp_model.CpSolver()
        if run_solver(solver, model.cp, self.limits, in_turns=False) not in SOLVED:
            return None
        return Pattern(model.courses(solver)[0], period)
