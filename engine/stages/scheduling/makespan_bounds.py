"""Lower bounds of the makespan: longest paths, resource work, and batches.

The work of a resource is a one-machine problem with heads and tails, solved with preemption
(Jackson's schedule; Carlier 1982). A place may be filled during one stage and emptied during
another, always by the same arm. Then it is taken from the start of the first stage to the end of
the second, because the arm does one thing at a time.
"""

import heapq
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from cellwright.engine.model.shop_scheduling import (
    Hold,
    Need,
    Resource,
    Shop,
    ShopStage,
    StageMoment,
)
from cellwright.engine.stages.scheduling.shop_analysis import NO_LAG, Lags, first_needs, last_needs


@dataclass(frozen=True, slots=True)
class Occupation:
    """A unit of a resource is taken for at least `size`, not before `head`; at least `tail`
    follows.

    `first` and `last` are the stages during which the occupation begins and ends.
    """

    first: ShopStage
    last: ShopStage
    head: int
    size: int
    tail: int


def makespan_lower_bound(lags: Lags) -> int:
    """No schedule of the shop ends before this.

    Raises `CircularLags` if there is no schedule at all.
    """
    paths = [lags.heads[name] + lags.tails[name] for name in lags.shop.stages]
    served = [resource_bound(lags, resource) for resource in lags.shop.resources]
    return max([0, *paths, *served])


def resource_bound(lags: Lags, resource: Resource) -> int:
    """The lower bound that follows from the work of one resource."""
    taken = list(resource_occupations(lags, resource))
    if not taken:
        return 0
    if resource.capacity == 1:
        least = least_travel(lags, taken)
        return jackson_bound(
            [
                (occupation.head, occupation.size + least, occupation.tail - least)
                for occupation in taken
            ]
        )
    work = sum(occupation.size for occupation in taken)
    return (
        min(occupation.head for occupation in taken)
        - -work // resource.capacity
        + min(occupation.tail for occupation in taken)
    )


def jackson_bound(works: Sequence[tuple[int, int, int]]) -> int:
    """The end of the preemptive schedule of works (head, size, tail) that always serves the
    longest tail.
    """
    waiting = sorted(works)
    ready: list[tuple[int, int]] = []  # (-tail, size that is left)
    now = end = place = 0
    while place < len(waiting) or ready:
        if not ready:
            now = max(now, waiting[place][0])
        while place < len(waiting) and waiting[place][0] <= now:
            heapq.heappush(ready, (-waiting[place][2], waiting[place][1]))
            place += 1
        tail, left = heapq.heappop(ready)
        served = min(left, waiting[place][0] - now) if place < len(waiting) else left
        now += served
        if served < left:
            heapq.heappush(ready, (tail, left - served))
        else:
            end = max(end, now - tail)
    return end


def least_travel(lags: Lags, taken: Sequence[Occupation]) -> int:
    """The least empty travel from the end of one occupation to the start of another."""
    pairs = (
        (earlier.last, later.first) for earlier in taken for later in taken if earlier is not later
    )
    return min((_travel_between(lags, last, first) for last, first in pairs), default=0)


def _travel_between(lags: Lags, earlier: ShopStage, later: ShopStage) -> int:
    """The least time in which a resource of both stages goes from the end of one to the start
    of the other.
    """
    shared = set(earlier.resources) & set(later.resources)
    pair = earlier.destination, later.origin
    return max((lags.travel[name].get(pair, 0) for name in shared), default=0)


def resource_occupations(lags: Lags, resource: Resource) -> Iterator[Occupation]:
    """Everything that takes a unit of a resource: stages and holds.

    Holds without begin or end are left out.
    """
    shop = lags.shop
    for stage in shop.stages.values():
        if resource.name in stage.resources:
            tail = lags.tails[stage.name] - stage.duration
            yield Occupation(stage, stage, lags.heads[stage.name], stage.duration, tail)
    for hold in (
        widen_hold(shop, shop_hold)
        for shop_hold in shop.holds
        if shop_hold.resource == resource.name
    ):
        if hold.begin is None or hold.end is None:
            continue
        span = lags.span(hold.begin.stage, hold.end.stage)
        if span > NO_LAG:
            first, last = shop.stages[hold.begin.stage], shop.stages[hold.end.stage]
            size = max(0, span + hold.end.offset - hold.begin.offset)
            head = lags.heads[first.name] + hold.begin.offset
            yield Occupation(first, last, head, size, lags.tails[last.name] - hold.end.offset)


def widen_hold(shop: Shop, hold: Hold) -> Hold:
    """The hold from the start of its first stage to the end of its last one, if this is
    equivalent.
    """
    if not _by_one_arm(shop, shop.resource[hold.resource]):
        return hold
    end = StageMoment(hold.end.stage, shop.stages[hold.end.stage].duration) if hold.end else None
    return Hold(hold.resource, StageMoment(hold.begin.stage) if hold.begin else None, end)


def _by_one_arm(shop: Shop, resource: Resource) -> bool:
    """Whether all that takes a resource begins and ends during stages of one other resource of
    capacity 1.
    """
    if resource.capacity != 1 or any(
        resource.name in stage.resources for stage in shop.stages.values()
    ):
        return False
    arms = {shop_resource.name for shop_resource in shop.resources if shop_resource.capacity == 1}
    for hold in (shop_hold for shop_hold in shop.holds if shop_hold.resource == resource.name):
        for moment, outer in ((hold.begin, False), (hold.end, True)):
            if moment is not None:
                stage = shop.stages[moment.stage]
                inside = moment.offset > 0 if outer else moment.offset < stage.duration
                arms &= set(stage.resources) if inside else set()
    return bool(arms)


