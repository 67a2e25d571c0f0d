"""The checker of schedules: does a schedule keep all rules of its shop?

It replays start times and shares no code with the solver. Each rule is one function that yields what is
wrong, in plain words.
"""

import heapq
import itertools
from collections.abc import Iterator, Sequence

from cellwright.engine.model.schedule import Adjustment, Schedule
from cellwright.engine.model.shop import Device, Hold, Moment, Resource, Shop

Interval = tuple[int, int, str]  # from, to, name
Work = tuple[int, int, str, str, str]  # from, to, name, origin, destination


def check_schedule(shop: Shop, schedule: Schedule) -> tuple[str, ...]:
    """Everything that is wrong with a schedule; empty if it is valid."""
    missing = [name for name in shop.stages if name not in schedule.starts]
    if missing:
        return tuple(f"{name} is never started" for name in missing)
    rules = (_releases, _windows, _loads, _travels, _devices, _sums)
    return tuple(wrong for rule in rules for wrong in rule(shop, schedule))


def _releases(shop: Shop, schedule: Schedule) -> Iterator[str]:
    for job in shop.jobs:
        for stage in job.stages:
            start = schedule.starts[stage.name]
            if start < max(0, job.release):
                yield f"{stage.name} starts at {start}, before {job.name} is released at {job.release}"


def _at(schedule: Schedule, moment: Moment) -> int:
    return schedule.starts[moment.stage] + moment.offset


def _windows(shop: Shop, schedule: Schedule) -> Iterator[str]:
    for window in shop.windows:
        waited = _at(schedule, window.later) - _at(schedule, window.earlier)
        pair = f"{window.later.stage} comes {waited} after {window.earlier.stage}"
        if waited < window.least:
            yield f"{pair}, but at least {window.least} must pass"
        if window.most is not None and waited > window.most:
            yield f"{pair}, but at most {window.most} may pass"


def _loads(shop: Shop, schedule: Schedule) -> Iterator[str]:
    for resource in shop.resources:
        taken = sorted(_taken(shop, schedule, resource))
        yield from (
            f"the {name} ends at {end}, before it begins" for begin, end, name in taken if end < begin
        )
        yield from itertools.islice(_overfull(resource, taken), 1)


def _overfull(resource: Resource, taken: Sequence[Interval]) -> Iterator[str]:
    """The moments at which more is served than there are units; `taken` is in the order of time."""
    serving: list[tuple[int, str]] = []  # a heap by the end
    for moment, works in itertools.groupby(taken, key=lambda each: each[0]):
        while serving and serving[0][0] <= moment:
            heapq.heappop(serving)
        for begin, end, name in works:
            if begin < end:
                heapq.heappush(serving, (end, name))
        if len(serving) > resource.capacity:
            names = [name for begin, end, name in taken if begin <= moment < end]
            yield f"{resource.name} has capacity {resource.capacity}, but at {moment} it serves {', '.join(names)}"


def _taken(shop: Shop, schedule: Schedule, resource: Resource) -> Iterator[Interval]:
    for stage in shop.stages.values():
        if resource.name in stage.resources:
            start = schedule.starts[stage.name]
            yield start, start + stage.duration, stage.name
    for hold in shop.holds:
        if hold.resource == resource.name:
            yield _held(schedule, hold)
    for each in schedule.adjustments:
        if shop.device[each.device].operator == resource.name:
            yield each.start, each.start + each.change.duration, f"{each.device} to {each.change.after}"


def _held(schedule: Schedule, hold: Hold) -> Interval:
    begin = _at(schedule, hold.begin) if hold.begin else 0
    end = _at(schedule, hold.end) if hold.end else max(schedule.makespan, begin) + 1
    owner = hold.begin or hold.end
    return begin, end, f"hold of {owner.stage if owner else 'no stage'}"


def _travels(shop: Shop, schedule: Schedule) -> Iterator[str]:
    """Pairs of successive works between which a resource has too little time to travel."""
    for resource in (each for each in shop.resources if each.travel):
        works = sorted(_works(shop, schedule, resource))
        works.insert(0, (0, 0, "the start", resource.home, resource.home))
        for one, other in itertools.pairwise(works):
            needed = resource.travel.get((one[4], other[3]), 0)
            if other[0] - one[1] < needed:
                yield f"{resource.name} needs {needed} from {one[2]} to {other[2]}, but has {other[0] - one[1]}"


def _works(shop: Shop, schedule: Schedule, resource: Resource) -> Iterator[Work]:
    for stage in shop.stages.values():
        if resource.name in stage.resources:
            start = schedule.starts[stage.name]
            yield start, start + stage.duration, stage.name, stage.origin, stage.destination
    for each in schedule.adjustments:
        if shop.device[each.device].operator == resource.name:
            change = each.change
            end = each.start + change.duration
            yield each.start, end, f"{each.device} to {change.after}", change.origin, change.destination


def _devices(shop: Shop, schedule: Schedule) -> Iterator[str]:
    for device in shop.devices:
        changes = sorted((each for each in schedule.adjustments if each.device == device.name), key=_start)
        yield from _replayed(device, changes)
        for stage in shop.stages.values():
            for need in (each for each in stage.needs if each.device == device.name):
                start = schedule.starts[stage.name]
                begin, end = start + need.begin, start + need.end
                if not _stands(device, changes, need.setting, begin, end):
                    yield f"{stage.name} needs {device.name} {need.setting} from {begin} to {end}"


def _start(adjustment: Adjustment) -> tuple[int, int]:
    return adjustment.start, adjustment.start + adjustment.change.duration


def _replayed(device: Device, changes: list[Adjustment]) -> Iterator[str]:
    setting, ready = device.initial, 0
    for each in changes:
        if each.change not in device.changes:
            yield f"{device.name} cannot change from {each.change.before} to {each.change.after}"
        if each.change.before != setting or each.start < ready:
            yield f"{device.name} is not {each.change.before} at {each.start}"
        setting, ready = each.change.after, each.start + each.change.duration
    if device.final and setting != device.final:
        yield f"{device.name} is left {setting}, not {device.final}"


def _stands(device: Device, changes: list[Adjustment], setting: str, begin: int, end: int) -> bool:
    """Whether the device has the setting from `begin` to `end` without a break and is not changed meanwhile."""
    if any(each.start < end and each.start + each.change.duration > begin for each in changes):
        return False
    before = [each.change.after for each in changes if each.start + each.change.duration <= begin]
    return (before[-1] if before else device.initial) == setting


def _sums(shop: Shop, schedule: Schedule) -> Iterator[str]:
    ends = {name: schedule.starts[name] + stage.duration for name, stage in shop.stages.items()}
    last = max([*ends.values(), *(e.start + e.change.duration for e in schedule.adjustments)], default=0)
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
