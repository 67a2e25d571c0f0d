"""Jobs that are alike: their stages, windows and holds differ only in names, so these jobs can be exchanged."""

from collections import defaultdict
from collections.abc import Hashable

from cellwright.engine.model.shop import Job, Moment, Shop


def alike(shop: Shop) -> tuple[tuple[Job, ...], ...]:
    """Groups of at least two jobs that can be exchanged, each in the order of the shop."""
    groups: defaultdict[Hashable, list[Job]] = defaultdict(list)
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
    parts = _parts(shop)
    for job in shop.jobs:
        if job.stages and not any(stage.name in tied for stage in job.stages):
            groups[_shape(job, parts[job.name])].append(job)
    return tuple(tuple(group) for group in groups.values() if len(group) > 1)


def _parts(shop: Shop) -> dict[str, list[Hashable]]:
    """For each job, its windows and holds, with its stages numbered."""
    number = {stage.name: n for job in shop.jobs for n, stage in enumerate(job.stages)}

    def numbered(moment: Moment | None) -> Hashable:
        return (number[moment.stage], moment.offset) if moment else None

    found: dict[str, list[Hashable]] = {job.name: [] for job in shop.jobs}
    for window in shop.windows:
        shape = "window", numbered(window.earlier), numbered(window.later), window.least, window.most
        found[shop.owners[window.earlier.stage].name].append(shape)
    for hold in shop.holds:
        if moment := hold.begin or hold.end:
            owner = shop.owners[moment.stage].name
            found[owner].append(("hold", hold.resource, numbered(hold.begin), numbered(hold.end)))
    return found


def _shape(job: Job, parts: list[Hashable]) -> Hashable:
    stages = tuple((s.duration, s.resources, s.needs, s.origin, s.destination) for s in job.stages)
    return stages, frozenset(parts), job.release, job.due, job.priority
