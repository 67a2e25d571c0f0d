"""Processes that need the same device setting come in batches, because entering or leaving needs another one.

While a freezer's lid is shut, nothing enters or leaves. So everything that is cooled in one such period is
inside for the whole period, and at most as much is cooled at once as there are places.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from cellwright.engine.model.shop import Hold, Need, Shop, Stage
from cellwright.engine.stages.scheduling.bounds import least_travel, occupations
from cellwright.engine.stages.scheduling.lags import Lags, first_needs, last_needs


@dataclass(frozen=True, slots=True)
class Batches:
    """Stages that need `device` at `setting`, each within a hold of one resource, at most `most` at a time.

    `entries` are the stages that begin those holds. Between two periods at least `away` passes, and at least
    `entry` more if an object comes in. If several objects come in before the same period, each comes at least
    `apart` after the one before, because all of them leave the same place, one at a time.
    """

    device: str
    setting: str
    stages: tuple[Stage, ...]
    entries: tuple[str, ...]
    most: int
    away: int
    entry: int
    apart: int

    def least(self, durations: Sequence[int], inside: int = 0) -> int:
        """The least time from the start of the first period to the end of the last, given the stages'
        durations.

        The objects of `inside` stages are inside already. If n stages share z periods, at least n - z objects
        come in together with others. If some do so before the first period, it starts later than it could.
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


def batches(lags: Lags) -> tuple[Batches, ...]:
    """All groups of stages that are served in batches."""
    groups: dict[tuple[str, str, str], list[tuple[Stage, str]]] = defaultdict(list)
    for hold in lags.shop.holds:
        for stage, need in _inside(lags.shop, hold):
            if hold.begin:
                groups[need.device, need.setting, hold.resource].append((stage, hold.begin.stage))
    return tuple(_batches(lags, *key, each) for key, each in groups.items())


def _batches(
    lags: Lags, device: str, setting: str, resource: str, members: Sequence[tuple[Stage, str]]
) -> Batches:
    shop = lags.shop
    changes = shop.device[device].changes
    away = min((each.duration for each in changes if each.before == setting), default=0)
    back = min((each.duration for each in changes if each.after == setting), default=0)
    needs = [last_needs(shop.stages[entry])[device] for _, entry in members]
    return Batches(
        device,
        setting,
        tuple(stage for stage, _ in members),
        tuple(entry for _, entry in members),
        shop.resource[resource].capacity,
        away + back,
        min(need.end - need.begin for need in needs),
        _apart(lags, [shop.stages[entry] for _, entry in members], needs),
    )


def _apart(lags: Lags, entries: Sequence[Stage], needs: Sequence[Need]) -> int:
    """The least time between two entries if all come from one place that holds one object at a time; else 0."""
    if len({(need.begin, need.end, stage.duration) for need, stage in zip(needs, entries, strict=True)}) > 1:
        return 0
    names = {stage.name for stage in entries}
    for resource in (each for each in lags.shop.resources if each.capacity == 1):
        taken = [
            each
            for each in occupations(lags, resource)
            if each.last.name in names and each.first != each.last
        ]
        whole = all(each.head == lags.heads[each.first.name] for each in taken)
        if whole and {each.last.name for each in taken} == names and len(taken) == len(names):
            return min(each.size for each in taken) + least_travel(lags, taken)
    return 0


def _inside(shop: Shop, hold: Hold) -> Iterator[tuple[Stage, Need]]:
    """The stages within a hold that need another setting of a device than the hold's begin and end need."""
    if (
        hold.begin is None
        or hold.end is None
        or shop.owners[hold.begin.stage] is not shop.owners[hold.end.stage]
    ):
        return
    names = [stage.name for stage in shop.owners[hold.begin.stage].stages]
    first, last = names.index(hold.begin.stage), names.index(hold.end.stage)
    ordered = {(window.earlier.stage, window.later.stage) for window in shop.windows if window.least >= 0}
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
    for each in batches(lags):
        head = min(lags.heads[stage.name] for stage in each.stages)
        tail = min(lags.tails[stage.name] - stage.duration for stage in each.stages)
        bounds.append(head + each.least([stage.duration for stage in each.stages]) + tail)
    return max(bounds)
