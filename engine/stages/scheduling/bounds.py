"""A lower bound of the makespan, from the longest path of lags and from the work that each resource must do.

The work of a resource is a one-machine problem with heads and tails, solved with preemption (Jackson's
schedule; Carlier 1982). A place may be filled during one stage and emptied during another, always by the same
arm. Then it is taken from the start of the first stage to the end of the second, because the arm does one
thing at a time.
"""

import heapq
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from cellwright.engine.model.shop import Hold, Moment, Resource, Shop, Stage
from cellwright.engine.stages.scheduling.lags import NEVER, Lags


@dataclass(frozen=True, slots=True)
class Occupation:
    """A unit of a resource is taken for at least `size`, not before `head`; at least `tail` follows.

    `first` and `last` are the stages during which the occupation begins and ends.
    """

    first: Stage
    last: Stage
    head: int
    size: int
    tail: int


def lower_bound(lags: Lags) -> int:
    """No schedule of the shop ends before this. Raises `Contradiction` if there is no schedule at all."""
    paths = [lags.heads[name] + lags.tails[name] for name in lags.shop.stages]
    served = [resource_bound(lags, resource) for resource in lags.shop.resources]
    return max([0, *paths, *served])


def resource_bound(lags: Lags, resource: Resource) -> int:
    """The lower bound that follows from the work of one resource."""
    taken = list(occupations(lags, resource))
    if not taken:
        return 0
    if resource.capacity == 1:
        least = least_travel(lags, taken)
        return jackson([(each.head, each.size + least, each.tail - least) for each in taken])
    work = sum(each.size for each in taken)
    return min(each.head for each in taken) - -work // resource.capacity + min(each.tail for each in taken)


def jackson(works: Sequence[tuple[int, int, int]]) -> int:
    """The end of the preemptive schedule of works (head, size, tail) that always serves the longest tail."""
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
    pairs = ((one.last, other.first) for one in taken for other in taken if one is not other)
    return min((_travel(lags, last, first) for last, first in pairs), default=0)


def _travel(lags: Lags, one: Stage, other: Stage) -> int:
    """The least time in which a resource of both stages goes from the end of one to the start of the other."""
    shared = set(one.resources) & set(other.resources)
    pair = one.destination, other.origin
    return max((lags.travel[name].get(pair, 0) for name in shared), default=0)


def occupations(lags: Lags, resource: Resource) -> Iterator[Occupation]:
    """Everything that takes a unit of a resource: stages and holds.

    Holds without begin or end are left out.
    """
    shop = lags.shop
    for stage in shop.stages.values():
        if resource.name in stage.resources:
            tail = lags.tails[stage.name] - stage.duration
            yield Occupation(stage, stage, lags.heads[stage.name], stage.duration, tail)
    for hold in (widened(shop, each) for each in shop.holds if each.resource == resource.name):
        if hold.begin is None or hold.end is None:
            continue
        span = lags.span(hold.begin.stage, hold.end.stage)
        if span > NEVER:
            first, last = shop.stages[hold.begin.stage], shop.stages[hold.end.stage]
            size = max(0, span + hold.end.offset - hold.begin.offset)
            head = lags.heads[first.name] + hold.begin.offset
            yield Occupation(first, last, head, size, lags.tails[last.name] - hold.end.offset)


def widened(shop: Shop, hold: Hold) -> Hold:
    """The hold from the start of its first stage to the end of its last one, if this is equivalent."""
    if not _by_one_arm(shop, shop.resource[hold.resource]):
        return hold
    end = Moment(hold.end.stage, shop.stages[hold.end.stage].duration) if hold.end else None
    return Hold(hold.resource, Moment(hold.begin.stage) if hold.begin else None, end)


def _by_one_arm(shop: Shop, resource: Resource) -> bool:
    """Whether all that takes a resource begins and ends during stages of one other resource of capacity 1."""
    if resource.capacity != 1 or any(resource.name in stage.resources for stage in shop.stages.values()):
        return False
    arms = {each.name for each in shop.resources if each.capacity == 1}
    for hold in (each for each in shop.holds if each.resource == resource.name):
        for moment, outer in ((hold.begin, False), (hold.end, True)):
            if moment is not None:
                stage = shop.stages[moment.stage]
                inside = moment.offset > 0 if outer else moment.offset < stage.duration
                arms &= set(stage.resources) if inside else set()
    return bool(arms)
