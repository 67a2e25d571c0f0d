"""The schedule of a shop, and the timetable of a plan: when everything happens. Times are integers."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from cellwright.engine.model.outcome import GaveUp, Infeasible, Statistics
from cellwright.engine.model.shop import Changeover, Hold, Shop
from cellwright.engine.model.stays import Overstay
from cellwright.kb.model.plan import Plan, StepId


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
    """When each stage and each change of a device starts. No schedule is shorter than `lower_bound`.

    `tardiness` is the weighted sum of how late jobs end. Less tardiness is better than a shorter makespan.
    `proved` says that there is no better schedule. Only the order is promised; start times are a forecast. `units` names the
    unit that each hold has, where a plan has settled it.
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
class Scheduled:
    """A schedule that the independent checker accepts."""

    schedule: Schedule
    statistics: Statistics = field(default_factory=Statistics)


Timing = Scheduled | Infeasible | GaveUp


@dataclass(frozen=True, slots=True)
class Timetable:
    """A plan with the start of each step, and the schedule of the shop behind it.

    `shop` has a stage for each block of steps that serves an object, or for each step. `scope` says among what the
    makespan is the least, if that is proved. `note` says why steps are not scheduled as blocks, if they are not;
    `overstays` are things that stay too long in a place. `missed` are the measurements that begin outside their windows, each with
    when it begins after the start of the tour.
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
