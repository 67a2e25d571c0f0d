"""The scheduler: decides when each stage of each job happens, so that everything is done as soon as possible.

It proves, if it can, that no schedule is shorter.
"""

import time
from dataclasses import replace

from cellwright.engine.model.outcome import GaveUp, Infeasible, Statistics
from cellwright.engine.model.schedule import Schedule, Scheduled, Timing
from cellwright.engine.model.shop import Shop
from cellwright.engine.stages.scheduling.batches import batch_bound
from cellwright.engine.stages.scheduling.bounds import lower_bound
from cellwright.engine.stages.scheduling.checker import check_schedule
from cellwright.engine.stages.scheduling.construct import construct
from cellwright.engine.stages.scheduling.lags import CircularLags, Lags
from cellwright.engine.stages.scheduling.limits import ScheduleLimits

__all__ = ["ScheduleLimits", "check_schedule", "schedule"]


class ScheduleRefused(Exception):
    """The scheduler made a schedule that the checker refuses.

    This is a bug; the message says what is wrong.
    """


def schedule(shop: Shop, limits: ScheduleLimits = ScheduleLimits()) -> Timing:
    """The best schedule found for a shop, the proof that there is none, or the reason why the search stopped."""
    started = time.perf_counter()
    lags = Lags(shop)
    try:
        bound = max(lower_bound(lags), batch_bound(lags))
    except CircularLags as error:
        return Infeasible(f"there is no schedule: the windows around {error} contradict each other")
    first = construct(lags, bound, limits.interrupted)
    if first is not None:
        _require_valid(shop, first)
    constructed = time.perf_counter()
    found = first if first is not None and first.proved else _improved(lags, bound, first, limits)
    seconds = {"first schedule": constructed - started, "search": time.perf_counter() - constructed}
    if found is None:
        return GaveUp("no schedule was found within the limits", "time")
    if isinstance(found, Infeasible):
        return found
    counts = {
        "jobs": len(shop.jobs),
        "stages": len(shop.stages),
        "first makespan": first.makespan if first else 0,
    }
    return _checked(shop, found, Statistics(counts, seconds))


def _improved(
    lags: Lags, bound: int, first: Schedule | None, limits: ScheduleLimits
) -> Schedule | Infeasible | None:
    from cellwright.engine.stages.scheduling.solver import improve  # the solver takes a while to load

    return improve(lags, bound, horizon(lags.shop, first), first, limits)


def horizon(shop: Shop, first: Schedule | None) -> int:
    """A time by which everything can be done.

    Gaps in which nothing happens and no time must pass can be closed, so nothing need end later.
    """
    if first is not None and not any(job.due is not None for job in shop.jobs):
        return first.makespan
    work = sum(stage.duration for stage in shop.stages.values())
    waits = sum(max(0, window.least) for window in shop.windows)
    travel = sum(max(resource.travel.values(), default=0) for resource in shop.resources)
    longest = {d.name: max((change.duration for change in d.changes), default=0) for d in shop.devices}
    needs = [need.device for stage in shop.stages.values() for need in stage.needs]
    changes = [*needs, *longest]  # each device may need one more change, to its final setting
    trips = travel * (len(shop.stages) + len(changes) + 1)
    return (
        work
        + waits
        + trips
        + sum(longest[each] for each in changes)
        + max((j.release for j in shop.jobs), default=0)
    )


def _checked(shop: Shop, found: Schedule, statistics: Statistics) -> Scheduled:
    _require_valid(shop, found)
    proved = found.proved or (found.lower_bound == found.makespan and not found.tardiness)
    return Scheduled(replace(found, proved=proved), statistics)


def _require_valid(shop: Shop, found: Schedule) -> None:
    if wrong := check_schedule(shop, found):
        raise ScheduleRefused("; ".join(wrong[:5]))
