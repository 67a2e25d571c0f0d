"""What a shop implies: travel times, least lags between stages, exchangeable jobs."""

import itertools
from collections import defaultdict
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from cellwright.engine.model.shop_scheduling import (
    Changeover,
    Need,
    Resource,
    Shop,
    ShopJob,
    ShopStage,
    StageMoment,
    StageWindow,
)

Table = Mapping[tuple[str, str], int]


def shortest_travel(shop: Shop, resource: Resource) -> Table:
    """The least time from any place to any other (Floyd & Warshall).

    Work that ends at another place is a way, too.
    """
    if not resource.travel:
        return {}
    moves = list(_resource_moves(shop, resource))
    between = sorted({place for one, other, _ in moves for place in (one, other)})
    # if nothing is done at home, no way leads through it
    places = sorted({resource.home, *between})
    best = {(a, b): 0 if a == b else resource.travel.get((a, b), 0) for a in places for b in places}
    for one, other, lasts in moves:
        best[one, other] = min(best[one, other], lasts)
    for middle, a, b in itertools.product(between, places, places):
        best[a, b] = min(best[a, b], best[a, middle] + best[middle, b])
    return best


def has_shortcuts(shop: Shop, resource: Resource) -> bool:
    """Whether some way by other places or other work is shorter than the table says."""
    best = shortest_travel(shop, resource)
    return any(
        best[a, b] < lasts
        for (a, b), lasts in resource.travel.items()
        if (a, b) in best and (a != b or lasts)
    )


def _resource_moves(shop: Shop, resource: Resource) -> Iterator[tuple[str, str, int]]:
    """Where the work of a resource begins and ends, and how long it lasts."""
    for stage in shop.stages.values():
        if resource.name in stage.resources:
            yield stage.origin, stage.destination, stage.duration
    for device in shop.devices:
        if device.operator == resource.name:
            yield from (
                (change.origin, change.destination, change.duration) for change in device.changes
            )


NO_LAG = -(10**12)  # the lag between two stages that are not ordered


class CircularLags(Exception):
    """The lags form a cycle that no schedule can keep. Carries a stage of the cycle."""


@dataclass(frozen=True)
class Lags:
    """The least times between the starts of the stages of a shop, over all paths.

    Raises `CircularLags`.
    """

    shop: Shop

    @cached_property
    def direct(self) -> dict[tuple[str, str], int]:
        """The lag of each pair of stages that a window or a hold joins, with the device changes
        between them.
        """
        lags: dict[tuple[str, str], int] = {}
        holds = (
            StageWindow(hold.begin, hold.end) for hold in self.shop.holds if hold.begin and hold.end
        )
        for window in (*self.shop.windows, *holds):
            earlier, later = window.earlier, window.later
            lag = earlier.offset + window.least - later.offset
            pair = earlier.stage, later.stage
            lags[pair] = max(lags.get(pair, NO_LAG), lag)
            if window.most is not None:
                back = later.offset - window.most - earlier.offset
                lags[pair[::-1]] = max(lags.get(pair[::-1], NO_LAG), back)
        for (one_name, other_name), lag in list(lags.items()):
            one_stage, other_stage = self.shop.stages[one_name], self.shop.stages[other_name]
            if lag >= one_stage.duration:
                lags[one_name, other_name] = max(lag, self.setup(one_stage, other_stage))
        return lags

    @cached_property
    def heads(self) -> dict[str, int]:
        """The earliest start of each stage."""
        first = {
            name: max(0, self.shop.owners[name].release, self.setup(None, stage))
            for name, stage in self.shop.stages.items()
        }
        return self._longest(first, self.direct)

    @cached_property
    def tails(self) -> dict[str, int]:
        """The least time from the start of each stage to the end of everything that depends on
        it, itself included.
        """
        last = {name: stage.duration for name, stage in self.shop.stages.items()}
        return self._longest(last, {(b, a): lag for (a, b), lag in self.direct.items()})

    @cached_property
    def travel(self) -> dict[str, Table]:
        """For each resource, the least travel times between places."""
        return {
            resource.name: shortest_travel(self.shop, resource) for resource in self.shop.resources
        }

    def setup(self, one: ShopStage | None, other: ShopStage) -> int:
        """The least time from the start of `one` (None: time 0) to that of `other`, with devices
        changed between.
        """
        needed: dict[str, list[tuple[Changeover, int, int]]] = {}
        for need in first_needs(other).values():
            device = self.shop.device[need.device]
            left = last_needs(one).get(need.device) if one else None
            if one is not None and left is None:
                continue
            before = left.setting if left else device.initial
            change = device.change(before, need.setting) if before != need.setting else None
            if change is not None:
                since = left.end if left else 0
                needed.setdefault(device.operator, []).append((change, since, need.begin))
        return max(
            (
                self._least(operator, one, other, device_changes)
                for operator, device_changes in needed.items()
            ),
            default=NO_LAG,
        )

    def _least(
        self,
        operator: str,
        one: ShopStage | None,
        other: ShopStage,
        changes: Sequence[tuple[Changeover, int, int]],
    ) -> int:
        """The same for the changes by one operator.

        If a stage uses the operator, the changes come after or before this stage.
        """
        home = self.shop.resource[operator].home
        here = home if one is None else one.destination if operator in one.resources else None
        since = (
            min(change[1] for change in changes)
            if one and here is None
            else one.duration
            if one
            else 0
        )
        busy = operator in other.resources
        until = 0 if busy else max(change[2] for change in changes)
        ways = itertools.permutations([change[0] for change in changes])
        times = [
            _changes_time(self.travel[operator], here, way, other.origin if busy else None)
            for way in ways
        ]
        return since + min(times) - until

    def span(self, first: str, last: str) -> int:
        """The least time from the start of `first` to the start of `last`; `NEVER` if nothing
        orders them.
        """
        longest = dict.fromkeys(self.shop.stages, NO_LAG)
        longest[first] = 0
        return self._longest(longest, self._within(first))[last]

    def _within(self, stage: str) -> dict[tuple[str, str], int]:
        names = {job_stage.name for job_stage in self.shop.owners[stage].stages}
        return {(a, b): lag for (a, b), lag in self.direct.items() if a in names and b in names}

    def _longest(
        self, start: Mapping[str, int], lags: Mapping[tuple[str, str], int]
    ) -> dict[str, int]:
        """The longest paths from `start` (Bellman & Ford), in rounds."""
        best = dict(start)
        following: dict[str, list[tuple[str, int]]] = {}
        for (earlier, later), lag in lags.items():
            following.setdefault(earlier, []).append((later, lag))
        changed = {name for name, value in best.items() if value > NO_LAG}
        for _ in range(len(best) + 1):
            moved: set[str] = set()
            for earlier in sorted(changed):
                for later, lag in following.get(earlier, ()):
                    if best[earlier] + lag > best[later]:
                        best[later] = best[earlier] + lag
                        moved.add(later)
            if not moved:
                return best
            changed = moved
        raise CircularLags(min(changed))


