"""The best order of the steps of a plan: its constraint model and solver (CP-SAT).

Whom a condition comes from is open (of several steps that achieve it, any one may serve), and so is
the order of steps that hold one resource or disturb each other. This is the least makespan of all
orders of a given set of steps; with `optional` steps also of all choices among them. Nothing is
asked of the structure of a plan: arms may be several, busy at the start, or holding several things.
"""

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

from ortools.sat.python import cp_model
from ortools.sat.python.cp_model import (
    CpModel,
    Domain,
    IntervalVar,
    IntVar,
    LinearExpr,
    LiteralT,
)

from cellwright.engine.kernels.bits import Bits, indices
from cellwright.engine.model.ground_task import GroundOperator
from cellwright.engine.model.outcome import Infeasible
from cellwright.engine.stages.scheduling.schedule_limits import ScheduleLimits
from cellwright.engine.stages.scheduling.shop_solver import run_solver
from cellwright.engine.stages.scheduling.window_lags import AT_END, AT_START, StepLag, StepMoment
from cellwright.kb.model.time_windows import TimeOfWork
from cellwright.kb.terms import Term

ORDER_START = -1
NO_ORDER_IN_WINDOWS = "in no order of the steps are all windows and calendars kept"
MAX_SUPPORT_PAIRS = 400_000  # pairs of a possible producer and what may come between, of one model


class TooManySupports(Exception):
    """More ways to support the steps than a solver is given."""


@dataclass(frozen=True)
class StepOrdering:
    """What is to be put in order, from `initial` to `goals`.

    Steps are plain operators. `horizon` is a time by which all can be done. `lead(i, j)` is the
    time that must pass between the end of step i and the start of step j if they come in this order
    (travel). `stays` are conditions that may last at most so long, from the end of who achieves
    them to the start of who ends them. `release` and `due` are by step; the third of `due` is the
    cost of each unit of time after it. `lags` are windows between steps by their places, and
    `calendars` say when steps may be done. Without `optional` every step is done.
    """

    initial: Bits
    steps: Sequence[GroundOperator]
    goals: Bits
    horizon: int
    lead: Callable[[int, int], int] = field(default=lambda _one, _other: 0)
    stays: Mapping[int, int] = field(default_factory=dict)
    release: Mapping[int, int] = field(default_factory=dict)
    due: Sequence[tuple[Sequence[int], int, int]] = ()
    lags: Sequence[StepLag] = ()
    calendars: Sequence[TimeOfWork] = ()
    optional: bool = False


