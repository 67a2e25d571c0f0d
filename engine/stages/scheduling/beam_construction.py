"""A first schedule by beam search: partial schedules, their estimates and children."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice

from cellwright.engine.kernels.cancellation import Interrupted, never
from cellwright.engine.model.shop_scheduling import (
    Adjustment,
    Changeover,
    Need,
    Schedule,
    Shop,
    ShopStage,
)
from cellwright.engine.stages.scheduling.makespan_bounds import (
    Occupation,
    ServiceBatches,
    least_travel,
    resource_occupations,
    service_batches,
)
from cellwright.engine.stages.scheduling.shop_analysis import Lags, alike_jobs, first_needs


@dataclass(frozen=True, slots=True)
class DeviceStanding:
    """How a device stands: its setting, since when it has it, and until when some placed stage
    needs it.
    """

    setting: str
    since: int = 0
    until: int = 0


@dataclass(frozen=True, slots=True)
class PartialSchedule:
    """A schedule of some stages.

    `units` are the times from which each unit of a resource is free again.
    """

    starts: Mapping[str, int]
    units: Mapping[str, tuple[int, ...]]
    places: Mapping[str, str]
    devices: Mapping[str, DeviceStanding]
    adjustments: tuple[Adjustment, ...] = ()
    estimate: int = 0
    tardiness: int = 0

    @property
    def score(self) -> tuple[int, int, int]:
        """A sort key: the smaller, the better."""
        return self.tardiness, self.estimate, sum(self.starts.values())

    def travel(self, shop: Shop, resource: str, origin: str) -> int:
        """How long a resource takes from where it is to where it is needed."""
        if resource not in self.places:
            return 0
        return shop.resource[resource].travel.get((self.places[resource], origin), 0)


class Estimates:
    """Estimates for partial schedules of one shop.

    What it needs to know about the shop is looked up once.
    """

    def __init__(self, lags: Lags) -> None:
        self.lags, self.shop = lags, lags.shop
        single = [resource for resource in self.shop.resources if resource.capacity == 1]
        self.served = {
            resource.name: list(resource_occupations(lags, resource)) for resource in single
        }
        self.batches = service_batches(lags)
        self.least = {name: least_travel(lags, served) for name, served in self.served.items()}
        self.concerned = {stage.name: self._concerned(stage) for stage in self.shop.stages.values()}

    def after(self, partial: PartialSchedule, stage: ShopStage, start: int) -> PartialSchedule:
        """A partial schedule whose last stage was placed at a start, with its estimate and its
        tardiness.
        """
        estimate = max(partial.estimate, start + self.lags.tails[stage.name])
        for name in self.concerned[stage.name] if len(partial.starts) > 1 else self.served:
            estimate = max(estimate, self._remaining(partial, name, self.served[name]))
        for batch in self.batches:
            estimate = max(estimate, self._batched(partial, batch))
        job = self.shop.owners[stage.name]
        done = all(job_stage.name in partial.starts for job_stage in job.stages)
        late = 0
        if job.due is not None and done:
            end = max(
                partial.starts[job_stage.name] + job_stage.duration for job_stage in job.stages
            )
            late = job.priority * max(0, end - job.due)
        return replace(partial, estimate=estimate, tardiness=partial.tardiness + late)

    def _remaining(
        self, partial: PartialSchedule, resource: str, served: Sequence[Occupation]
    ) -> int:
        """When a resource can have done all its work, tail included.

        Work under way counts from its start.
        """
        now = max(partial.units[resource], default=0)
        waiting = [
            occupation for occupation in served if occupation.first.name not in partial.starts
        ]
        for served_occupation in served:
            if (
                served_occupation.first.name in partial.starts
                and served_occupation.last.name not in partial.starts
            ):
                now = max(
                    now, partial.starts[served_occupation.first.name] + served_occupation.size
                )
        if not waiting:
            return now
        least = self.least[resource]
        now = max(now, min(self._free(partial, occupation.first) for occupation in waiting))
        work = sum(occupation.size + least for occupation in waiting) - least
        return now + work + min(occupation.tail for occupation in waiting)

    def _batched(self, partial: PartialSchedule, served: ServiceBatches) -> int:
        """When all batches can be done, tail included.

        Objects that are inside may join a period under way.
        """
        pairs = zip(served.stages, served.entries, strict=True)
        waiting = [
            (stage, entry in partial.starts)
            for stage, entry in pairs
            if stage.name not in partial.starts
        ]
        standing = partial.devices[served.device]
        joining = standing.setting == served.setting and standing.until > standing.since
        left = [(stage, inside) for stage, inside in waiting if not (joining and inside)]
        if not left:
            return 0
        tail = min(self.lags.tails[stage.name] - stage.duration for stage, _ in left)
        now = max(standing.until, min(self.lags.heads[stage.name] for stage, _ in left))
        come = sum(inside for _, inside in left)
        gap = served.away + (served.entry if come == 0 else 0) if joining else 0
        return now + gap + served.least([stage.duration for stage, _ in left], come) + tail

    def _concerned(self, stage: ShopStage) -> list[str]:
        """The resources whose remaining work may end later once a stage is placed; that of the
        others stays as it was.
        """
        touched = set(stage.resources) | {
            self.shop.device[need.device].operator for need in stage.needs
        }
        for hold in self.shop.holds:
            if any(event and event.stage == stage.name for event in (hold.begin, hold.end)):
                touched.add(hold.resource)
        return [
            name
            for name, served in self.served.items()
            if name in touched
            or any(
                stage in (occupation.first, occupation.last)
                or touched & set(occupation.first.resources)
                for occupation in served
            )
        ]

    def _free(self, partial: PartialSchedule, stage: ShopStage) -> int:
        """When a stage's resources are free and at its origin; 0 for one that is taken for an
        unknown time.
        """
        times = [
            partial.units[name][0] + partial.travel(self.shop, name, stage.origin)
            if partial.units[name]
            else 0
            for name in stage.resources
        ]
        return max(times, default=0)


BEAM_WIDTHS = (1, 6, 30, 150)  # of the beam; tried in this order until the lower bound is reached
MAX_PARTIAL_SCHEDULES = 8_000  # about how many partial schedules one beam may make


def construct_schedule(lags: Lags, bound: int, interrupted: Interrupted = never) -> Schedule | None:
    """The best of the schedules that some beams find, without further search.

    None if all beams get stuck. Once it is `interrupted`, it ends soon.
    """
    builder = ScheduleBuilder(lags)
    best: Schedule | None = None
    for width in BEAM_WIDTHS:
        if width > 1 and width * len(lags.shop.stages) * builder.kinds > MAX_PARTIAL_SCHEDULES:
            break
        schedule_found = builder.beam(width, interrupted)
        if schedule_found is None and width > 1 and best is None:
            break
        if schedule_found is not None and (
            best is None or _schedule_value(schedule_found) < _schedule_value(best)
        ):
            best = schedule_found
        if best is not None and best.makespan == bound and not best.tardiness:
            break
    return best and replace(
        best, lower_bound=bound, proved=best.makespan == bound and not best.tardiness
    )


def _schedule_value(schedule: Schedule) -> tuple[int, int]:
    return schedule.tardiness, schedule.makespan


class ScheduleBuilder:
    """Places stages one after another. What this needs to know about the shop is looked up once."""

    def __init__(self, lags: Lags) -> None:
        self.lags, self.shop = lags, lags.shop
        self.before: dict[str, list[tuple[str, int]]] = {name: [] for name in self.shop.stages}
        self.after: dict[str, list[tuple[str, int]]] = {name: [] for name in self.shop.stages}
        for (earlier, later), lag in lags.direct.items():
            self.before[later].append((earlier, lag))
            self.after[earlier].append((later, lag))
        self.queue = [[job.stages[0].name for job in group] for group in alike_jobs(self.shop)]
        self.kinds = len(self.shop.jobs) - sum(len(queue) - 1 for queue in self.queue)
        self.estimates = Estimates(lags)

    def beam(self, width: int, interrupted: Interrupted = never) -> Schedule | None:
        """The best complete schedule of a beam of partial schedules; None if the beam gets stuck.

        Once it is `interrupted`, a beam of one takes what comes first, and a wider one is given up.
        """
        kept = [self._empty()]
        for _ in self.shop.stages:
            if interrupted():
                kept = (
                    [child for partial in kept for child in self._first_child(partial)]
                    if width == 1
                    else []
                )
                continue
            children = [child for partial in kept for child in self._children(partial)]
            kept = sorted(children, key=lambda partial: partial.score)[:width]
        return self._finish(kept[0]) if kept else None

    def _empty(self) -> PartialSchedule:
        units = {resource.name: (0,) * resource.capacity for resource in self.shop.resources}
        for hold in self.shop.holds:
            if hold.begin is None:
                units[hold.resource] = units[hold.resource][1:]
        places = {
            resource.name: resource.home for resource in self.shop.resources if resource.travel
        }
        devices = {device.name: DeviceStanding(device.initial) for device in self.shop.devices}
        return PartialSchedule({}, units, places, devices)

    def _children(self, partial: PartialSchedule) -> list[PartialSchedule]:
        """The partial schedules with one more stage, which starts before another one could have
        ended.

        Giffler & Thompson 1960. Of jobs that are alike, only the first one not yet begun may begin.
        """
        children = [
            (child.starts[stage.name], child.starts[stage.name] + stage.duration, child)
            for stage in self._ready(partial)
            if (child := self._placed(partial, stage)) is not None
        ]
        soonest = min((end for _, end, _ in children), default=0)
        return [child for start, end, child in children if start < soonest or end == soonest]

    def _first_child(self, partial: PartialSchedule) -> list[PartialSchedule]:
        """The partial schedule with the first stage that can be placed; nothing if none can."""
        ready = sorted(self._ready(partial), key=lambda stage: self.lags.heads[stage.name])
        placed = (self._placed(partial, stage, estimated=False) for stage in ready)
        return list(islice((child for child in placed if child is not None), 1))

    def _ready(self, partial: PartialSchedule) -> Iterator[ShopStage]:
        """The stages that may be placed next: what must come before them is placed."""
        waiting = {
            queued
            for queue in self.queue
            for queued in [n for n in queue if n not in partial.starts][1:]
        }
        for name, stage in self.shop.stages.items():
            if (
                name not in partial.starts
                and name not in waiting
                and all(earlier in partial.starts or lag < 0 for earlier, lag in self.before[name])
            ):
                yield stage

    def _placed(
        self, partial: PartialSchedule, stage: ShopStage, estimated: bool = True
    ) -> PartialSchedule | None:
        """The partial schedule with one more stage, as early as possible; None if the stage
        cannot come now.
        """
        changed = self._changed(partial, stage)
        if changed is None:
            return None
        start = self._earliest(changed, stage)
        if start is None or not self._in_time(partial, stage.name, start):
            return None
        devices = dict(changed.devices)
        for need in stage.needs:
            standing = devices[need.device]
            devices[need.device] = replace(standing, until=max(standing.until, start + need.end))
        places = dict(changed.places)
        places.update({name: stage.destination for name in stage.resources if name in places})
        made = replace(
            changed,
            starts={**partial.starts, stage.name: start},
            units=self._taken(changed, stage, start),
            places=places,
            devices=devices,
        )
        return self.estimates.after(made, stage, start) if estimated else made

    def _changed(self, partial: PartialSchedule, stage: ShopStage) -> PartialSchedule | None:
        """The partial schedule after a stage's device changes, in order of their begins; None
        if impossible.
        """
        for _ in stage.needs:
            wanted = [
                (self._change_start(partial, change, need), need.device, change)
                for need in first_needs(stage).values()
                if partial.devices[need.device].setting != need.setting
                for change in [self._change(partial, need)]
                if change is not None
            ]
            if not wanted:
                break
            start, name, change = min(
                wanted, key=lambda possible_change: (possible_change[0], possible_change[1])
            )
            partial = self._adjusted(partial, name, change, start)
        fits = all(partial.devices[need.device].setting == need.setting for need in stage.needs)
        return partial if fits else None

    def _change(self, partial: PartialSchedule, need: Need) -> Changeover | None:
        return self.shop.device[need.device].change(
            partial.devices[need.device].setting, need.setting
        )

    def _change_start(self, partial: PartialSchedule, change: Changeover, need: Need) -> int:
        operator = self.shop.device[need.device].operator
        free = partial.units[operator][0] + partial.travel(self.shop, operator, change.origin)
        return max(free, partial.devices[need.device].until)

    def _adjusted(
        self, partial: PartialSchedule, name: str, change: Changeover, start: int
    ) -> PartialSchedule:
        operator, end = self.shop.device[name].operator, start + change.duration
        places = (
            {**partial.places, operator: change.destination}
            if operator in partial.places
            else partial.places
        )
        return replace(
            partial,
            units={**partial.units, operator: (end,)},
            places=places,
            devices={**partial.devices, name: DeviceStanding(change.after, end, end)},
            adjustments=(*partial.adjustments, Adjustment(name, change, start)),
        )

    def _earliest(self, partial: PartialSchedule, stage: ShopStage) -> int | None:
        """When a stage can start if its devices stay as they are; None if a resource is never
        free again.
        """
        times = [self.lags.heads[stage.name]]
        times += [
            partial.starts[e] + lag for e, lag in self.before[stage.name] if e in partial.starts
        ]
        times += [partial.devices[need.device].since - need.begin for need in stage.needs]
        for name in stage.resources:
            if not partial.units[name]:
                return None
            times.append(partial.units[name][0] + partial.travel(self.shop, name, stage.origin))
        for hold in self.shop.holds:
            if hold.begin and hold.begin.stage == stage.name:
                if not partial.units[hold.resource]:
                    return None
                times.append(partial.units[hold.resource][0] - hold.begin.offset)
        return max(times)

    def _in_time(self, partial: PartialSchedule, name: str, start: int) -> bool:
        """Whether a start keeps the lags to the later stages that are placed already."""
        later = self.after[name]
        return all(
            partial.starts[later_stage] >= start + lag
            for later_stage, lag in later
            if later_stage in partial.starts
        )

    def _taken(
        self, partial: PartialSchedule, stage: ShopStage, start: int
    ) -> dict[str, tuple[int, ...]]:
        """When the units are free after a stage: it takes its resources, begins some holds, and
        ends others.
        """
        units = dict(partial.units)
        for name in stage.resources:
            units[name] = tuple(sorted((*units[name][1:], start + stage.duration)))
        for hold in self.shop.holds:
            if hold.begin and hold.begin.stage == stage.name:
                units[hold.resource] = units[hold.resource][1:]
            if hold.end and hold.end.stage == stage.name:
                units[hold.resource] = tuple(
                    sorted((*units[hold.resource], start + hold.end.offset))
                )
        return units

    def _finish(self, partial: PartialSchedule) -> Schedule | None:
        """The whole schedule, with each device changed to its final setting; None if a device
        cannot be.
        """
        for device in self.shop.devices:
            standing = partial.devices[device.name]
            if device.final and standing.setting != device.final:
                change = device.change(standing.setting, device.final)
                if change is None:
                    return None
                need = Need(device.name, device.final, 0, 0)
                start = self._change_start(partial, change, need)
                partial = self._adjusted(partial, device.name, change, start)
        ends = [partial.starts[name] + stage.duration for name, stage in self.shop.stages.items()]
        makespan = max([0, *ends, *(adjustment.end for adjustment in partial.adjustments)])
        return Schedule(dict(partial.starts), partial.adjustments, makespan, 0, partial.tardiness)


__all__ = ["ScheduleBuilder", "construct_schedule"]
