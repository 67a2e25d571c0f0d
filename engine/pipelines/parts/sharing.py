"""Several arms share the measurements of an inspection: each gets those that it makes, in its order, so that all are done soonest.

What a measurement takes beside the way to it, only a plan tells. So two of an arm's are planned, one after the other. Who waits for
whom, because of `before` or of the alignment, is kept by the order in which all visits can begin.
"""

import contextlib
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

from cellwright.engine.model.outcome import GaveUp, Infeasible
from cellwright.engine.model.tour import SharedProblem, Shares, Tour, TourProblem, Visit, busy_with, cost_of
from cellwright.engine.pipelines.inspection import Partition, tour_problem
from cellwright.engine.pipelines.inspection.arms import Able, Offers, by_arm, offers
from cellwright.engine.pipelines.inspection.demands import Demands, of_facts, without_windows
from cellwright.engine.pipelines.inspection.ways import STRAIGHT, straight, time_between
from cellwright.engine.pipelines.parts.chain import MUCH, Chain, Part
from cellwright.engine.pipelines.parts.turns import levelled, levels_of, merged, of_share, waits_of
from cellwright.engine.stages.sequencing import Limits, sequence
from cellwright.engine.stages.sequencing.sharing import share
from cellwright.kb.asp.statics import evaluated
from cellwright.kb.diagnostics import Source
from cellwright.kb.loader.amounts import amounts_of
from cellwright.kb.model.amounts import NoAmount
from cellwright.kb.model.motion import Point
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Function, Term

BEGIN = "begin of "  # what the visit is called at which an arm begins; no measurement has a space in its name
NOWHERE: Mapping[str, Visit] = {}
PROOF = 5.0  # work of the solver for a tour with windows, about seconds


@dataclass(frozen=True)
class Shared:
    """The shares of several arms, and all visits in the `order` in which they can begin.

    `tools` and `arms` are by measurement; `waits` are pairs (first, second) of visits of different arms of which the second waits.
    `per_unit` units of the costs are one `unit`. `measuring` says what a measurement of an arm takes beside the way to it, and
    `unkept` why no order keeps all windows.
    """

    shares: Shares
    problems: Mapping[str, TourProblem]
    order: tuple[str, ...]
    tools: Mapping[str, str]
    arms: Mapping[str, str]
    waits: tuple[tuple[str, str], ...]
    partition: Partition
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


def shared(
    problem: Problem,
    parts: Partition,
    more: Demands,
    limits: Limits,
    line: Chain,
    at: Mapping[str, Visit] = NOWHERE,
    offered: Offers | None = None,
) -> Shared | Infeasible | GaveUp:
    """The shares with the least makespan that are found; why there are none. `line` is where plans begin. Raises `InvalidInput`.

    `at` says which visit each arm has made last, if it has. What arms can make is `offered`, if it is known.
    """
    found = offered or offers(problem, parts)
    parts = replace(parts, impossible={**parts.impossible, **found.impossible})
    made = [Asked(problem, parts, more, limits, line, able, at).shared() for able in found.ways]
    able_ = [each for each in made if isinstance(each, Shared)]
    return min(able_, key=lambda each: each.shares.makespan) if able_ else made[0]