@dataclass(frozen=True, slots=True)
class ServiceBatches:
    """Stages that need `device` at `setting`, each within a hold of one resource, at most `most` at
    a time.

    `entries` are the stages that begin those holds. Between two periods at least `away` passes, and
    at least `entry` more if an object comes in. If several objects come in before the same period,
    each comes at least `apart` after the one before, because all of them leave the same place, one
    at a time.
    """

    device: str
    setting: str
    stages: tuple[ShopStage, ...]
    entries: tuple[str, ...]
    most: int
    away: int
    entry: int
    apart: int

    def least(self, durations: Sequence[int], inside: int = 0) -> int:
        """The least time from the start of the first period to the end of the last, given the
        stages' durations.

        The objects of `inside` stages are inside already. If n stages share z periods, at least n -
        z objects come in together with others. If some do so before the first period, it starts
        later than it could.
        """
        longest = sorted(durations, reverse=True)
        number, fewest = len(longest), -(-len(longest) // self.most)
        times = []
        served = sum(longest[:: self.most])
        for periods in range(fewest, number + 1):
            together = max(0, number - inside - periods) * self.apart
            times.append(served + max(0, periods - 1) * (self.away + self.entry) + together)
            served += min(longest, default=0)
        return min(times, default=0)


def service_batches(lags: Lags) -> tuple[ServiceBatches, ...]:
    """All groups of stages that are served in batches."""
    groups: dict[tuple[str, str, str], list[tuple[ShopStage, str]]] = defaultdict(list)
    for hold in lags.shop.holds:
        for stage, need in _stages_inside(lags.shop, hold):
            if hold.begin:
                groups[need.device, need.setting, hold.resource].append((stage, hold.begin.stage))
    return tuple(_batches_at(lags, *key, members) for key, members in groups.items())


def _batches_at(
    lags: Lags, device: str, setting: str, resource: str, members: Sequence[tuple[ShopStage, str]]
) -> ServiceBatches:
    shop = lags.shop
    changes = shop.device[device].changes
    away = min((change.duration for change in changes if change.before == setting), default=0)
    back = min((change.duration for change in changes if change.after == setting), default=0)
    needs = [last_needs(shop.stages[entry])[device] for _, entry in members]
    return ServiceBatches(
        device,
        setting,
        tuple(stage for stage, _ in members),
        tuple(entry for _, entry in members),
        shop.resource[resource].capacity,
        away + back,
        min(need.end - need.begin for need in needs),
        _entry_gap(lags, [shop.stages[entry] for _, entry in members], needs),
    )


def _entry_gap(lags: Lags, entries: Sequence[ShopStage], needs: Sequence[Need]) -> int:
    """The least time between two entries if all come from one place that holds one object at a
    time; else 0.
    """
    if (
        len(
            {
                (need.begin, need.end, stage.duration)
                for need, stage in zip(needs, entries, strict=True)
            }
        )
        > 1
    ):
        return 0
    names = {stage.name for stage in entries}
    for resource in (
        single_resource for single_resource in lags.shop.resources if single_resource.capacity == 1
    ):
        taken = [
            occupation
            for occupation in resource_occupations(lags, resource)
            if occupation.last.name in names and occupation.first != occupation.last
        ]
        whole = all(occupation.head == lags.heads[occupation.first.name] for occupation in taken)
        if (
            whole
            and {occupation.last.name for occupation in taken} == names
            and len(taken) == len(names)
        ):
            return min(occupation.size for occupation in taken) + least_travel(lags, taken)
    return 0


def _stages_inside(shop: Shop, hold: Hold) -> Iterator[tuple[ShopStage, Need]]:
    """The stages within a hold that need another setting of a device than the hold's begin and
    end need.
    """
    if (
        hold.begin is None
        or hold.end is None
        or shop.owners[hold.begin.stage] is not shop.owners[hold.end.stage]
    ):
        return
    names = [stage.name for stage in shop.owners[hold.begin.stage].stages]
    first, last = names.index(hold.begin.stage), names.index(hold.end.stage)
    ordered = {
        (window.earlier.stage, window.later.stage) for window in shop.windows if window.least >= 0
    }
    if any((names[n], names[n + 1]) not in ordered for n in range(first, last)):
        return
    entry = last_needs(shop.stages[names[first]])
    leaving = first_needs(shop.stages[names[last]])
    for name in names[first + 1 : last]:
        for need in shop.stages[name].needs:
            came, goes = entry.get(need.device), leaving.get(need.device)
            if came is None or goes is None or need.setting in (came.setting, goes.setting):
                continue
            if hold.begin.offset <= came.end and hold.end.offset >= goes.begin:
                yield shop.stages[name], need


def batch_bound(lags: Lags) -> int:
    """A lower bound of the makespan: all batches must be served one after another."""
    bounds = [0]
    for batch in service_batches(lags):
        head = min(lags.heads[stage.name] for stage in batch.stages)
        tail = min(lags.tails[stage.name] - stage.duration for stage in batch.stages)
        bounds.append(head + batch.least([stage.duration for stage in batch.stages]) + tail)
    return max(bounds)
