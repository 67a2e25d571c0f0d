"""Every schedule of a tiny shop up to some time, one after another: slow and plainly correct."""

import itertools
from collections.abc import Iterator

from cellwright.engine.model.shop_scheduling import (
    Adjustment,
    Changeover,
    Schedule,
    Shop,
    ShopDevice,
)
from cellwright.engine.stages.scheduling.checker import check_schedule


def best(shop: Shop, until: int) -> tuple[int, int] | None:
    """The least tardiness, and the least makespan with it, of all schedules that end by
    `until`; None: there is none.
    """
    found = [
        (each.tardiness, each.makespan)
        for each in schedules(shop, until)
        if not check_schedule(shop, each)
    ]
    return min(found, default=None)


def schedules(shop: Shop, until: int) -> Iterator[Schedule]:
    """Every assignment of start times and changes of devices, valid or not."""
    names = list(shop.stages)
    ranges = [range(until - shop.stages[name].duration + 1) for name in names]
    changes = [list(adjustments(device, until)) for device in shop.devices]
    for times in itertools.product(*ranges):
        for chosen in itertools.product(*changes):
            yield complete(
                shop, dict(zip(names, times, strict=True)), tuple(itertools.chain(*chosen))
            )


def complete(shop: Shop, starts: dict[str, int], made: tuple[Adjustment, ...]) -> Schedule:
    """A schedule with its sums."""
    ends = {name: starts[name] + stage.duration for name, stage in shop.stages.items()}
    late = sum(
        job.priority * max(0, max(ends[stage.name] for stage in job.stages) - job.due)
        for job in shop.jobs
        if job.due is not None
    )
    return Schedule(starts, made, max([0, *ends.values(), *(each.end for each in made)]), 0, late)


def adjustments(device: ShopDevice, until: int, most: int = 3) -> Iterator[tuple[Adjustment, ...]]:
    """Every sequence of at most `most` changes."""

    def further(setting: str, now: int, left: int) -> Iterator[tuple[Adjustment, ...]]:
        yield ()
        for change in device.changes if left else ():
            for start in (
                range(now, until - change.duration + 1) if change.before == setting else ()
            ):
                first = Adjustment(device.name, change, start)
                for rest in further(change.after, start + change.duration, left - 1):
                    yield (first, *rest)

    return further(device.initial, 0, most)


def both_ways(one: str, other: str, there: int, back: int) -> tuple[Changeover, Changeover]:
    """The changes of a device with two settings."""
    return Changeover(one, other, there), Changeover(other, one, back)