@dataclass(frozen=True)
class Asked:
    """Measurements to be shared, where each arm has its tools (`able`), and has made the visit `at` last."""

    problem: Problem
    parts: Partition
    more: Demands
    limits: Limits
    line: Chain
    able: Able
    at: Mapping[str, Visit] = field(default_factory=dict)

    @cached_property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """Pairs of measurements of which the first comes before the second."""
        words, facts = self.problem.domain.conventions, evaluated(self.problem).atoms
        return of_facts(facts, words, Source(self.problem.path)).and_also(self.more).before

    @cached_property
    def toured(self) -> Mapping[str, TourProblem]:
        """For each arm the tour problem of all measurements that it can make."""
        return {
            arm: tour_problem(self.problem, replace(self.parts, groups=_groups(tools)), self.more)
            for arm, tools in self.able.items()
        }

    @cached_property
    def starts(self) -> Mapping[str, Point]:
        """Where each arm stands at the start, in micrometres, if a fact about it names a place whose position is known."""
        amounts, found = amounts_of(self.problem), dict[str, Point]()
        for atom in sorted(self.line.here.state, key=str):
            arm = str(atom.arguments[0]) if atom.arguments else ""
            for place in _inside(atom) if arm in self.able and arm not in found else ():
                with contextlib.suppress(NoAmount):
                    found.setdefault(arm, amounts.point(place))
        return found

    def _from_start(self, arm: str, tours: TourProblem) -> TourProblem:
        """The tour of an arm from where it stands; ways that a table gives do not begin there."""
        if (arm not in self.starts and arm not in self.at) or tours.unit != STRAIGHT:
            return tours
        first = min((visit.phase for visit in tours.visits), default=0)
        here = self.at.get(arm) or Visit("", tuple(each * 1e-6 for each in self.starts[arm]))
        begin = replace(here, name=f"{BEGIN}{arm}", phase=first)
        made = straight(tours.name, (begin, *tours.visits), tours.changes, 0)
        pairs = tuple((a + 1, b + 1) for a, b in tours.precedence)
        return replace(made, precedence=pairs, shifts=tours.shifts)

    @cached_property
    def in_time(self) -> bool:
        """Whether costs are times."""
        return all(each.unit == self.problem.domain.time_unit for each in self.toured.values() if each.visits)

    @cached_property
    def per_unit(self) -> float:
        """How many units of the costs are a unit of time: micrometres that an arm moves in it. 1 if nobody knows."""
        motion = self.problem.domain.motion
        return 1.0 if self.in_time or motion is None else float(motion.speed)

    @cached_property
    def measuring(self) -> dict[str, int]:
        """What a measurement of each arm takes beside the way to it, in units of time."""
        known = self.in_time or self.problem.domain.motion is not None
        return {arm: self._measuring(arm, each) if known else 0 for arm, each in self.toured.items()}

    def shared(self) -> Shared | Infeasible | GaveUp:
        """The shares that are found, put in order once more if the arms would wait for each other in a circle."""
        problems = {arm: self._lasting(arm, without_windows(each)) for arm, each in self.toured.items()}
        found = self._shares(problems)
        if not isinstance(found, Shares):
            return found
        made = self._made(problems, found)
        if made is None:
            levels = levels_of(self.pairs)
            problems = {arm: levelled(each, levels) for arm, each in problems.items()}
            found = self._shares(problems)
            if not isinstance(found, Shares):
                return found
            made = self._made(problems, found)
        return made or GaveUp("the arms would wait for each other in a circle", "work")

    def following(self, orders: Mapping[str, tuple[str, ...]]) -> Shared | None:
        """The shares in orders that are known; None if the arms would wait for each other in a circle."""
        problems = {arm: self._lasting(arm, without_windows(each)) for arm, each in self.toured.items()}
        whole = {arm: tuple(orders.get(arm, ())) for arm in problems}
        busy = {arm: self._busy(problems, arm, own) for arm, own in whole.items()}
        return self._made(problems, Shares(whole, busy, 0, self._common), keep=True)

    @property
    def _common(self) -> int:
        """How many measurements more than one arm can make."""
        arms = Counter(name for own in self.able.values() for name in own)
        return sum(each > 1 for each in arms.values())

    def _busy(self, problems: Mapping[str, TourProblem], arm: str, names: tuple[str, ...]) -> int:
        begun = self._from_start(arm, of_share(problems[arm], names))
        return busy_with(begun, tuple(range(len(begun.visits))))

    def _shares(self, problems: Mapping[str, TourProblem]) -> Shares | Infeasible | GaveUp:
        """The shares, without the places where arms begin."""
        begun = {arm: self._from_start(arm, each) for arm, each in problems.items()}
        found = share(SharedProblem(begun), self.limits)
        if not isinstance(found, Shares):
            return found
        orders = {arm: tuple(n for n in own if not n.startswith(BEGIN)) for arm, own in found.orders.items()}
        return replace(found, orders=orders)

    def _lasting(self, arm: str, tours: TourProblem) -> TourProblem:
        lasts = round(self.measuring[arm] * self.per_unit)
        return replace(tours, visits=tuple(replace(v, duration=v.duration or lasts) for v in tours.visits))

    def _measuring(self, arm: str, tours: TourProblem) -> int:
        """Two measurements with the same tool are planned; 0 if there are no two, or no plan."""
        first = tours.visits[0] if tours.visits else None
        same = [n for n, each in enumerate(tours.visits) if first and each.tool == first.tool][:2]
        if len(same) < 2:
            return 0
        goals = [
            Part(each.name, (by_arm(self.problem, each.name, each.tool, arm),))
            for each in (tours.visits[n] for n in same)
        ]
        led = self.line.led(goals[:1])
        lasts = MUCH if led is None else led.trial(goals[1:])[0]
        way = time_between(self.problem, tours, same) or 0
        return 0 if lasts >= MUCH else max(0, lasts - way)

    def _made(self, problems: Mapping[str, TourProblem], found: Shares, keep: bool = False) -> Shared | None:
        """What is known of the shares, whose orders are to `keep` or may give way to windows; None if arms wait in a circle."""
        found, unkept = (found, "") if keep else self._in_windows(problems, found)
        arms = {name: arm for arm, own in found.orders.items() for name in own}
        waits = tuple(dict.fromkeys(waits_of(self.pairs, self.toured, found, arms)))
        order = merged(problems, found, waits)
        if order is None:
            return None
        tools = {name: self.able[arms[name]][name] for name in order}
        own = {arm: of_share(problems[arm], names) for arm, names in found.orders.items() if names}
        known = self.in_time or self.problem.domain.motion is not None
        unit = self.problem.domain.time_unit if known else STRAIGHT
        parts = replace(self.parts, groups=_groups(tools))
        return Shared(
            found, own, order, tools, arms, waits, parts, unit, self.per_unit, self.measuring, unkept
        )

    def _in_windows(self, problems: Mapping[str, TourProblem], found: Shares) -> tuple[Shares, str]:
        """The shares, each in an order that keeps the windows, if one is found; and why not, for one that has none."""
        orders, unkept = dict(found.orders), ""
        for arm, own in found.orders.items():
            asked = of_share(self._lasting(arm, self.toured[arm]), own)
            if not asked.timed:
                continue
            tour = sequence(asked, replace(self.limits, proof=PROOF))
            if isinstance(tour, Tour):
                orders[arm] = tuple(own[n] for n in tour.order)
            else:
                unkept = tour.reason
        busy = {arm: self._busy(problems, arm, names) for arm, names in orders.items()}
        return replace(found, orders=orders, busy=busy), unkept


def _inside(term: Term) -> Iterator[Term]:
    """The terms inside of a term, the outer ones first."""
    for each in term.arguments if isinstance(term, Function) else ():
        yield each
        yield from _inside(each)


def _groups(tools: Mapping[str, str]) -> dict[str, tuple[str, ...]]:
    found = dict[str, list[str]]()
    for name, tool in tools.items():
        found.setdefault(tool, []).append(name)
    return {tool: tuple(found[tool]) for tool in sorted(found)}
