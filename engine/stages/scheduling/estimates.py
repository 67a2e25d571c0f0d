"""An estimate of the end of a partial schedule: placed stages with their tails, and the work that resources still have to do."""

from collections.abc import Sequence
from dataclasses import replace

from cellwright.engine.model.shop import Stage
from cellwright.engine.stages.scheduling.batches import Batches, batches
from cellwright.engine.stages.scheduling.bounds import Occupation, least_travel, occupations
from cellwright.engine.stages.scheduling.lags import Lags
from cellwright.engine.stages.scheduling.partial import Partial


class Estimates:
    """Estimates for partial schedules of one shop. What it needs to know about the shop is looked up once."""

    def __init__(self, lags: Lags) -> None:
        self.lags, self.shop = lags, lags.shop
        single = [resource for resource in self.shop.resources if resource.capacity == 1]
        self.served = {resource.name: list(occupations(lags, resource)) for resource in single}
        self.batches = batches(lags)
        self.least = {name: least_travel(lags, served) for name, served in self.served.items()}
        self.concerned = {stage.name: self._concerned(stage) for stage in self.shop.stages.values()}

    def after(self, partial: Partial, stage: Stage, start: int) -> Partial:
        """A partial schedule whose last stage was placed at a start, with its estimate and its tardiness."""
        estimate = max(partial.estimate, start + self.lags.tails[stage.name])
        for name in self.concerned[stage.name] if len(partial.starts) > 1 else self.served:
            estimate = max(estimate, self._remaining(partial, name, self.served[name]))
        for each in self.batches:
            estimate = max(estimate, self._batched(partial, each))
        job = self.shop.owners[stage.name]
        done = all(each.name in partial.starts for each in job.stages)
        late = 0
        if job.due is not None and done:
            end = max(partial.starts[each.name] + each.duration for each in job.stages)
            late = job.priority * max(0, end - job.due)
        return replace(partial, estimate=estimate, tardiness=partial.tardiness + late)

    def _remaining(self, partial: Partial, resource: str, served: Sequence[Occupation]) -> int:
        """When a resource can have done all its work, tail included. Work under way counts from its start."""
        now = max(partial.units[resource], default=0)
        waiting = [each for each in served if each.first.name not in partial.starts]
        for each in served:
            if each.first.name in partial.starts and each.last.name not in partial.starts:
                now = max(now, partial.starts[each.first.name] + each.size)
        if not waiting:
            return now
        least = self.least[resource]
        now = max(now, min(self._free(partial, each.first) for each in waiting))
        work = sum(each.size + least for each in waiting) - least
        return now + work + min(each.tail for each in waiting)

    def _batched(self, partial: Partial, served: Batches) -> int:
        """When all batches can be done, tail included.

        Objects that are inside may join a period under way.
        """
        pairs = zip(served.stages, served.entries, strict=True)
        waiting = [
            (stage, entry in partial.starts) for stage, entry in pairs if stage.name not in partial.starts
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

    def _concerned(self, stage: Stage) -> list[str]:
        """The resources whose remaining work may end later once a stage is placed; that of the others stays as it was."""
        touched = set(stage.resources) | {self.shop.device[need.device].operator for need in stage.needs}
        for hold in self.shop.holds:
            if any(event and event.stage == stage.name for event in (hold.begin, hold.end)):
                touched.add(hold.resource)
        return [
            name
            for name, served in self.served.items()
            if name in touched
            or any(stage in (each.first, each.last) or touched & set(each.first.resources) for each in served)
        ]

    def _free(self, partial: Partial, stage: Stage) -> int:
        """When a stage's resources are free and at its origin; 0 for one that is taken for an unknown time."""
        times = [
            partial.units[name][0] + partial.travel(self.shop, name, stage.origin)
            if partial.units[name]
            else 0
            for name in stage.resources
        ]
        return max(times, default=0)