@dataclass
class OrderModel:
    """The constraint model of an ordering."""

    asked: StepOrdering
    cp: CpModel = field(default_factory=CpModel)
    before: dict[tuple[int, int], LiteralT] = field(default_factory=dict)

    def __post_init__(self) -> None:
        steps, horizon = self.asked.steps, self.asked.horizon
        self.present = [
            self.cp.new_bool_var("") if self.asked.optional else self.cp.new_constant(1)
            for _ in steps
        ]
        self.starts = [
            self.cp.new_int_var(
                min(self.asked.release.get(n, 0), horizon), max(0, horizon - s.duration), ""
            )
            for n, s in enumerate(steps)
        ]
        self.makespan = self.cp.new_int_var(0, horizon, "makespan")
        self.ranks = {
            n: self.cp.new_int_var(0, len(steps), "") for n, s in enumerate(steps) if not s.duration
        }

    def build(self, bound: int) -> None:
        """All constraints and the objective; no makespan is below `bound`."""
        self._require_affordable()
        self._exclude()
        self._hold()
        for consumer in range(len(self.asked.steps)):
            for atom in indices(self.asked.steps[consumer].preconditions):
                self._support(consumer, atom)
        for atom in indices(self.asked.goals):
            self._support(None, atom)
        for step, start, present in zip(self.asked.steps, self.starts, self.present, strict=True):
            self.cp.add(self.makespan >= start + step.duration).only_enforce_if(present)
        self.cp.add(self.makespan >= bound)
        self.price = sum(self._keep(lag) for lag in self.asked.lags)
        self._open()
        self._minimise()

    def _keep(self, lag: StepLag) -> LinearExpr | int:
        """A window between two steps; the cost of what it is broken by, if it has a price."""
        lasts = self._time(lag.later) - self._time(lag.earlier)
        if lag.price is None:
            self.cp.add(lasts >= lag.least)
            if lag.most is not None:
                self.cp.add(lasts <= lag.most)
            return 0
        broken = self.cp.new_int_var(0, 2 * self.asked.horizon + lag.least, "")
        self.cp.add(broken >= lag.least - lasts)
        if lag.most is not None:
            self.cp.add(broken >= lasts - lag.most)
        return lag.price * broken

    def _time(self, moment: StepMoment) -> LinearExpr | int:
        if moment.step == AT_START:
            return 0
        if moment.step == AT_END:
            return self.makespan
        return self.starts[moment.step] + moment.offset

    def _open(self) -> None:
        """Steps are done when their calendars allow it."""
        for calendar in self.asked.calendars:
            for step, start, present in zip(
                self.asked.steps, self.starts, self.present, strict=True
            ):
                if calendar.covers(step.instance, step.resources):
                    allowed = calendar.allowed_starts(step.duration, self.asked.horizon)
                    self.cp.add_linear_expression_in_domain(
                        start, Domain.from_intervals(allowed)
                    ).only_enforce_if(present)

    @cached_property
    def adders(self) -> dict[int, list[int]]:
        """For each atom the steps that achieve it."""
        return _by_atom([step.adds for step in self.asked.steps])

    @cached_property
    def deleters(self) -> dict[int, list[int]]:
        """For each atom the steps that end it."""
        return _by_atom([step.deletes & ~step.adds for step in self.asked.steps])

    def _require_affordable(self) -> None:
        conditions = [step.preconditions for step in self.asked.steps]
        needed = [
            atom
            for needed_atoms in (*conditions, self.asked.goals)
            for atom in indices(needed_atoms)
        ]
        pairs = (len(self.adders.get(a, ())) * (1 + len(self.deleters.get(a, ()))) for a in needed)
        if sum(pairs) > MAX_SUPPORT_PAIRS:
            raise TooManySupports("it has too many steps for all their orders to be compared")

    def _exclude(self) -> None:
        """Two steps that may not overlap come one after the other."""
        for one_step, other_step in exclusive_pairs(self.asked.steps):
            first = self.cp.new_bool_var("")
            second: LiteralT = ~first
            if self.asked.optional:
                second = self.cp.new_bool_var("")
                both = [~self.present[one_step], ~self.present[other_step]]
                self.cp.add_bool_or([first, second, *both])
                self.cp.add_implication(first, ~second)
            self.before[one_step, other_step], self.before[other_step, one_step] = first, second
            self._follows(one_step, other_step, first)
            self._follows(other_step, one_step, second)

    def _hold(self) -> None:
        """Each resource does one thing at a time; that is implied, and the solver reasons
        faster with it.
        """
        users: dict[Term, list[IntervalVar]] = {}
        for n, step in enumerate(self.asked.steps):
            if step.resources and step.duration:
                start, present = self.starts[n], self.present[n]
                span = self.cp.new_optional_fixed_size_interval_var(
                    start, step.duration, present, ""
                )
                for resource in step.resources:
                    users.setdefault(resource, []).append(span)
        for spans in users.values():
            self.cp.add_no_overlap(spans)

    def _follows(self, one: int, other: int, literal: LiteralT) -> None:
        """Step `other` starts after the end of `one`, if a literal is true."""
        step = self.asked.steps[one]
        wait = step.duration + self.asked.lead(one, other)
        self.cp.add(self.starts[other] >= self.starts[one] + wait).only_enforce_if(literal)
        if one in self.ranks and other in self.ranks:
            self.cp.add(self.ranks[other] >= self.ranks[one] + 1).only_enforce_if(literal)

    def _support(self, consumer: int | None, atom: int) -> None:
        """Some step before the consumer, or the start, makes an atom true, and nothing between
        them ends it.
        """
        ways: list[LiteralT] = []
        if self.asked.initial >> atom & 1:
            ways.append(self._from_start(consumer, atom))
        ways += [self._from(n, consumer, atom) for n in self.adders.get(atom, ()) if n != consumer]
        absent = [] if consumer is None else [~self.present[consumer]]
        if self.asked.optional:
            self.cp.add_bool_or([*ways, *absent])
        else:
            self.cp.add_exactly_one(ways)

    def _from_start(self, consumer: int | None, atom: int) -> LiteralT:
        way = self.cp.new_bool_var("")
        for threat in self.deleters.get(atom, ()):
            if threat != consumer:
                safe = self._before(consumer, threat)
                self.cp.add_bool_or([~way, ~self.present[threat], *safe])
        self._stays(way, ORDER_START, consumer, atom)
        return way

    def _from(self, producer: int, consumer: int | None, atom: int) -> LiteralT:
        way = self.cp.new_bool_var("")
        self.cp.add_implication(way, self.present[producer])
        if consumer is not None:
            self._follows(producer, consumer, way)
        for threat in self.deleters.get(atom, ()):
            if threat not in (producer, consumer):
                safe = [self.before[threat, producer], *self._before(consumer, threat)]
                self.cp.add_bool_or([~way, ~self.present[threat], *safe])
        self._stays(way, producer, consumer, atom)
        return way

    def _before(self, consumer: int | None, threat: int) -> list[LiteralT]:
        return [] if consumer is None else [self.before[consumer, threat]]

    def _stays(self, way: LiteralT, producer: int, consumer: int | None, atom: int) -> None:
        """Who ends a condition that may last only so long starts soon enough after who achieved
        it.
        """
        if atom not in self.asked.stays or producer == ORDER_START or consumer is None:
            return
        if consumer in self.deleters.get(atom, ()):
            latest = self.asked.steps[producer].duration + self.asked.stays[atom]
            self.cp.add(self.starts[consumer] <= self.starts[producer] + latest).only_enforce_if(
                way
            )

    def _minimise(self) -> None:
        """Lateness and prices first, then the makespan, then the cost of optional steps."""
        horizon, cost = self.asked.horizon, sum(step.cost for step in self.asked.steps)
        late = []
        for steps, due, priority in self.asked.due:
            lateness = self.cp.new_int_var(0, horizon, "")
            for n in steps:
                end = self.starts[n] + self.asked.steps[n].duration
                self.cp.add(lateness >= end - due).only_enforce_if(self.present[n])
            late.append(priority * lateness)
        self.tardiness = sum(late)
        wrong = self.tardiness + self.price
        spent = sum(
            step.cost * present
            for step, present in zip(self.asked.steps, self.present, strict=True)
        )
        if self.asked.optional:
            self.cp.minimize(((horizon + 1) * wrong + self.makespan) * (cost + 1) + spent)
        else:
            self.cp.minimize((horizon + 1) * wrong + self.makespan)

    def hint(self, starts: Mapping[int, int]) -> None:
        """Offer the starts of the steps of a known plan; other steps are absent."""
        for n, step in enumerate(self.asked.steps):
            if self.asked.optional:
                self.cp.add_hint(self.present[n], n in starts)
            self.cp.add_hint(self.starts[n], starts.get(n, 0))
            if n in self.ranks:
                self.cp.add_hint(self.ranks[n], n if n in starts else 0)
            for other in starts if n in starts else ():
                literal = self.before.get((n, other))
                if isinstance(literal, IntVar) and literal.index >= 0:
                    self.cp.add_hint(
                        literal, starts[n] + step.duration <= starts[other] and n != other
                    )
        ends = [start + self.asked.steps[n].duration for n, start in starts.items()]
        self.cp.add_hint(self.makespan, max(ends, default=0))


