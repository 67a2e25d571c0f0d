"""The constraint model of a flow: which acts its items do, and when (CP-SAT).

Items that are not free keep their courses; so the same model solves a whole flow, and any part of a
large one.
"""

import itertools
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ortools.sat.python.cp_model import (
    CpModel,
    CpSolver,
    Domain,
    IntervalVar,
    IntVar,
    LinearExpr,
    LiteralT,
)

from cellwright.engine.model.flow import (
    FOREVER,
    Act,
    Course,
    Flow,
    Route,
    RouteLag,
    RouteMoment,
    Use,
)
from cellwright.engine.stages.scheduling.flow.board import spans
from cellwright.kb.model.time_windows import TimeOfWork

Time = LinearExpr | int


@dataclass
class _Line:
    """The variables of a free item: the start of each layer, and whether each act is done."""

    starts: list[Time]
    done: list[list[LiteralT]]
    end: Time


@dataclass
class FlowModel:
    """The model of the `free` items of a flow between the courses of the others; all ends by
    `horizon`.

    Free items of one route do not begin before `soonest`.
    """

    flow: Flow
    free: Sequence[int]
    settled: Mapping[int, Course]
    horizon: int
    soonest: int = 0
    cp: CpModel = field(default_factory=CpModel)

    def __post_init__(self) -> None:
        self.prices: list[LinearExpr] = []
        self.intervals: dict[str, list[IntervalVar]] = defaultdict(list)
        self.lines = {item: self._line(item) for item in self.free}
        others = max((course.end for course in self.settled.values()), default=0)
        self.makespan = self.cp.new_int_var(min(others, self.horizon), self.horizon, "makespan")
        for line in self.lines.values():
            self.cp.add(self.makespan >= line.end)
        self._block()
        self._limit()

    def _line(self, item: int) -> _Line:
        route, own = self.flow.route(item), self.flow.items[item]
        starts, done = list[Time](), list[list[LiteralT]]()
        end: Time = max(self.soonest, own.release)
        for number, layer in enumerate(route.layers):
            literals = self._literals(len(layer))
            start = end if number and _is_plain(layer) else self._start(end)
            starts.append(start)
            done.append(literals)
            if len(layer) > 1:
                self.cp.add_exactly_one(literals)
            end = start + self._lasting(layer, literals)
        line = _Line(starts, done, end)
        self._follow(route, line)
        self._use(route, line)
        self._hold(route, line)
        for lag in route.lags:
            self._keep(lag, route, line)
        return line

    def _keep(self, lag: RouteLag, route: Route, line: _Line) -> None:
        """A window between two acts; what it is broken by has its price, or is 0."""
        lasts = self._time(lag.later, route, line) - self._time(lag.earlier, route, line)
        broken: IntVar | int = 0
        if lag.price is not None:
            broken = self.cp.new_int_var(0, 2 * self.horizon + lag.least, "")
            self.prices.append(lag.price * broken)
        self.cp.add(lasts + broken >= lag.least)
        if lag.most is not None:
            self.cp.add(lasts - broken <= lag.most)

    def _time(self, moment: RouteMoment, route: Route, line: _Line) -> Time:
        """When a moment of the act that is done is."""
        if moment.layer is None:
            return 0
        start = line.starts[moment.layer]
        offsets = [moment.offsets[act.number] for act in route.layers[moment.layer]]
        if len(set(offsets)) == 1:
            return start + offsets[0]
        return start + LinearExpr.weighted_sum(line.done[moment.layer], offsets)

    def _lasting(self, layer: Sequence[Act], literals: Sequence[LiteralT]) -> Time:
        """How long the act of a layer that is done lasts."""
        lasts = [act.duration for act in layer]
        if len(set(lasts)) == 1:
            return lasts[0]
        return LinearExpr.weighted_sum(literals, lasts)

    def _literals(self, count: int) -> list[LiteralT]:
        """Whether each of some acts is done; of one act that is certain."""
        return [1] if count == 1 else [self.cp.new_bool_var("") for _ in range(count)]

    def _start(self, soonest: Time) -> IntVar:
        start = self.cp.new_int_var(0, self.horizon, "")
        self.cp.add(start >= soonest)
        return start

    def _follow(self, route: Route, line: _Line) -> None:
        """Each act begins where the one before it has led."""
        for (one, first), (other, second) in itertools.pairwise(
            zip(route.layers, line.done, strict=True)
        ):
            if len(one) == len(other) == 1:
                continue
            for act, literal in zip(one, first, strict=True):
                following = [
                    lit for a, lit in zip(other, second, strict=True) if a.before == act.after
                ]
                self._implies(literal, following)
            for act, literal in zip(other, second, strict=True):
                before = [lit for a, lit in zip(one, first, strict=True) if a.after == act.before]
                self._implies(literal, before)

    def _implies(self, literal: LiteralT, any_of: Sequence[LiteralT]) -> None:
        if not any(isinstance(each, int) for each in any_of):
            self.cp.add_bool_or(any_of).only_enforce_if(literal)

    def _use(self, route: Route, line: _Line) -> None:
        for layer, start, literals in zip(route.layers, line.starts, line.done, strict=True):
            for act, literal in zip(layer, literals, strict=True):
                for use in act.uses:
                    if use.resource in self.flow.calendars:
                        self._open(self.flow.calendars[use.resource], use, start, literal)
                    elif use.resource in self.flow.capacity:
                        span = self.cp.new_optional_fixed_size_interval_var(
                            start + use.begin, use.end - use.begin, literal, ""
                        )
                        self.intervals[use.resource].append(span)

    def _open(self, calendar: TimeOfWork, use: Use, start: Time, literal: LiteralT) -> None:
        """An act is done when its calendar allows it."""
        allowed = calendar.allowed_starts(use.end - use.begin, self.horizon)
        self.cp.add_linear_expression_in_domain(
            start + use.begin, Domain.from_intervals(allowed)
        ).only_enforce_if(literal)

    def _hold(self, route: Route, line: _Line) -> None:
        for place in route.held:
            self._held(route, line, place, None, None)
        for number, layer in enumerate(route.layers):
            for act, literal in zip(layer, line.done[number], strict=True):
                for take in act.takes:
                    self._held(
                        route, line, take.place, (number, act, literal), (take.begin, take.came)
                    )

    def _held(
        self,
        route: Route,
        line: _Line,
        place: str,
        taking: tuple[int, Act, LiteralT] | None,
        offsets: tuple[int, int] | None,
    ) -> None:
        """What is taken by an act, or from the start, until an act that leaves it."""
        shared, most = place in self.flow.capacity, route.stays.get(place)
        if not shared and most is None:
            return
        number = -1 if taking is None else taking[0]
        literal: LiteralT = 1 if taking is None else taking[2]
        begin = 0 if taking is None or offsets is None else line.starts[number] + offsets[0]
        ways = _leaving(route, place, number, None if taking is None else taking[1])
        if not ways:
            if shared:
                self._interval(place, begin, self.horizon + 1, literal)
            return
        chosen = self._chosen(line, ways, literal)
        for ((layer, left, end), _), present in zip(ways.items(), chosen, strict=True):
            if shared:
                self._interval(place, begin, line.starts[layer] + end, present)
            if most is not None and offsets is not None:
                stay = line.starts[layer] + left - line.starts[number] - offsets[1]
                self.cp.add(stay <= most).only_enforce_if(present)

    def _chosen(self, line: _Line, ways: "Leaving", literal: LiteralT) -> list[LiteralT]:
        """For each way to leave a place, whether it is the one that is done if the place was
        taken.
        """
        if len(ways) == 1:
            return [literal]
        chosen: list[LiteralT] = []
        for (layer, _, _), acts in ways.items():
            present = self.cp.new_bool_var("")
            self.cp.add_implication(present, literal)
            self._implies(present, [line.done[layer][n] for n in acts])
            chosen.append(present)
        self.cp.add_bool_or(chosen).only_enforce_if(literal)
        return chosen

    def _interval(self, place: str, begin: Time, end: Time, present: LiteralT) -> None:
        size = self.cp.new_int_var(0, self.horizon + 1, "")
        self.intervals[place].append(
            self.cp.new_optional_interval_var(begin, size, end, present, "")
        )

    def _block(self) -> None:
        """What the other courses take."""
        free = set(self.free)
        for number in range(len(self.flow.items)):
            if number in free:
                continue
            held = self.flow.route(number).held
            course = self.settled.get(number)
            taken = spans(course, held) if course else [(place, 0, FOREVER) for place in held]
            for place, begin, end in taken:
                begin, end = max(begin, self.soonest), min(end, self.horizon + 1)
                if place in self.flow.capacity and begin < end:
                    self.intervals[place].append(
                        self.cp.new_fixed_size_interval_var(begin, end - begin, "")
                    )

    def _limit(self) -> None:
        for name, capacity in self.flow.capacity.items():
            spans_ = self.intervals.get(name, [])
            if capacity == 1:
                self.cp.add_no_overlap(spans_)
            elif len(spans_) > capacity:
                self.cp.add_cumulative(spans_, [1] * len(spans_), capacity)

    def order(self) -> None:
        """Free items that differ in names alone begin in their order."""
        groups: dict[object, list[int]] = defaultdict(list)
        for item in self.free:
            own = self.flow.items[item]
            groups[own.route, own.release, own.due, own.priority].append(item)
        for group in groups.values():
            for one, other in itertools.pairwise(group):
                self.cp.add(self.lines[one].starts[0] <= self.lines[other].starts[0])

    def minimise(self, bound: int, early: bool = False) -> None:
        """Lateness and prices first, then the makespan; if asked, then that items end early."""
        self.cp.add(self.makespan >= bound)
        late = []
        for item, line in self.lines.items():
            own = self.flow.items[item]
            if own.due is not None:
                lateness = self.cp.new_int_var(0, self.horizon, "")
                self.cp.add(lateness >= line.end - own.due)
                late.append(own.priority * lateness)
        self.wrong = sum(late) + sum(self.prices)
        weight = len(self.lines) if early else 0
        first = (self.horizon + 1) * self.wrong + self.makespan
        ends = sum(line.end for line in self.lines.values())
        self.cp.minimize(first * (weight * self.horizon + 1) + ends if early else first)

    def hint(self, courses: Mapping[int, Course]) -> None:
        """Offer courses of the free items."""
        for item, line in self.lines.items():
            for number, act in enumerate(courses[item].acts):
                start = line.starts[number]
                if isinstance(start, IntVar):
                    self.cp.add_hint(start, courses[item].starts[number])
                for n, literal in enumerate(line.done[number]):
                    if isinstance(literal, IntVar):
                        self.cp.add_hint(literal, n == act.number)
        ends = [course.end for course in (*courses.values(), *self.settled.values())]
        self.cp.add_hint(self.makespan, max(ends))

    def courses(self, solver: CpSolver) -> dict[int, Course]:
        """The courses of the free items in a solution."""
        found: dict[int, Course] = {}
        for item, line in self.lines.items():
            acts = []
            for layer, literals in zip(self.flow.route(item).layers, line.done, strict=True):
                chosen = next(
                    n
                    for n, lit in enumerate(literals)
                    if isinstance(lit, int) or solver.boolean_value(lit)
                )
                acts.append(layer[chosen])
            found[item] = Course(tuple(acts), tuple(solver.value(start) for start in line.starts))
        return found


def _is_plain(layer: Sequence[Act]) -> bool:
    """Whether acts hold nothing of their own, so that they begin as soon as they can."""
    return not any(act.uses or act.takes or act.leaves for act in layer)


Leaving = dict[tuple[int, int, int], list[int]]


def _leaving(route: Route, place: str, number: int, act: Act | None) -> Leaving:
    """The acts that may leave a place after it was taken, by layer and when they begin and end
    to leave.
    """
    nodes = {0 if act is None else act.after}
    found: Leaving = {}
    for layer in range(number + 1, len(route.layers)):
        following = set[int]()
        for n, other in enumerate(route.layers[layer]):
            if other.before not in nodes:
                continue
            leave = next((each for each in other.leaves if each.place == place), None)
            if leave is None:
                following.add(other.after)
            else:
                found.setdefault((layer, leave.left, leave.end), []).append(n)
        nodes = following
    return found
