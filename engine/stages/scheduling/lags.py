"""The least times between stages, from windows and from the device changes that successive stages need.

From these lags follow how early a stage can start (head) and how much must follow its start (tail).
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from cellwright.engine.model.shop import Changeover, Need, Shop, Stage, Window
from cellwright.engine.stages.scheduling.travel import Table, shortest

NEVER = -(10**12)  # the lag between two stages that are not ordered


class CircularLags(Exception):
    """The lags form a cycle that no schedule can keep. Carries a stage of the cycle."""


@dataclass(frozen=True)
class Lags:
    """The least times between the starts of the stages of a shop, over all paths. Raises `CircularLags`."""

    shop: Shop

    @cached_property
    def direct(self) -> dict[tuple[str, str], int]:
        """The lag of each pair of stages that a window or a hold joins, with the device changes between them."""
        found: dict[tuple[str, str], int] = {}
        holds = (Window(hold.begin, hold.end) for hold in self.shop.holds if hold.begin and hold.end)
        for window in (*self.shop.windows, *holds):
            one, other = window.earlier, window.later
            lag = one.offset + window.least - other.offset
            pair = one.stage, other.stage
            found[pair] = max(found.get(pair, NEVER), lag)
            if window.most is not None:
                back = other.offset - window.most - one.offset
                found[pair[::-1]] = max(found.get(pair[::-1], NEVER), back)
        for (one_name, other_name), lag in list(found.items()):
            one_stage, other_stage = self.shop.stages[one_name], self.shop.stages[other_name]
            if lag >= one_stage.duration:
                found[one_name, other_name] = max(lag, self.setup(one_stage, other_stage))
        return found

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
        """The least time from the start of each stage to the end of everything that depends on it, itself included."""
        last = {name: stage.duration for name, stage in self.shop.stages.items()}
        return self._longest(last, {(b, a): lag for (a, b), lag in self.direct.items()})

    @cached_property
    def travel(self) -> dict[str, Table]:
        """For each resource, the least travel times between places."""
        return {resource.name: shortest(self.shop, resource) for resource in self.shop.resources}

    def setup(self, one: Stage | None, other: Stage) -> int:
        """The least time from the start of `one` (None: time 0) to that of `other`, with devices changed
        between.
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
            (self._least(operator, one, other, each) for operator, each in needed.items()), default=NEVER
        )

    def _least(
        self, operator: str, one: Stage | None, other: Stage, changes: Sequence[tuple[Changeover, int, int]]
    ) -> int:
        """The same for the changes by one operator.

        If a stage uses the operator, the changes come after or before this stage.
        """
        home = self.shop.resource[operator].home
        here = home if one is None else one.destination if operator in one.resources else None
        since = min(each[1] for each in changes) if one and here is None else one.duration if one else 0
        busy = operator in other.resources
        until = 0 if busy else max(each[2] for each in changes)
        ways = itertools.permutations([each[0] for each in changes])
        times = [_way(self.travel[operator], here, way, other.origin if busy else None) for way in ways]
        return since + min(times) - until

    def span(self, first: str, last: str) -> int:
        """The least time from the start of `first` to the start of `last`; `NEVER` if nothing orders them."""
        found = dict.fromkeys(self.shop.stages, NEVER)
        found[first] = 0
        return self._longest(found, self._within(first))[last]

    def _within(self, stage: str) -> dict[tuple[str, str], int]:
        names = {each.name for each in self.shop.owners[stage].stages}
        return {(a, b): lag for (a, b), lag in self.direct.items() if a in names and b in names}

    def _longest(self, start: Mapping[str, int], lags: Mapping[tuple[str, str], int]) -> dict[str, int]:
        """The longest paths from `start` (Bellman & Ford), in rounds."""
        best = dict(start)
        following: dict[str, list[tuple[str, int]]] = {}
        for (one, other), lag in lags.items():
            following.setdefault(one, []).append((other, lag))
        changed = {name for name, value in best.items() if value > NEVER}
        for _ in range(len(best) + 1):
            moved: set[str] = set()
            for one in sorted(changed):
                for other, lag in following.get(one, ()):
                    if best[one] + lag > best[other]:
                        best[other] = best[one] + lag
                        moved.add(other)
            if not moved:
                return best
            changed = moved
        raise CircularLags(min(changed))


def _way(travel: Table, here: str | None, way: Sequence[Changeover], there: str | None) -> int:
    """The time for some changes in a row, with travel from `here` and to `there` if these are known."""
    places = [here, *(place for change in way for place in (change.origin, change.destination)), there]
    pairs = zip(places[::2], places[1::2], strict=True)
    empty = sum(travel.get((a, b), 0) for a, b in pairs if a is not None and b is not None)
    return empty + sum(change.duration for change in way)


def first_needs(stage: Stage) -> dict[str, Need]:
    """For each device, the stage's first need."""
    return {need.device: need for need in sorted(stage.needs, key=lambda each: -each.begin)}


def last_needs(stage: Stage) -> dict[str, Need]:
    """For each device, the stage's last need."""
    return {need.device: need for need in sorted(stage.needs, key=lambda each: each.end)}
