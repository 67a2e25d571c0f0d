"""Shares the measurements of an inspection among several arms so that all are done soonest."""

import contextlib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from cellwright.engine.model.outcome import GaveUp, Infeasible
from cellwright.engine.model.tour_problem import (
    SharedProblem,
    Shares,
    Tour,
    TourProblem,
    Visit,
    busy_with,
    cost_of,
)
from cellwright.engine.pipelines.inspection.arm_capabilities import (
    Able,
    ArmOffers,
    arm_offers,
    by_arm,
)
from cellwright.engine.pipelines.inspection.tool_tours import ToolPartition, tour_problem
from cellwright.engine.pipelines.inspection.tour_demands import (
    TourDemands,
    of_facts,
    without_windows,
)
from cellwright.engine.pipelines.inspection.travel_costs import (
    STRAIGHT_UNIT,
    straight_tour,
    time_between,
)
from cellwright.engine.pipelines.planning.decomposition.part_chain import (
    INFINITE_COST,
    PartChain,
    PlanningPart,
)
from cellwright.engine.stages.sequencing import TourLimits, sequence_tour
from cellwright.engine.stages.sequencing.arm_shares import part_problem, share_visits
from cellwright.kb.asp.static_facts import evaluate_statics
from cellwright.kb.diagnostics import Source
from cellwright.kb.loader.problem_amounts import amounts_of
from cellwright.kb.model.domain_model import Point
from cellwright.kb.model.operator_amounts import NoAmount
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Function, Term

Pair = tuple[str, str]  # of measurements: the first comes before the second


def of_share(problem: TourProblem, names: Sequence[str]) -> TourProblem:
    """The tour problem of some measurements, in this order."""
    place = {visit.name: n for n, visit in enumerate(problem.visits)}
    return part_problem(problem, [place[name] for name in names])


def merge_visits(
    problems: Mapping[str, TourProblem], shares_found: Shares, waits: Sequence[Pair]
) -> tuple[str, ...] | None:
    """All visits by when they can begin; None if they wait in a circle."""
    behind = dict[str, list[str]]()
    for first, second in waits:
        behind.setdefault(second, []).append(first)
    ended, order = dict[str, int](), list[str]()
    arms_left = {
        arm: _ArmRest(of_share(problems[arm], own))
        for arm, own in shares_found.orders.items()
        if own
    }
    while arms_left:
        ready = [
            (
                max([own.clock, *(ended[first_visit] for first_visit in behind.get(own.next, ()))]),
                arm,
            )
            for arm, own in arms_left.items()
            if all(first_visit in ended for first_visit in behind.get(own.next, ()))
        ]
        if not ready:
            return None
        begins, arm = min(ready)
        own = arms_left[arm]
        name = own.next
        order.append(name)
        ended[name] = own.went_on(begins)
        if own.at == len(own.problem.visits):
            del arms_left[arm]
    return tuple(order)


@dataclass
class _ArmRest:
    """What an arm has not begun yet: it is at visit `at` of its share at `clock`."""

    problem: TourProblem
    at: int = 0
    clock: int = 0

    @property
    def next(self) -> str:
        return self.problem.visits[self.at].name

    def went_on(self, begins: int) -> int:
        """Make the next visit, and go to the one behind it; when it has ended."""
        ended, n = begins + self.problem.visits[self.at].duration, self.at
        self.at += 1
        travel = self.problem.lengths((n, n + 1))[0] if self.at < len(self.problem.visits) else 0
        self.clock = ended + travel
        return ended


def waits_of(
    pairs: Sequence[Pair],
    problems: Mapping[str, TourProblem],
    shares_found: Shares,
    arms: Mapping[str, str],
) -> Iterator[Pair]:
    """Pairs of visits of different arms: those of `before`, and from one step of the alignment
    to the next.
    """
    for first, second in pairs:
        if first in arms and second in arms and arms[first] != arms[second]:
            yield first, second
    phases = {v.name: v.phase for p in problems.values() for v in p.visits}
    aligning = sorted({phases[name] for name in arms if phases[name] < 0})
    for phase in aligning:
        for arm, own in shares_found.orders.items():
            last = [name for name in own if phases[name] <= phase][-1:]
            for other_arm, theirs in shares_found.orders.items():
                after = [name for name in theirs if phases[name] > phase][:1]
                if last and after and arm != other_arm:
                    yield last[0], after[0]


