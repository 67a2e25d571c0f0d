"""The checker of schedules: whether a schedule keeps all rules of its shop.

It replays start times and shares no code with the solver. Each rule is one function that yields
what is wrong, in plain words.
"""

import heapq
import itertools
from collections.abc import Iterator, Sequence

from cellwright.engine.model.shop_scheduling import (
    Adjustment,
    Hold,
    Resource,
    Schedule,
    Shop,
    ShopDevice,
    StageMoment,
)

Interval = tuple[int, int, str]  # from, to, name
PlacedWork = tuple[int, int, str, str, str]  # from, to, name, origin, destination


def check_schedule(shop: Shop, schedule: Schedule) -> tuple[str, ...]:
    """Everything that is wrong with a schedule; empty if it is valid."""
    missing = [name for name in shop.stages if name not in schedule.starts]
    if missing:
        return tuple(f"{name} is never started" for name in missing)
    rules = (
        _check_releases,
        _check_windows,
        _check_loads,
        _check_travels,
        _check_devices,
        _check_sums,
    )
    return tuple(wrong for rule in rules for wrong in rule(shop, schedule))


def _check_releases(shop: Shop, schedule: Schedule) -> Iterator[str]:
    for job in shop.jobs:
        for stage in job.stages:
            start = schedule.starts[stage.name]
            if start < max(0, job.release):
                yield (
                    f"{stage.name} starts at {start}, before {job.name} is released at "
                    f"{job.release}"
                )


def _moment_time(schedule: Schedule, moment: StageMoment) -> int:
    return schedule.starts[moment.stage] + moment.offset


def _check_windows(shop: Shop, schedule: Schedule) -> Iterator[str]:
    for window in shop.windows:
        waited = _moment_time(schedule, window.later) - _moment_time(schedule, window.earlier)
        pair = f"{window.later.stage} comes {waited} after {window.earlier.stage}"
        if waited < window.least:
            yield f"{pair}, but at least {window.least} must pass"
        if window.most is not None and waited > window.most:
            yield f"{pair}, but at most {window.most} may pass"


def _check_loads(shop: Shop, schedule: Schedule) -> Iterator[str]:
    for resource in shop.resources:
        taken = sorted(_taken_intervals(shop, schedule, resource))
        yield from (
            f"the {name} ends at {end}, before it begins"
            for begin, end, name in taken
            if end < begin
        )
        yield from itertools.islice(_overfull_moments(resource, taken), 1)


def _overfull_moments(resource: Resource, taken: Sequence[Interval]) -> Iterator[str]:
    """The moments at which more is served than there are units; `taken` is in the order of time."""
    serving: list[tuple[int, str]] = []  # a heap by the end
    for moment, works in itertools.groupby(taken, key=lambda interval: interval[0]):
        while serving and serving[0][0] <= moment:
            heapq.heappop(serving)
        for begin, end, name in works:
            if begin < end:
                heapq.heappush(serving, (end, name))
        if len(serving) > resource.capacity:
            names = [name for begin, end, name in taken if begin <= moment < end]
            yield (
                f"{resource.name} has capacity {resource.capacity}, but at {moment} it serves "
                f"{', '.join(names)}"
            )


def _taken_intervals(shop: Shop, schedule: Schedule, resource: Resource) -> Iterator[Interval]:
    for stage in shop.stages.values():
        if resource.name in stage.resources:
            start = schedule.starts[stage.name]
            yield start, start + stage.duration, stage.name
    for hold in shop.holds:
        if hold.resource == resource.name:
            yield _hold_interval(schedule, hold)
    for adjustment in schedule.adjustments:
        if shop.device[adjustment.device].operator == resource.name:
            yield (
                adjustment.start,
                adjustment.start + adjustment.change.duration,
                f"{adjustment.device} to {adjustment.change.after}",
            )


def _hold_interval(schedule: Schedule, hold: Hold) -> Interval:
    begin = _moment_time(schedule, hold.begin) if hold.begin else 0
    end = _moment_time(schedule, hold.end) if hold.end else max(schedule.makespan, begin) + 1
    owner = hold.begin or hold.end
    return begin, end, f"hold of {owner.stage if owner else 'no stage'}"


