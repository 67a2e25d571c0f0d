"""The scheduler: decides when each stage of each job happens, so that everything is done as soon as
possible.

It proves, if it can, that no schedule is shorter.
"""

import time
from dataclasses import replace

from cellwright.engine.model.outcome import GaveUp, Infeasible, Statistics
from cellwright.engine.model.shop_scheduling import Schedule, Shop, Timing, ValidSchedule
from cellwright.engine.stages.scheduling.beam_construction import construct_schedule
from cellwright.engine.stages.scheduling.checker import check_schedule
from cellwright.engine.stages.scheduling.makespan_bounds import batch_bound, makespan_lower_bound
from cellwright.engine.stages.scheduling.schedule_limits import ScheduleLimits
from cellwright.engine.stages.scheduling.shop_analysis import CircularLags, Lags

__all__ = ["ScheduleLimits", "check_schedule", "schedule_shop"]


class ScheduleRefused(Exception):
    """The scheduler made a schedule that the checker refuses.

    This is a bug; the message says what is wrong.
    """


def schedule_shop(shop: Shop, limits: ScheduleLimits = ScheduleLimits()) -> Timing:
    """The best schedule found for a shop, the proof that there is none, or the reason why the
    search stopped.
    """
    started = time.perf_counter()
    lags = Lags(shop)
    try:
        bound = max(makespan_lower_bound(lags), batch_bound(lags))
    except CircularLags as error:
        return Infeasible(f"there is no schedule: the windows around {error} contradict each other")
    first = construct_schedule(lags, bound, limits.interrupted)
    if first is not None:
        _require_valid(shop, first)
    constructed = time.perf_counter()
    best = (
        first
        if first is not None and first.proved
        else _improve_schedule(lags, bound, first, limits)
    )
    seconds = {"first schedule": constructed - started, "search": time.perf_counter() - constructed}
    if best is None:
        return GaveUp("no schedule was found within the limits", "time")
    if isinstance(best, Infeasible):
        return best
    counts = {
        "jobs": len(shop.jobs),
        "stages": len(shop.stages),
        "first makespan": first.makespan if first else 0,
    }
    return _accept_schedule(shop, best, Statistics(counts, seconds))


def _improve_schedule(
    lags: Lags, bound: int, first: Schedule | None, limits: ScheduleLimits
) -> Schedule | Infeasible | None:
    from cellwright.engine.stages.scheduling.shop_solver import (
        improve_schedule,  # the solver takes a while to load
    )

    return improve_schedule(lags, bound, makespan_horizon(lags.shop, first), first, limits)


def makespan_horizon(shop: Shop, first: Schedule | None) -> int:
    """A time by which everything can be done.

    Gaps in which nothing happens and no time must pass can be closed, so nothing need end later.
    """
    if first is not None and not any(job.due is not None for job in shop.jobs):
        return first.makespan
    work = sum(stage.duration for stage in shop.stages.values())
    waits = sum(max(0, window.least) for window in shop.windows)
    travel = sum(max(resource.travel.values(), default=0) for resource in shop.resources)
    longest = {
        d.name: max((change.duration for change in d.changes), default=0) for d in shop.devices
    }
    needs = [need.device for stage in shop.stages.values() for need in stage.needs]
    changes = [*needs, *longest]  # each device may need one more change, to its final setting
    trips = travel * (len(shop.stages) + len(changes) + 1)
    return (
        work
        + waits
        + trips
        + sum(longest[changed_device] for changed_device in changes)
        + max((j.release for j in shop.jobs), default=0)
    )


def _accept_schedule(shop: Shop, schedule_found: Schedule, statistics: Statistics) -> ValidSchedule:
    _require_valid(shop, schedule_found)
    proved = schedule_found.proved or (
        schedule_found.lower_bound == schedule_found.makespan and not schedule_found.tardiness
    )
    return ValidSchedule(replace(schedule_found, proved=proved), statistics)


def _require_valid(shop: Shop, schedule_found: Schedule) -> None:
    if wrong := check_schedule(shop, schedule_found):
        raise ScheduleRefused("; ".join(wrong[:5]))
