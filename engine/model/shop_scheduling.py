"""The shop scheduling problem (jobs, stages, resources, devices) and its schedules."""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

from cellwright.engine.model.outcome import GaveUp, Infeasible, Statistics
from cellwright.engine.model.time_limits import Overstay
from cellwright.engine.model.window_breaches import OffHours, WindowBreach, WindowSpan
from cellwright.kb.model.plan_model import Plan, StepId


@dataclass(frozen=True, slots=True)
class Need:
    """A stage needs `device` at `setting` from `begin` to `end`.

    Both times count from the start of the stage.
    """

    device: str
    setting: str
    begin: int
    end: int


@dataclass(frozen=True, slots=True)
class ShopStage:
    """An activity of length `duration` without a break. It holds one unit of each of its resources.

    `origin` is where a travelling resource must be when the stage starts; `destination` is where it
    is at the end.
    """

    name: str
    duration: int
    resources: tuple[str, ...] = ()
    needs: tuple[Need, ...] = ()
    origin: str = ""
    destination: str = ""


@dataclass(frozen=True, slots=True)
class ShopJob:
    """Stages that belong together. Windows say in which order they come. No stage starts before
    `release`.

    If the job ends after `due`, each unit of time costs `priority`.
    """

    name: str
    stages: tuple[ShopStage, ...]
    release: int = 0
    due: int | None = None
    priority: int = 1


@dataclass(frozen=True, slots=True)
class StageMoment:
    """The time `offset` after the start of a stage."""

    stage: str
    offset: int = 0


@dataclass(frozen=True, slots=True)
class StageWindow:
    """`later` comes at least `least` and at most `most` after `earlier`.

    (A largest time is called dwell.)
    """

    earlier: StageMoment
    later: StageMoment
    least: int = 0
    most: int | None = None


@dataclass(frozen=True, slots=True)
class Hold:
    """One unit of `resource` is taken from `begin` to `end`, even between stages (blocking).

    `begin` None: from time 0; `end` None: for ever.
    """

    resource: str
    begin: StageMoment | None
    end: StageMoment | None


@dataclass(frozen=True, slots=True)
class Resource:
    """A resource with `capacity` equal units.

    If it travels (capacity 1), it takes `travel[from, to]` between two stages. `home` is where it
    is at the start. Pairs that are not named take no time. With kinds of work in place of places,
    travel is a sequence-dependent set-up.
    """

    name: str
    capacity: int = 1
    travel: Mapping[tuple[str, str], int] = field(default_factory=dict)
    home: str = ""
    units: tuple[str, ...] = ()  # names of the units, if they have names


@dataclass(frozen=True, slots=True)
class Changeover:
    """How a device gets from one setting to another.

    Its operator needs `duration`, and moves from `origin` to `destination`.
    """

    before: str
    after: str
    duration: int
    origin: str = ""
    destination: str = ""


@dataclass(frozen=True, slots=True)
class ShopDevice:
    """A device such as a door, a lid or a tool.

    It has one setting at a time; `operator` (a resource of capacity 1) changes it. `final` is the
    setting that it must have at the end; empty if any setting will do.
    """

    name: str
    operator: str
    initial: str
    changes: tuple[Changeover, ...]
    final: str = ""

    def change(self, before: str, after: str) -> Changeover | None:
        """The change from setting `before` to setting `after`, if there is one."""
        changes = [
            own_change
            for own_change in self.changes
            if (own_change.before, own_change.after) == (before, after)
        ]
        return changes[0] if changes else None


