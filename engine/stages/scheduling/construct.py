"""A first schedule: stages are placed one after another, each as early as possible, in an order found by a
beam.

Whatever a resource does comes after the work that it was given before (a serial scheme). If a stage needs
another setting of a device, the device is changed when the stage is placed. The beam keeps the partial
schedules with the least estimate of the end: it counts the placed stages with their tails, and the work that
each resource still has to do.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import islice

from cellwright.engine.kernels.cancellation import Interrupted, never
from cellwright.engine.model.schedule import Adjustment, Schedule
from cellwright.engine.model.shop import Changeover, Need, Stage
from cellwright.engine.stages.scheduling.estimates import Estimates
from cellwright.engine.stages.scheduling.lags import Lags, first_needs
from cellwright.engine.stages.scheduling.partial import DeviceStanding, Partial
from cellwright.engine.stages.scheduling.symmetry import alike

WIDTHS = (1, 6, 30, 150)  # of the beam; tried in this order until the lower bound is reached
MOST = 8_000  # about how many partial schedules one beam may make


def construct(lags: Lags, bound: int, interrupted: Interrupted = never) -> Schedule | None:
    """The best of the schedules that some beams find, without further search.

    None if all beams get stuck. Once it is `interrupted`, it ends soon.
    """
    builder = Builder(lags)
    best: Schedule | None = None
    for width in WIDTHS:
        if width > 1 and width * len(lags.shop.stages) * builder.kinds > MOST:
            break
        found = builder.beam(width, interrupted)
        if found is None and width > 1 and best is None:
            break
        if found is not None and (best is None or _value(found) < _value(best)):
            best = found
        if best is not None and best.makespan == bound and not best.tardiness:
            break
    return best and replace(best, lower_bound=bound, proved=best.makespan == bound and not best.tardiness)


def _value(schedule: Schedule) -> tuple[int, int]:
    return schedule.tardiness, schedule.makespan


class Builder:
    """Places stages one after another. What this needs to know about the shop is looked up once."""

    def __init__(self, lags: Lags) -> None:
        self.lags, self.shop = lags, lags.shop
        self.before: dict[str, list[tuple[str, int]]] = {name: [] for name in self.shop.stages}
        self.after: dict[str, list[tuple[str, int]]] = {name: [] for name in self.shop.stages}
        for (earlier, later), lag in lags.direct.items():
            self.before[later].append((earlier, lag))
            self.after[earlier].append((later, lag))
        self.queue = [[job.stages[0].name for job in group] for group in alike(self.shop)]
        self.kinds = len(self.shop.jobs) - sum(len(queue) - 1 for queue in self.queue)
        self.estimates = Estimates(lags)

    def beam(self, width: int, interrupted: Interrupted = never) -> Schedule | None:
        """The best complete schedule of a beam of partial schedules; None if the beam gets stuck.

        Once it is `interrupted`, a beam of one takes what comes first, and a wider one is given up.
        """
        kept = [self._empty()]
        for _ in self.shop.stages:
            if interrupted():
                kept = [child for each in kept for child in self._first_child(each)] if width == 1 else []
                continue
            found = [child for each in kept for child in self._children(each)]
            kept = sorted(found, key=lambda each: each.score)[:width]
        return self._finish(kept[0]) if kept else None

    def _empty(self) -> Partial:
        units = {resource.name: (0,) * resource.capacity for resource in self.shop.resources}
        for hold in self.shop.holds:
            if hold.begin is None:
                units[hold.resource] = units[hold.resource][1:]
        places = {resource.name: resource.home for resource in self.shop.resources if resource.travel}
        devices = {device.name: DeviceStanding(device.initial) for device in self.shop.devices}
        return Partial({}, units, places, devices)

    def _children(self, partial: Partial) -> list[Partial]:
        """The partial schedules with one more stage, which starts before another one could have ended.

        Giffler & Thompson 1960. Of jobs that are alike, only the first one not yet begun may begin.
        """
        found = [
            (child.starts[stage.name], child.starts[stage.name] + stage.duration, child)
            for stage in self._ready(partial)
            if (child := self._placed(partial, stage)) is not None
        ]
        soonest = min((end for _, end, _ in found), default=0)
        return [child for start, end, child in found if start < soonest or end == soonest]

    def _first_child(self, partial: Partial) -> list[Partial]:
        """The partial schedule with the first stage that can be placed; nothing if none can."""
        ready = sorted(self._ready(partial), key=lambda stage: self.lags.heads[stage.name])
        placed = (self._placed(partial, stage, estimated=False) for stage in ready)
        return list(islice((child for child in placed if child is not None), 1))

    def _ready(self, partial: Partial) -> Iterator[Stage]:
        """The stages that may be placed next: what must come before them is placed."""
        waiting = {each for queue in self.queue for each in [n for n in queue if n not in partial.starts][1:]}
        for name, stage in self.shop.stages.items():
            if (
                name not in partial.starts
                and name not in waiting
                and all(earlier in partial.starts or lag < 0 for earlier, lag in self.before[name])
            ):
                yield stage

    def _placed(self, partial: Partial, stage: Stage, estimated: bool = True) -> Partial | None:
        """The partial schedule with one more stage, as early as possible; None if the stage cannot come now."""
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

    def _changed(self, partial: Partial, stage: Stage) -> Partial | None:
        """The partial schedule after a stage's device changes, in order of their begins; None if impossible."""
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
            start, name, change = min(wanted, key=lambda each: (each[0], each[1]))
            partial = self._adjusted(partial, name, change, start)
        fits = all(partial.devices[need.device].setting == need.setting for need in stage.needs)
        return partial if fits else None

    def _change(self, partial: Partial, need: Need) -> Changeover | None:
        return self.shop.device[need.device].change(partial.devices[need.device].setting, need.setting)

    def _change_start(self, partial: Partial, change: Changeover, need: Need) -> int:
        operator = self.shop.device[need.device].operator
        free = partial.units[operator][0] + partial.travel(self.shop, operator, change.origin)
        return max(free, partial.devices[need.device].until)

    def _adjusted(self, partial: Partial, name: str, change: Changeover, start: int) -> Partial:
        operator, end = self.shop.device[name].operator, start + change.duration
        places = (
            {**partial.places, operator: change.destination} if operator in partial.places else partial.places
        )
        return replace(
            partial,
            units={**partial.units, operator: (end,)},
            places=places,
            devices={**partial.devices, name: DeviceStanding(change.after, end, end)},
            adjustments=(*partial.adjustments, Adjustment(name, change, start)),
        )

    def _earliest(self, partial: Partial, stage: Stage) -> int | None:
        """When a stage can start if its devices stay as they are; None if a resource is never free again."""
        times = [self.lags.heads[stage.name]]
        times += [partial.starts[e] + lag for e, lag in self.before[stage.name] if e in partial.starts]
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

    def _in_time(self, partial: Partial, name: str, start: int) -> bool:
        """Whether a start keeps the lags to the later stages that are placed already."""
        later = self.after[name]
        return all(partial.starts[each] >= start + lag for each, lag in later if each in partial.starts)

    def _taken(self, partial: Partial, stage: Stage, start: int) -> dict[str, tuple[int, ...]]:
        """When the units are free after a stage: it takes its resources, begins some holds, and ends others."""
        units = dict(partial.units)
        for name in stage.resources:
            units[name] = tuple(sorted((*units[name][1:], start + stage.duration)))
        for hold in self.shop.holds:
            if hold.begin and hold.begin.stage == stage.name:
                units[hold.resource] = units[hold.resource][1:]
            if hold.end and hold.end.stage == stage.name:
                units[hold.resource] = tuple(sorted((*units[hold.resource], start + hold.end.offset)))
        return units

    def _finish(self, partial: Partial) -> Schedule | None:
        """The whole schedule, with each device changed to its final setting; None if a device cannot be."""
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
        makespan = max([0, *ends, *(each.end for each in partial.adjustments)])
        return Schedule(dict(partial.starts), partial.adjustments, makespan, 0, partial.tardiness)


__all__ = ["Builder", "construct"]