def levels_of(pairs: Sequence[Pair]) -> dict[str, int]:
    """How many measurements must come before each at least, one after the other."""
    level = dict[str, int]()
    for _ in range(len(pairs) + 1):
        for first, second in pairs:
            level[second] = max(level.get(second, 0), level.get(first, 0) + 1)
    return level


def levelled_tour(problem: TourProblem, levels: Mapping[str, int]) -> TourProblem:
    """The tour of an arm in the order of levels, so that arms never wait in a circle: who waits
    is always on a higher one.
    """
    depth = max(levels.values(), default=0) + 1
    visits = (
        replace(v, phase=v.phase * depth + levels.get(v.name, 0) - depth) for v in problem.visits
    )
    return replace(problem, visits=tuple(visits))


# what the visit is called at which an arm begins; no measurement has a space in its name
BEGIN_PREFIX = "begin of "
NO_VISITS: Mapping[str, Visit] = {}
PROOF_WORK_S = 5.0  # work of the solver for a tour with windows, about seconds


@dataclass(frozen=True)
class SharedMeasurements:
    """The shares of several arms, and all visits in the `order` in which they can begin.

    `tools` and `arms` are by measurement; `waits` are pairs (first, second) of visits of different
    arms of which the second waits. `per_unit` units of the costs are one `unit`. `measuring` says
    what a measurement of an arm takes beside the way to it, and `unkept` why no order keeps all
    windows.
    """

    shares: Shares
    problems: Mapping[str, TourProblem]
    order: tuple[str, ...]
    tools: Mapping[str, str]
    arms: Mapping[str, str]
    waits: tuple[tuple[str, str], ...]
    partition: ToolPartition
    unit: str
    per_unit: float
    measuring: Mapping[str, int]
    unkept: str = ""

    @property
    def last(self) -> tuple[TourProblem, Tour]:
        """The tour problem of the arm that is done last, and its tour."""
        problem = self.problems[max(self.problems, key=lambda arm: self.shares.busy[arm])]
        order = tuple(range(len(problem.visits)))
        return problem, Tour(order, cost_of(problem, order), 0)

    def lasts(self, cost: int) -> int:
        """A cost in the unit of the shares, rounded up."""
        return -int(-cost // self.per_unit)


def share_measurements(
    problem: Problem,
    parts: ToolPartition,
    more: TourDemands,
    limits: TourLimits,
    line: PartChain,
    at: Mapping[str, Visit] = NO_VISITS,
    offered: ArmOffers | None = None,
) -> SharedMeasurements | Infeasible | GaveUp:
    """The shares with the least makespan that are found; why there are none. `line` is where plans
    begin. Raises `InvalidInput`.

    `at` says which visit each arm has made last, if it has. What arms can make is `offered`, if it
    is known.
    """
    offers_of_arms = offered or arm_offers(problem, parts)
    parts = replace(parts, impossible={**parts.impossible, **offers_of_arms.impossible})
    share_answers = [
        SharingRequest(problem, parts, more, limits, line, able, at).shared()
        for able in offers_of_arms.ways
    ]
    able_ = [
        share_answer
        for share_answer in share_answers
        if isinstance(share_answer, SharedMeasurements)
    ]
    return (
        min(able_, key=lambda share_answer: share_answer.shares.makespan)
        if able_
        else share_answers[0]
    )


@dataclass(frozen=True)
class SharingRequest:
    """Measurements to be shared, where each arm has its tools (`able`), and has made the visit
    `at` last.
    """

    problem: Problem
    parts: ToolPartition
    more: TourDemands
    limits: TourLimits
    line: PartChain
    able: Able
    at: Mapping[str, Visit] = field(default_factory=dict)

    @cached_property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """Pairs of measurements of which the first comes before the second."""
        words, facts = self.problem.domain.conventions, evaluate_statics(self.problem).atoms
        return of_facts(facts, words, Source(self.problem.path)).and_also(self.more).before

    @cached_property
    def toured(self) -> Mapping[str, TourProblem]:
        """For each arm the tour problem of all measurements that it can make."""
        return {
            arm: tour_problem(
                self.problem, replace(self.parts, groups=_tool_groups(tools)), self.more
            )
            for arm, tools in self.able.items()
        }

    @cached_property
    def starts(self) -> Mapping[str, Point]:
        """Where each arm stands at the start, in micrometres, if a fact about it names a place
        whose position is known.
        """
        amounts, starts = amounts_of(self.problem), dict[str, Point]()
        for atom in sorted(self.line.here.state, key=str):
            arm = str(atom.arguments[0]) if atom.arguments else ""
            for place in _inner_terms(atom) if arm in self.able and arm not in starts else ():
                with contextlib.suppress(NoAmount):
                    starts.setdefault(arm, amounts.point(place))
        return starts

    def _from_start(self, arm: str, tours: TourProblem) -> TourProblem:
        """The tour of an arm from where it stands; ways that a table gives do not begin there."""
        if (arm not in self.starts and arm not in self.at) or tours.unit != STRAIGHT_UNIT:
            return tours
        first = min((visit.phase for visit in tours.visits), default=0)
        last_visit = self.at.get(arm) or Visit(
            "", tuple(coordinate * 1e-6 for coordinate in self.starts[arm])
        )
        begin = replace(last_visit, name=f"{BEGIN_PREFIX}{arm}", phase=first)
        straight_tours = straight_tour(tours.name, (begin, *tours.visits), tours.changes, 0)
        pairs = tuple((a + 1, b + 1) for a, b in tours.precedence)
        return replace(straight_tours, precedence=pairs, shifts=tours.shifts)

    @cached_property
    def in_time(self) -> bool:
        """Whether costs are times."""
        return all(
            tour.unit == self.problem.domain.time_unit
            for tour in self.toured.values()
            if tour.visits
        )

    @cached_property
    def per_unit(self) -> float:
        """How many units of the costs are a unit of time: micrometres that an arm moves in it.

        1 if nobody knows.
        """
        motion = self.problem.domain.motion
        return 1.0 if self.in_time or motion is None else float(motion.speed)

    @cached_property
    def measuring(self) -> dict[str, int]:
        """What a measurement of each arm takes beside the way to it, in units of time."""
        has_times = self.in_time or self.problem.domain.motion is not None
        return {
            arm: self._measuring(arm, tour) if has_times else 0 for arm, tour in self.toured.items()
        }

    def shared(self) -> SharedMeasurements | Infeasible | GaveUp:
        """The shares that are found, put in order once more if the arms would wait for each
        other in a circle.
        """
        problems = {
            arm: self._lasting(arm, without_windows(tour)) for arm, tour in self.toured.items()
        }
        shares_found = self._shares(problems)
        if not isinstance(shares_found, Shares):
            return shares_found
        shared_tours = self._made(problems, shares_found)
        if shared_tours is None:
            levels = levels_of(self.pairs)
            problems = {arm: levelled_tour(tour, levels) for arm, tour in problems.items()}
            shares_found = self._shares(problems)
            if not isinstance(shares_found, Shares):
                return shares_found
            shared_tours = self._made(problems, shares_found)
        return shared_tours or GaveUp("the arms would wait for each other in a circle", "work")

    def following(self, orders: Mapping[str, tuple[str, ...]]) -> SharedMeasurements | None:
        """The shares in orders that are known; None if the arms would wait for each other in a
        circle.
        """
        problems = {
            arm: self._lasting(arm, without_windows(tour)) for arm, tour in self.toured.items()
        }
        whole = {arm: tuple(orders.get(arm, ())) for arm in problems}
        busy = {arm: self._busy(problems, arm, own) for arm, own in whole.items()}
        return self._made(problems, Shares(whole, busy, 0, self._common), keep=True)

    @property
    def _common(self) -> int:
        """How many measurements more than one arm can make."""
        arms = Counter(name for own in self.able.values() for name in own)
        return sum(arm_count > 1 for arm_count in arms.values())

    def _busy(self, problems: Mapping[str, TourProblem], arm: str, names: tuple[str, ...]) -> int:
        begun = self._from_start(arm, of_share(problems[arm], names))
        return busy_with(begun, tuple(range(len(begun.visits))))

    def _shares(self, problems: Mapping[str, TourProblem]) -> Shares | Infeasible | GaveUp:
        """The shares, without the places where arms begin."""
        begun = {arm: self._from_start(arm, tour) for arm, tour in problems.items()}
        shares_found = share_visits(SharedProblem(begun), self.limits)
        if not isinstance(shares_found, Shares):
            return shares_found
        orders = {
            arm: tuple(n for n in own if not n.startswith(BEGIN_PREFIX))
            for arm, own in shares_found.orders.items()
        }
        return replace(shares_found, orders=orders)

    def _lasting(self, arm: str, tours: TourProblem) -> TourProblem:
        lasts = round(self.measuring[arm] * self.per_unit)
        return replace(
            tours, visits=tuple(replace(v, duration=v.duration or lasts) for v in tours.visits)
        )

    def _measuring(self, arm: str, tours: TourProblem) -> int:
        """Two measurements with the same tool are planned; 0 if there are no two, or no plan."""
        first = tours.visits[0] if tours.visits else None
        same = [n for n, visit in enumerate(tours.visits) if first and visit.tool == first.tool][:2]
        if len(same) < 2:
            return 0
        goals = [
            PlanningPart(visit.name, (by_arm(self.problem, visit.name, visit.tool, arm),))
            for visit in (tours.visits[n] for n in same)
        ]
        led = self.line.led(goals[:1])
        lasts = INFINITE_COST if led is None else led.trial(goals[1:])[0]
        travel = time_between(self.problem, tours, same) or 0
        return 0 if lasts >= INFINITE_COST else max(0, lasts - travel)

    def _made(
        self, problems: Mapping[str, TourProblem], shares_found: Shares, keep: bool = False
    ) -> SharedMeasurements | None:
        """What is known of the shares, whose orders are to `keep` or may give way to windows;
        None if arms wait in a circle.
        """
        shares_found, unkept = (
            (shares_found, "") if keep else self._in_windows(problems, shares_found)
        )
        arms = {name: arm for arm, own in shares_found.orders.items() for name in own}
        waits = tuple(dict.fromkeys(waits_of(self.pairs, self.toured, shares_found, arms)))
        order = merge_visits(problems, shares_found, waits)
        if order is None:
            return None
        tools = {name: self.able[arms[name]][name] for name in order}
        own = {
            arm: of_share(problems[arm], names)
            for arm, names in shares_found.orders.items()
            if names
        }
        has_times = self.in_time or self.problem.domain.motion is not None
        unit = self.problem.domain.time_unit if has_times else STRAIGHT_UNIT
        parts = replace(self.parts, groups=_tool_groups(tools))
        return SharedMeasurements(
            shares_found,
            own,
            order,
            tools,
            arms,
            waits,
            parts,
            unit,
            self.per_unit,
            self.measuring,
            unkept,
        )

    def _in_windows(
        self, problems: Mapping[str, TourProblem], shares_found: Shares
    ) -> tuple[Shares, str]:
        """The shares, each in an order that keeps the windows, if one is found; and why not,
        for one that has none.
        """
        orders, unkept = dict(shares_found.orders), ""
        for arm, own in shares_found.orders.items():
            asked = of_share(self._lasting(arm, self.toured[arm]), own)
            if not asked.timed:
                continue
            tour = sequence_tour(asked, replace(self.limits, proof=PROOF_WORK_S))
            if isinstance(tour, Tour):
                orders[arm] = tuple(own[n] for n in tour.order)
            else:
                unkept = tour.reason
        busy = {arm: self._busy(problems, arm, names) for arm, names in orders.items()}
        return replace(shares_found, orders=orders, busy=busy), unkept


def _inner_terms(term: Term) -> Iterator[Term]:
    """The terms inside of a term, the outer ones first."""
    for argument in term.arguments if isinstance(term, Function) else ():
        yield argument
        yield from _inner_terms(argument)


def _tool_groups(tools: Mapping[str, str]) -> dict[str, tuple[str, ...]]:
    groups = dict[str, list[str]]()
    for name, tool in tools.items():
        groups.setdefault(tool, []).append(name)
    return {tool: tuple(groups[tool]) for tool in sorted(groups)}
