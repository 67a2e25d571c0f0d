"""The temporal network of a plan: its steps, its order, its windows, and what nobody decides."""

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

from cellwright.engine.model.time_limits import MeasurementWindow, measured_steps
from cellwright.engine.model.uncertain_times import (
    ORIGIN,
    DifferenceBound,
    UncertainLink,
    UncertainNetwork,
)
from cellwright.engine.pipelines.planning.dwell_limits import stays_of, wishes_for
from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.stages.lifted.cell_domain import CellDomain, Situation
from cellwright.engine.stages.scheduling.plan_blocks import (
    Unstructured,
    arm_resource,
    contains_term,
)
from cellwright.engine.stages.scheduling.shop_translation import Wishes
from cellwright.kb.model.operator_amounts import DurationRange, range_of_step
from cellwright.kb.model.plan_model import Plan, Step, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Term


@dataclass(frozen=True, slots=True)
class HardWindow:
    """Between two points of a network must be at least `least` and at most `most`, in words."""

    earlier: int
    later: int
    least: int | None
    most: int | None
    says: str

    def bounds(self) -> Iterator[DifferenceBound]:
        """The same as bounds of a network, which a relaxation may widen."""
        if self.most is not None:
            yield DifferenceBound(self.earlier, self.later, self.most, self.says, relaxable=True)
        if self.least is not None:
            yield DifferenceBound(self.later, self.earlier, -self.least, self.says, relaxable=True)


@dataclass(frozen=True)
class PlanNetwork:
    """A plan with the ranges of its steps, and what must be kept between their starts and ends.

    `lags` are (step, later step, time): the later one starts so long after the end of the first.
    """

    plan: Plan
    ranges: Mapping[StepId, DurationRange]
    lags: tuple[tuple[StepId, StepId, int, str], ...]
    floors: Mapping[StepId, int]
    windows: tuple[HardWindow, ...]
    unit: str

    def start(self, step: StepId) -> int:
        """The point at which a step starts."""
        return 1 + 2 * self._places[step]

    def end(self, step: StepId) -> int:
        """The point at which it ends."""
        return 2 + 2 * self._places[step]

    @cached_property
    def _places(self) -> dict[StepId, int]:
        return {step.id: place for place, step in enumerate(self.plan.steps)}

    @property
    def varying(self) -> tuple[Step, ...]:
        """The steps whose ends nobody decides."""
        return tuple(step for step in self.plan.steps if self.ranges[step.id].varies)

    @cached_property
    def network(self) -> UncertainNetwork:
        """The network in numbers. Links come in the order of the varying steps."""
        points, bounds, links = ["the beginning"], list[DifferenceBound](), list[UncertainLink]()
        for step in self.plan.steps:
            start, end, lasts = self.start(step.id), self.end(step.id), self.ranges[step.id]
            name = f"{step.id} {step.operator}"
            points += [f"the start of {name}", f"the end of {name}"]
            floor = self.floors.get(step.id, 0)
            said = f"{name} starts after {floor} {self.unit}" if floor else ""
            bounds.append(DifferenceBound(start, ORIGIN, -floor, said))
            if lasts.varies:
                says = f"{name} lasts {lasts.least} to {lasts.most} {self.unit}"
                links.append(UncertainLink(start, end, lasts.least, lasts.most, says))
            else:
                says = f"{name} lasts {lasts.usual} {self.unit}"
                bounds.append(DifferenceBound(start, end, lasts.usual, says))
                bounds.append(DifferenceBound(end, start, -lasts.usual, says))
        bounds += (
            DifferenceBound(self.start(later), self.end(earlier), -lag, says)
            for earlier, later, lag, says in self.lags
        )
        for window in self.windows:
            bounds += window.bounds()
        return UncertainNetwork(tuple(points), tuple(bounds), tuple(links))


def network_of_plan(problem: Problem, plan: Plan, starts: Mapping[StepId, int]) -> PlanNetwork:
    """The network of a plan whose steps hold resources in the order of these starts.

    Raises `NoAmount` for a range that cannot be told.
    """
    semantics = PlanGate().semantics(problem)
    wishes = wishes_for(semantics, plan)
    return _NetworkBuilder(problem, plan, starts, wishes).network(
        {step.id: range_of_step(semantics.amounts, step) for step in plan.steps},
        Situation.of(CellDomain(problem), semantics.initial()),
    )