@dataclass(frozen=True)
class Shop:
    """A whole scheduling problem. Names of stages are unique among all jobs."""

    jobs: tuple[ShopJob, ...]
    resources: tuple[Resource, ...]
    windows: tuple[StageWindow, ...] = ()
    holds: tuple[Hold, ...] = ()
    devices: tuple[ShopDevice, ...] = ()

    @cached_property
    def stages(self) -> dict[str, ShopStage]:
        """Every stage by name, in the order of jobs."""
        return {stage.name: stage for job in self.jobs for stage in job.stages}

    @cached_property
    def owners(self) -> dict[str, ShopJob]:
        """The job of each stage."""
        return {stage.name: job for job in self.jobs for stage in job.stages}

    @cached_property
    def resource(self) -> dict[str, Resource]:
        """Every resource by name."""
        return {resource.name: resource for resource in self.resources}

    @cached_property
    def device(self) -> dict[str, ShopDevice]:
        """Every device by name."""
        return {device.name: device for device in self.devices}

    def end(self, stage: str) -> StageMoment:
        """The end of a stage."""
        return StageMoment(stage, self.stages[stage].duration)

    def after(
        self, earlier: str, later: str, least: int = 0, most: int | None = None
    ) -> StageWindow:
        """`later` starts at least `least` and at most `most` after the end of `earlier`."""
        return StageWindow(self.end(earlier), StageMoment(later), least, most)


def chain_windows(stages: tuple[ShopStage, ...]) -> tuple[StageWindow, ...]:
    """Each stage starts when the one before it has ended, or later."""
    return tuple(
        StageWindow(StageMoment(first.name, first.duration), StageMoment(second.name))
        for first, second in itertools.pairwise(stages)
    )


@dataclass(frozen=True, slots=True)
class Adjustment:
    """The operator of a device brings it from one setting to another."""

    device: str
    change: Changeover
    start: int

    @property
    def end(self) -> int:
        """When the adjustment is done."""
        return self.start + self.change.duration


@dataclass(frozen=True, slots=True)
class Schedule:
    """When each stage and each change of a device starts. No schedule is shorter than
    `lower_bound`.

    `tardiness` is the weighted sum of how late jobs end. Less tardiness is better than a shorter
    makespan. `proved` says that there is no better schedule. Only the order is promised; start
    times are a forecast. `units` names the unit that each hold has, where a plan has settled it.
    """

    starts: Mapping[str, int]
    adjustments: tuple[Adjustment, ...]
    makespan: int
    lower_bound: int
    tardiness: int = 0
    proved: bool = False
    units: Mapping[Hold, str] = field(default_factory=dict)

    @property
    def gap(self) -> float:
        """The difference between the makespan and its lower bound, as a share of the makespan."""
        return (self.makespan - self.lower_bound) / self.makespan if self.makespan else 0.0


@dataclass(frozen=True, slots=True)
class ValidSchedule:
    """A schedule that the independent checker accepts."""

    schedule: Schedule
    statistics: Statistics = field(default_factory=Statistics)


Timing = ValidSchedule | Infeasible | GaveUp


@dataclass(frozen=True, slots=True)
class Timetable:
    """A plan with the start of each step, and the schedule of the shop behind it.

    `shop` has a stage for each block of steps that serves an object, or for each step. `scope` says
    among what the makespan is the least, if that is proved. `note` says why steps are not scheduled
    as blocks, if they are not; `overstays` are things that stay too long in a place. No plan at all
    ends before `floor`, as far as that is known. `missed` are the measurements that begin outside
    their windows, each with when it begins after the start of the tour. `breaches` are windows
    between events that are not kept, `outside` steps that calendars do not allow at their time;
    `spans` are all windows with the times of their events.
    """

    plan: Plan
    starts: Mapping[StepId, int]
    shop: Shop
    schedule: Schedule
    scope: str
    note: str = ""
    overstays: tuple[Overstay, ...] = ()
    missed: Mapping[str, int] = field(default_factory=dict)
    statistics: Statistics = field(default_factory=Statistics)
    floor: int = 0
    breaches: tuple[WindowBreach, ...] = ()
    outside: tuple[OffHours, ...] = ()
    spans: tuple[WindowSpan, ...] = ()

    @property
    def keeps_hours(self) -> bool:
        """Whether it keeps every window that must be kept, and all calendars."""
        return not self.outside and not any(breach.window.is_hard for breach in self.breaches)

    @property
    def keeps_all(self) -> bool:
        """Whether it keeps all times that are asked for, also those that have a price."""
        return not (self.outside or self.breaches or self.overstays)