def _check_travels(shop: Shop, schedule: Schedule) -> Iterator[str]:
    """Pairs of successive works between which a resource has too little time to travel."""
    for resource in (travelling for travelling in shop.resources if travelling.travel):
        works = sorted(_resource_works(shop, schedule, resource))
        works.insert(0, (0, 0, "the start", resource.home, resource.home))
        for first, second in itertools.pairwise(works):
            needed = resource.travel.get((first[4], second[3]), 0)
            if second[0] - first[1] < needed:
                yield (
                    f"{resource.name} needs {needed} from {first[2]} to {second[2]}, but has "
                    f"{second[0] - first[1]}"
                )


def _resource_works(shop: Shop, schedule: Schedule, resource: Resource) -> Iterator[PlacedWork]:
    for stage in shop.stages.values():
        if resource.name in stage.resources:
            start = schedule.starts[stage.name]
            yield start, start + stage.duration, stage.name, stage.origin, stage.destination
    for adjustment in schedule.adjustments:
        if shop.device[adjustment.device].operator == resource.name:
            change = adjustment.change
            end = adjustment.start + change.duration
            yield (
                adjustment.start,
                end,
                f"{adjustment.device} to {change.after}",
                change.origin,
                change.destination,
            )


def _check_devices(shop: Shop, schedule: Schedule) -> Iterator[str]:
    for device in shop.devices:
        changes = sorted(
            (adjustment for adjustment in schedule.adjustments if adjustment.device == device.name),
            key=_adjustment_start,
        )
        yield from _replay_changes(device, changes)
        for stage in shop.stages.values():
            for need in (
                stage_need for stage_need in stage.needs if stage_need.device == device.name
            ):
                start = schedule.starts[stage.name]
                begin, end = start + need.begin, start + need.end
                if not _keeps_setting(device, changes, need.setting, begin, end):
                    yield f"{stage.name} needs {device.name} {need.setting} from {begin} to {end}"


def _adjustment_start(adjustment: Adjustment) -> tuple[int, int]:
    return adjustment.start, adjustment.start + adjustment.change.duration


def _replay_changes(device: ShopDevice, changes: list[Adjustment]) -> Iterator[str]:
    setting, ready = device.initial, 0
    for change in changes:
        if change.change not in device.changes:
            yield (
                f"{device.name} cannot change from {change.change.before} to {change.change.after}"
            )
        if change.change.before != setting or change.start < ready:
            yield f"{device.name} is not {change.change.before} at {change.start}"
        setting, ready = change.change.after, change.start + change.change.duration
    if device.final and setting != device.final:
        yield f"{device.name} is left {setting}, not {device.final}"


def _keeps_setting(
    device: ShopDevice, changes: list[Adjustment], setting: str, begin: int, end: int
) -> bool:
    """Whether the device has the setting from `begin` to `end` without a break and is not
    changed meanwhile.
    """
    if any(
        change.start < end and change.start + change.change.duration > begin for change in changes
    ):
        return False
    before = [
        change.change.after for change in changes if change.start + change.change.duration <= begin
    ]
    return (before[-1] if before else device.initial) == setting


def _check_sums(shop: Shop, schedule: Schedule) -> Iterator[str]:
    ends = {name: schedule.starts[name] + stage.duration for name, stage in shop.stages.items()}
    last = max(
        [*ends.values(), *(e.start + e.change.duration for e in schedule.adjustments)], default=0
    )
    if schedule.makespan != last:
        yield f"the makespan is {last}, not {schedule.makespan}"
    late = 0
    for job in shop.jobs:
        if job.due is not None and job.stages:
            late += job.priority * max(0, max(ends[stage.name] for stage in job.stages) - job.due)
    if schedule.tardiness != late:
        yield f"the tardiness is {late}, not {schedule.tardiness}"
    if schedule.lower_bound > schedule.makespan:
        yield f"the lower bound {schedule.lower_bound} is above the makespan {schedule.makespan}"