class _NetworkBuilder:
    def __init__(
        self, problem: Problem, plan: Plan, starts: Mapping[StepId, int], wishes: Wishes
    ) -> None:
        self.problem, self.plan, self.starts, self.wishes = problem, plan, starts, wishes
        self.unit = problem.domain.time_unit
        places = {step.id: place for place, step in enumerate(plan.steps)}
        self.in_time = sorted(plan.steps, key=lambda step: (starts[step.id], places[step.id]))
        self.places = places

    def network(self, ranges: Mapping[StepId, DurationRange], begin: Situation) -> PlanNetwork:
        """The whole network."""
        lags = tuple(self._lags())
        windows = (*self._stays(begin), *self._due(), *self._visits())
        return PlanNetwork(self.plan, ranges, lags, self._floors(), windows, self.unit)

    def _start(self, step: StepId) -> int:
        return 1 + 2 * self.places[step]

    def _lags(self) -> Iterator[tuple[StepId, StepId, int, str]]:
        """Orders of the plan, of resources, and the ways of its arm."""
        names = {step.id: f"{step.id} {step.operator}" for step in self.plan.steps}
        for step in self.plan.steps:
            for before in step.after:
                yield before, step.id, 0, f"{names[step.id]} waits for {names[before]}"
        queues: dict[Term, list[Step]] = {}
        for step in self.in_time:
            for resource in step.resources:
                queues.setdefault(resource, []).append(step)
        for resource, queue in queues.items():
            for one, other in itertools.pairwise(queue):
                says = f"{names[other.id]} uses {resource} after {names[one.id]}"
                yield one.id, other.id, self._way(resource, one, other), says

    def _way(self, resource: Term, one: Step, other: Step) -> int:
        """The way of an arm between two of its steps."""
        if not self.wishes.stops or resource != self._arm:
            return 0
        here, there = (self._place[step.id] for step in (one, other))
        return 0 if here is None or there is None else self.wishes.travel.get((here, there), 0)

    @cached_property
    def _arm(self) -> Term | None:
        try:
            return arm_resource(self.plan.steps)
        except Unstructured:
            return None

    @cached_property
    def _place(self) -> dict[StepId, Term | None]:
        """Where the arm is for each of its steps: where it was for the last one that says it."""
        places: dict[StepId, Term | None] = {}
        last: Term | None = None
        for step in self.in_time:
            if self._arm is not None and self._arm in step.resources:
                last = self.wishes.place(step.operator, step.resources, self._arm) or last
                places[step.id] = last
        return places

    def _floors(self) -> dict[StepId, int]:
        """How soon steps may start that are about something that is released later."""
        return {
            step.id: max(0, *times)
            for step in self.plan.steps
            if (
                times := [
                    time
                    for subject, time in self.wishes.release.items()
                    if contains_term(step.operator, subject)
                ]
            )
        }

    def _stays(self, begin: Situation) -> Iterator[HardWindow]:
        for stay in stays_of(self.plan, self.wishes.longest_stay, begin):
            says = f"{stay.thing} stays in {stay.place} for at most {stay.most} {self.unit}"
            earlier, later = self._start(stay.source) + 1, self._start(stay.target)
            yield HardWindow(earlier, later, None, stay.most, says)

    def _due(self) -> Iterator[HardWindow]:
        for subject, due in self.wishes.due.items():
            says = f"{subject} is due at {due} {self.unit}"
            for step in self.plan.steps:
                if contains_term(step.operator, subject):
                    yield HardWindow(ORIGIN, self._start(step.id) + 1, None, due, says)

    def _visits(self) -> Iterator[HardWindow]:
        """Windows of measurements. They count from the start of the tour, which is such that the
        first measurement is as early in its window as it can be.
        """
        windows: Mapping[str, MeasurementWindow] = self.wishes.windows
        visits = measured_steps(self.problem, self.plan) if windows else {}
        if not visits:
            return
        first = min(visits, key=lambda step: self.starts[step])
        begin = windows.get(visits[first], (0, 0))[0]
        for step, name in visits.items():
            if name in windows and step != first:
                low, high = windows[name]
                says = f"{name} begins {low} to {high} {self.unit} after the tour"
                yield HardWindow(
                    self._start(first), self._start(step), low - begin, high - begin, says
                )
