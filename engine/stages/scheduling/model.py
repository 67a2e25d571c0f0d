"""The constraint model of a shop: start times, windows, capacities, holds, travel, and the objective (CP-SAT)."""

import itertools
from dataclasses import dataclass, field

import numpy as np
from ortools.sat.python.cp_model import (
    BoundedLinearExpression,
    CpModel,
    IntervalVar,
    IntVar,
    LinearExpr,
    LinearExprT,
    LiteralT,
)

from cellwright.engine.model.shop import Moment, Resource, Shop
from cellwright.engine.stages.scheduling.bounds import widened
from cellwright.engine.stages.scheduling.lags import Lags
from cellwright.engine.stages.scheduling.symmetry import alike
from cellwright.engine.stages.scheduling.travel import has_shortcuts


@dataclass(frozen=True)
class Work:
    """A piece of work of a resource: its interval, and where it begins and ends.

    It is done if `present` is true or None.
    """

    start: LinearExprT
    end: LinearExprT
    interval: IntervalVar
    origin: str = ""
    destination: str = ""
    present: IntVar | None = None
    device: str = ""
    period: int = 0
    lasts: bool = True  # work that takes no time takes no unit


@dataclass
class Model:
    """A constraint model while it is built.

    `starts` are the start times of the stages; no time exceeds `horizon`.
    """

    shop: Shop
    lags: Lags
    horizon: int
    cp: CpModel = field(default_factory=CpModel)
    starts: dict[str, IntVar] = field(default_factory=dict)
    works: dict[str, list[Work]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.makespan = self.cp.new_int_var(0, self.horizon, "makespan")
        self.tardiness: LinearExprT = 0
        for name, stage in self.shop.stages.items():
            latest = self.horizon - stage.duration
            self.starts[name] = self.cp.new_int_var(min(self.lags.heads[name], latest), latest, name)
            self.cp.add(self.makespan >= self.starts[name] + self.lags.tails[name])

    def at(self, moment: Moment) -> LinearExpr:
        """The time of a moment."""
        return self.starts[moment.stage] + moment.offset

    def add_windows(self) -> None:
        """Add windows, the lags that follow from devices, and the order of jobs that are alike."""
        for window in self.shop.windows:
            if window.most is not None:
                self.cp.add(self.at(window.later) <= self.at(window.earlier) + window.most)
        for (one, other), lag in self.lags.direct.items():
            self.cp.add(self.starts[other] >= self.starts[one] + lag)
        for group in alike(self.shop):
            for first, second in itertools.pairwise(group):
                self.cp.add(self.starts[first.stages[0].name] <= self.starts[second.stages[0].name])

    def add_works(self) -> None:
        """Add what resources do for stages."""
        for stage in self.shop.stages.values():
            start = self.starts[stage.name]
            interval = self.cp.new_fixed_size_interval_var(start, stage.duration, stage.name)
            for name in stage.resources:
                places = stage.origin, stage.destination
                work = Work(start, start + stage.duration, interval, *places, lasts=stage.duration > 0)
                self.works.setdefault(name, []).append(work)

    def add_resources(self) -> None:
        """Add capacities and travel. This comes last, when all works are known."""
        for resource in self.shop.resources:
            works = self.works.get(resource.name, [])
            taken = [work.interval for work in works if work.lasts]
            taken += [
                self._held(n, resource) for n, h in enumerate(self.shop.holds) if h.resource == resource.name
            ]
            if resource.capacity == 1:
                self.cp.add_no_overlap(taken)
            elif len(taken) > resource.capacity:
                self.cp.add_cumulative(taken, [1] * len(taken), resource.capacity)
            if resource.travel:
                self._add_travel(resource, works)

    def _held(self, number: int, resource: Resource) -> IntervalVar:
        hold = widened(self.shop, self.shop.holds[number])
        name = f"hold {number} of {resource.name}"
        size = self.cp.new_int_var(0, self.horizon, f"size of {name}")
        if hold.begin is None or hold.end is None or self._lasts(hold.begin, hold.end):
            begin = self.at(hold.begin) if hold.begin else 0
            end = self.at(hold.end) if hold.end else self.horizon
            return self.cp.new_interval_var(begin, size, end, name)
        some = self.cp.new_bool_var("")
        self.cp.add(self.at(hold.begin) + size == self.at(hold.end))
        self.cp.add(size >= 1).only_enforce_if(some)
        self.cp.add(size == 0).only_enforce_if(~some)
        return self.cp.new_optional_interval_var(self.at(hold.begin), size, self.at(hold.end), some, name)

    def _lasts(self, begin: Moment, end: Moment) -> bool:
        """Whether a hold can never be empty.

        An empty hold takes no unit, so it may lie within another hold.
        """
        return self.lags.span(begin.stage, end.stage) + end.offset > begin.offset

    def _add_travel(self, resource: Resource, works: list[Work]) -> None:
        """Between any two works there is time to travel.

        If a way through other work is shorter than the table says, the sequence of the works is modelled.
        """
        travel = dict(resource.travel)
        if has_shortcuts(self.shop, resource):
            self._add_sequence(resource, works)
            return
        for work in works:
            if lead := travel.get((resource.home, work.origin), 0):
                self._if_present(work.start >= lead, work)
        for one, other in itertools.combinations(works, 2):
            there = travel.get((one.destination, other.origin), 0)
            back = travel.get((other.destination, one.origin), 0)
            if not there and not back:
                continue
            if one.device and one.device == other.device:
                first, second = (one, other) if one.period < other.period else (other, one)
                lead = travel.get((first.destination, second.origin), 0)
                if first.period != second.period and lead:
                    self._if_present(second.start >= first.end + lead, one, other)
                continue
            before = self.cp.new_bool_var("")
            self._if_present(other.start >= one.end + there, one, other, before)
            self._if_present(one.start >= other.end + back, one, other, ~before)

    def _if_present(
        self, constraint: BoundedLinearExpression | bool | np.bool, *conditions: Work | LiteralT
    ) -> None:
        literals = [each.present if isinstance(each, Work) else each for each in conditions]
        self.cp.add(constraint).only_enforce_if([each for each in literals if each is not None])

    def _add_sequence(self, resource: Resource, works: list[Work]) -> None:
        """One route through all works that are present.

        Node 0 is the start and the end; works count from 1.
        """
        arcs: list[tuple[int, int, LiteralT]] = [(0, 0, ~self._some(works))]
        for n, work in enumerate(works, 1):
            first = self.cp.new_bool_var("")
            lead = resource.travel.get((resource.home, work.origin), 0)
            self.cp.add(work.start >= lead).only_enforce_if(first)
            arcs += [(0, n, first), (n, 0, self.cp.new_bool_var(""))]
            if work.present is not None:
                arcs.append((n, n, ~work.present))
        for (n, one), (m, other) in itertools.permutations(enumerate(works, 1), 2):
            arc = self.cp.new_bool_var("")
            arcs.append((n, m, arc))
            lead = resource.travel.get((one.destination, other.origin), 0)
            self.cp.add(other.start >= one.end + lead).only_enforce_if(arc)
        self.cp.add_circuit(arcs)

    def _some(self, works: list[Work]) -> IntVar:
        """A literal that says whether any work is present."""
        some = self.cp.new_bool_var("")
        present = [work.present for work in works if work.present is not None]
        if len(present) < len(works) or not works:
            self.cp.add(some == (1 if works else 0))
        else:
            self.cp.add_max_equality(some, present)
        return some

    def add_objective(self, bound: int) -> None:
        """Tardiness comes first, then the makespan, which is at least `bound`."""
        self.cp.add(self.makespan >= bound)
        late = [
            job.priority * self._lateness(job.name, job.due, [stage.name for stage in job.stages])
            for job in self.shop.jobs
            if job.due is not None and job.stages
        ]
        self.tardiness = sum(late)
        self.cp.minimize((self.horizon + 1) * self.tardiness + self.makespan)

    def _lateness(self, name: str, due: int, stages: list[str]) -> IntVar:
        late = self.cp.new_int_var(0, self.horizon, f"lateness of {name}")
        for stage in stages:
            self.cp.add(late >= self.starts[stage] + self.shop.stages[stage].duration - due)
        return late
