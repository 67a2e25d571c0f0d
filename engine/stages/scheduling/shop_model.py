"""The constraint model of a shop and its devices: times, capacities, travel (CP-SAT)."""

import itertools
from collections import Counter
from dataclasses import dataclass, field
from itertools import pairwise

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

from cellwright.engine.model.shop_scheduling import (
    Changeover,
    Need,
    Resource,
    Shop,
    ShopDevice,
    StageMoment,
)
from cellwright.engine.stages.scheduling.makespan_bounds import service_batches, widen_hold
from cellwright.engine.stages.scheduling.shop_analysis import Lags, alike_jobs, has_shortcuts


@dataclass(frozen=True)
class ResourceWork:
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
class ShopModel:
    """A constraint model while it is built.

    `starts` are the start times of the stages; no time exceeds `horizon`.
    """

    shop: Shop
    lags: Lags
    horizon: int
    cp: CpModel = field(default_factory=CpModel)
    starts: dict[str, IntVar] = field(default_factory=dict)
    works: dict[str, list[ResourceWork]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.makespan = self.cp.new_int_var(0, self.horizon, "makespan")
        self.tardiness: LinearExprT = 0
        for name, stage in self.shop.stages.items():
            latest = self.horizon - stage.duration
            self.starts[name] = self.cp.new_int_var(
                min(self.lags.heads[name], latest), latest, name
            )
            self.cp.add(self.makespan >= self.starts[name] + self.lags.tails[name])

    def at(self, moment: StageMoment) -> LinearExpr:
        """The time of a moment."""
        return self.starts[moment.stage] + moment.offset

    def add_windows(self) -> None:
        """Add windows, the lags that follow from devices, and the order of jobs that are alike."""
        for window in self.shop.windows:
            if window.most is not None:
                self.cp.add(self.at(window.later) <= self.at(window.earlier) + window.most)
        for (earlier, later), lag in self.lags.direct.items():
            self.cp.add(self.starts[later] >= self.starts[earlier] + lag)
        for group in alike_jobs(self.shop):
            for first, second in itertools.pairwise(group):
                self.cp.add(self.starts[first.stages[0].name] <= self.starts[second.stages[0].name])

    def add_works(self) -> None:
        """Add what resources do for stages."""
        for stage in self.shop.stages.values():
            start = self.starts[stage.name]
            interval = self.cp.new_fixed_size_interval_var(start, stage.duration, stage.name)
            for name in stage.resources:
                places = stage.origin, stage.destination
                work = ResourceWork(
                    start, start + stage.duration, interval, *places, lasts=stage.duration > 0
                )
                self.works.setdefault(name, []).append(work)

    def add_resources(self) -> None:
        """Add capacities and travel. This comes last, when all works are known."""
        for resource in self.shop.resources:
            works = self.works.get(resource.name, [])
            taken = [work.interval for work in works if work.lasts]
            taken += [
                self._held(n, resource)
                for n, h in enumerate(self.shop.holds)
                if h.resource == resource.name
            ]
            if resource.capacity == 1:
                self.cp.add_no_overlap(taken)
            elif len(taken) > resource.capacity:
                self.cp.add_cumulative(taken, [1] * len(taken), resource.capacity)
            if resource.travel:
                self._add_travel(resource, works)

    def _held(self, number: int, resource: Resource) -> IntervalVar:
        hold = widen_hold(self.shop, self.shop.holds[number])
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
        return self.cp.new_optional_interval_var(
            self.at(hold.begin), size, self.at(hold.end), some, name
        )

    def _lasts(self, begin: StageMoment, end: StageMoment) -> bool:
        """Whether a hold can never be empty.

        An empty hold takes no unit, so it may lie within another hold.
        """
        return self.lags.span(begin.stage, end.stage) + end.offset > begin.offset

    def _add_travel(self, resource: Resource, works: list[ResourceWork]) -> None:
        """Between any two works there is time to travel.

        If a way through other work is shorter than the table says, the sequence of the works is
        modelled.
        """
        travel = dict(resource.travel)
        if has_shortcuts(self.shop, resource):
            self._add_sequence(resource, works)
            return
        for work in works:
            if lead := travel.get((resource.home, work.origin), 0):
                self._if_present(work.start >= lead, work)
        for first_work, second_work in itertools.combinations(works, 2):
            there = travel.get((first_work.destination, second_work.origin), 0)
            back = travel.get((second_work.destination, first_work.origin), 0)
            if not there and not back:
                continue
            if first_work.device and first_work.device == second_work.device:
                first, second = (
                    (first_work, second_work)
                    if first_work.period < second_work.period
                    else (second_work, first_work)
                )
                lead = travel.get((first.destination, second.origin), 0)
                if first.period != second.period and lead:
                    self._if_present(second.start >= first.end + lead, first_work, second_work)
                continue
            before = self.cp.new_bool_var("")
            self._if_present(
                second_work.start >= first_work.end + there, first_work, second_work, before
            )
            self._if_present(
                first_work.start >= second_work.end + back, first_work, second_work, ~before
            )

    def _if_present(
        self,
        constraint: BoundedLinearExpression | bool | np.bool,
        *conditions: ResourceWork | LiteralT,
    ) -> None:
        literals = [
            condition.present if isinstance(condition, ResourceWork) else condition
            for condition in conditions
        ]
        self.cp.add(constraint).only_enforce_if(
            [literal for literal in literals if literal is not None]
        )

    def _add_sequence(self, resource: Resource, works: list[ResourceWork]) -> None:
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
        for (n, first_work), (m, second_work) in itertools.permutations(enumerate(works, 1), 2):
            arc = self.cp.new_bool_var("")
            arcs.append((n, m, arc))
            lead = resource.travel.get((first_work.destination, second_work.origin), 0)
            self.cp.add(second_work.start >= first_work.end + lead).only_enforce_if(arc)
        self.cp.add_circuit(arcs)

    def _some(self, works: list[ResourceWork]) -> IntVar:
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


@dataclass(frozen=True)
class Period:
    """A time with one setting.

    `settings` has a literal for each possible setting. `changes` are the changes that may lead to
    this period, with their literals; the change starts at `changed`.
    """

    begin: IntVar
    end: IntVar
    present: IntVar
    settings: dict[str, IntVar]
    changes: tuple[tuple[Changeover, IntVar], ...]
    changed: IntVar | None


@dataclass(frozen=True)
class Periods:
    """The periods of one device and, for each need of a stage, the literals of the periods
    where it may fall.
    """

    device: ShopDevice
    periods: tuple[Period, ...]
    needs: tuple[tuple[str, Need, dict[int, IntVar]], ...]


def add_devices(model: ShopModel) -> tuple[Periods, ...]:
    """The periods of every device of the shop, tied to the stages that need them."""
    return tuple(_add_device(model, device) for device in model.shop.devices)


def _add_device(model: ShopModel, device: ShopDevice) -> Periods:
    wanted = [
        (stage.name, need)
        for stage in model.shop.stages.values()
        for need in stage.needs
        if need.device == device.name
    ]
    periods = [_initial_period(model, device)]
    for settings in _reachable_settings(device, wanted):
        periods.append(_next_period(model, device, periods[-1], settings, len(periods)))
    for first, second in pairwise(periods):
        model.cp.add_implication(second.present, first.present)
    needs = tuple((stage, need, _place_need(model, stage, need, periods)) for stage, need in wanted)
    _add_use(model, device, periods, [places for _, _, places in needs])
    _add_batches(model, device, len(periods), needs)
    return Periods(device, tuple(periods), needs)


def _initial_period(model: ShopModel, device: ShopDevice) -> Period:
    zero, one = model.cp.new_constant(0), model.cp.new_constant(1)
    end = model.cp.new_int_var(0, model.horizon, "")
    return Period(zero, end, one, {device.initial: one}, (), None)


def _reachable_settings(device: ShopDevice, wanted: list[tuple[str, Need]]) -> list[list[str]]:
    """For each period that can be useful, the settings that it may have.

    No setting comes twice in a row, and each is needed by some stage or is the final one.
    """
    counts = Counter(need.setting for _, need in wanted)
    useful = sorted(set(counts) | ({device.final} if device.final else set()))
    most = max(counts.values(), default=0)
    number = min(counts.total(), 2 * (counts.total() - most) + 1) + bool(device.final)
    settings: list[list[str]] = []
    before = {device.initial}
    for _ in range(number):
        before = {s for s in useful if any(b != s and device.change(b, s) for b in before)}
        if before:
            settings.append(sorted(before))
    return settings


def _next_period(
    model: ShopModel, device: ShopDevice, before: Period, settings: list[str], number: int
) -> Period:
    """The period after `before`, with the operator's work between them."""
    cp, horizon = model.cp, model.horizon
    begin, end, changed = (cp.new_int_var(0, horizon, "") for _ in range(3))
    present = cp.new_bool_var(f"{device.name} {number}")
    literals = {s: present if len(settings) == 1 else cp.new_bool_var("") for s in settings}
    cp.add(sum(literals.values()) == present)
    ways = [
        change
        for was in before.settings
        for will in settings
        if was != will and (change := device.change(was, will))
    ]
    changes = tuple((way, present if len(ways) == 1 else cp.new_bool_var("")) for way in ways)
    cp.add(sum(taken for _, taken in changes) == present)
    for change, taken in changes:
        cp.add_implication(taken, before.settings[change.before])
        cp.add_implication(taken, literals[change.after])
        _add_operator_work(model, device, change, taken, changed, number)
        cp.add(begin >= changed + change.duration).only_enforce_if(taken)
    cp.add(changed >= before.end).only_enforce_if(present)
    for variable in (begin, end, changed):
        cp.add(variable == horizon).only_enforce_if(~present)
    cp.add(end >= begin)
    return Period(begin, end, present, literals, changes, changed)


def _add_operator_work(
    model: ShopModel,
    device: ShopDevice,
    change: Changeover,
    taken: IntVar,
    start: IntVar,
    number: int,
) -> None:
    """Add what the operator does if it makes this change."""
    end = start + change.duration
    interval = model.cp.new_optional_fixed_size_interval_var(start, change.duration, taken, "")
    work = ResourceWork(
        start, end, interval, change.origin, change.destination, taken, device.name, number
    )
    model.works.setdefault(device.operator, []).append(work)
    model.cp.add(model.makespan >= end).only_enforce_if(taken)


def _place_need(
    model: ShopModel, stage: str, need: Need, periods: list[Period]
) -> dict[int, IntVar]:
    """The literals of the periods into which a need may fall; exactly one of them is true."""
    literals: dict[int, IntVar] = {}
    for number, period in enumerate(periods):
        if need.setting in period.settings:
            inside = model.cp.new_bool_var(f"{stage} in {number}")
            model.cp.add_implication(inside, period.settings[need.setting])
            model.cp.add(model.starts[stage] + need.begin >= period.begin).only_enforce_if(inside)
            model.cp.add(model.starts[stage] + need.end <= period.end).only_enforce_if(inside)
            literals[number] = inside
    model.cp.add_exactly_one(literals.values())
    return literals


def _add_use(
    model: ShopModel, device: ShopDevice, periods: list[Period], needs: list[dict[int, IntVar]]
) -> None:
    """Each period serves some stage or has the final setting.

    If the device has a final setting, the last period has it.
    """
    for number, period in enumerate(periods):
        absent = [~period.present] if number else []
        final = [period.settings[device.final]] if device.final in period.settings else []
        if number:
            used = [need[number] for need in needs if number in need]
            model.cp.add_bool_or([*used, *absent, *final])
        if device.final:
            following = [next_period.present for next_period in periods[number + 1 : number + 2]]
            model.cp.add_bool_or([*final, *following, *absent])


def _add_batches(
    model: ShopModel,
    device: ShopDevice,
    periods: int,
    needs: tuple[tuple[str, Need, dict[int, IntVar]], ...],
) -> None:
    """No period holds more stages of a batch than there are places.

    The other constraints imply this, but the solver does not see it.
    """
    for served in (batch for batch in service_batches(model.lags) if batch.device == device.name):
        members = {stage.name for stage in served.stages}
        for number in range(periods):
            inside = [
                places[number]
                for stage, need, places in needs
                if stage in members and need.setting == served.setting and number in places
            ]
            model.cp.add(sum(inside) <= served.most)