def _changes_time(
    travel: Table, here: str | None, way: Sequence[Changeover], there: str | None
) -> int:
    """The time for some changes in a row, with travel from `here` and to `there` if these are
    known.
    """
    places = [
        here,
        *(place for change in way for place in (change.origin, change.destination)),
        there,
    ]
    pairs = zip(places[::2], places[1::2], strict=True)
    empty = sum(travel.get((a, b), 0) for a, b in pairs if a is not None and b is not None)
    return empty + sum(change.duration for change in way)


def first_needs(stage: ShopStage) -> dict[str, Need]:
    """For each device, the stage's first need."""
    return {
        need.device: need for need in sorted(stage.needs, key=lambda stage_need: -stage_need.begin)
    }


def last_needs(stage: ShopStage) -> dict[str, Need]:
    """For each device, the stage's last need."""
    return {
        need.device: need for need in sorted(stage.needs, key=lambda stage_need: stage_need.end)
    }


def alike_jobs(shop: Shop) -> tuple[tuple[ShopJob, ...], ...]:
    """Groups of at least two jobs that can be exchanged, each in the order of the shop."""
    groups: defaultdict[Hashable, list[ShopJob]] = defaultdict(list)
    tied = {
        stage
        for window in shop.windows
        for stage in (window.earlier.stage, window.later.stage)
        if shop.owners[window.earlier.stage] is not shop.owners[window.later.stage]
    }
    tied |= {
        moment.stage
        for hold in shop.holds
        for moment in (hold.begin, hold.end)
        if moment
        and hold.begin
        and hold.end
        and shop.owners[hold.begin.stage] is not shop.owners[hold.end.stage]
    }
    parts = _job_parts(shop)
    for job in shop.jobs:
        if job.stages and not any(stage.name in tied for stage in job.stages):
            groups[_job_shape(job, parts[job.name])].append(job)
    return tuple(tuple(group) for group in groups.values() if len(group) > 1)


def _job_parts(shop: Shop) -> dict[str, list[Hashable]]:
    """For each job, its windows and holds, with its stages numbered."""
    number = {stage.name: n for job in shop.jobs for n, stage in enumerate(job.stages)}

    def numbered(moment: StageMoment | None) -> Hashable:
        return (number[moment.stage], moment.offset) if moment else None

    parts_by_job: dict[str, list[Hashable]] = {job.name: [] for job in shop.jobs}
    for window in shop.windows:
        shape = (
            "window",
            numbered(window.earlier),
            numbered(window.later),
            window.least,
            window.most,
        )
        parts_by_job[shop.owners[window.earlier.stage].name].append(shape)
    for hold in shop.holds:
        if moment := hold.begin or hold.end:
            owner = shop.owners[moment.stage].name
            parts_by_job[owner].append(
                ("hold", hold.resource, numbered(hold.begin), numbered(hold.end))
            )
    return parts_by_job


def _job_shape(job: ShopJob, parts: list[Hashable]) -> Hashable:
    stages = tuple((s.duration, s.resources, s.needs, s.origin, s.destination) for s in job.stages)
    return stages, frozenset(parts), job.release, job.due, job.priority