def exclusive_pairs(steps: Sequence[GroundOperator]) -> Iterator[tuple[int, int]]:
    """The pairs of steps that may not overlap: they share a resource, or one denies what the
    other needs or adds.
    """
    holds = [frozenset(step.resources) for step in steps]
    denies = [step.deletes & ~step.adds for step in steps]
    touches = [step.adds | step.preconditions for step in steps]
    for first, second in itertools.combinations(range(len(steps)), 2):
        disturbs = denies[first] & touches[second] or denies[second] & touches[first]
        if disturbs or holds[first] & holds[second]:
            yield first, second


def _by_atom(sets: Sequence[Bits]) -> dict[int, list[int]]:
    steps_by_atom: dict[int, list[int]] = {}
    for number, atoms in enumerate(sets):
        for atom in indices(atoms):
            steps_by_atom.setdefault(atom, []).append(number)
    return steps_by_atom


@dataclass(frozen=True, slots=True)
class Reordered:
    """The start of each step that is done, by its place in what was asked; no order of these steps
    ends before `lower_bound`.

    `proved` says that there is no better order.
    """

    starts: Mapping[int, int]
    makespan: int
    lower_bound: int
    tardiness: int = 0
    proved: bool = False


def reorder_steps(
    asked: StepOrdering, bound: int, known: Mapping[int, int], limits: ScheduleLimits
) -> Reordered | Infeasible | None:
    """The best order found, with `known` starts as a hint; None if none was found. Raises
    `TooManySupports`.
    """
    model = OrderModel(asked)
    model.build(bound)
    model.hint(known)
    solver = cp_model.CpSolver()
    status = run_solver(solver, model.cp, limits)
    if status == cp_model.INFEASIBLE:
        return Infeasible(
            NO_ORDER_IN_WINDOWS
            if asked.lags or asked.calendars
            else "in no order of the steps is everything taken away in time (longest_stay)"
        )
    if status not in (cp_model.OPTIMAL, cp_model.FEASIBLE):
        return None
    starts = {
        n: solver.value(start)
        for n, start in enumerate(model.starts)
        if solver.boolean_value(model.present[n])
    }
    makespan = max((start + asked.steps[n].duration for n, start in starts.items()), default=0)
    late, proved = solver.value(model.tardiness), status == cp_model.OPTIMAL
    order = sorted(
        starts,
        key=lambda n: (
            starts[n],
            starts[n] + asked.steps[n].duration,
            _step_rank(solver, model, n),
        ),
    )
    exact = proved and not late and not solver.value(model.price)
    least = makespan if exact else bound
    return Reordered({n: starts[n] for n in order}, makespan, min(least, makespan), late, proved)


def _step_rank(solver: cp_model.CpSolver, model: OrderModel, step: int) -> int:
    return solver.value(model.ranks[step]) if step in model.ranks else 0
