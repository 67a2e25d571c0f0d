"""The checker of schedules finds each kind of mistake, and nothing in a schedule without any."""

from dataclasses import replace

import pytest

from cellwright.engine.model.shop_scheduling import (
    Adjustment,
    Changeover,
    Hold,
    Need,
    Resource,
    Schedule,
    Shop,
    ShopDevice,
    ShopJob,
    ShopStage,
    StageMoment,
    StageWindow,
)
from cellwright.engine.stages.scheduling import check_schedule

OPEN, SHUT = Changeover("shut", "open", 2), Changeover("open", "shut", 2)
SHOP = Shop(
    jobs=(
        ShopJob(
            "a",
            (
                ShopStage("bring", 4, ("arm",), (Need("door", "open", 2, 4),), "rack", "oven"),
                ShopStage("bake", 10, (), (Need("door", "shut", 0, 10),)),
            ),
            release=1,
            due=20,
        ),
        ShopJob("b", (ShopStage("wipe", 3, ("arm",), (), "bench", "bench"),)),
    ),
    resources=(
        Resource("arm", 1, {("oven", "bench"): 2, ("bench", "rack"): 1}, "rack"),
        Resource("oven"),
    ),
    windows=(StageWindow(StageMoment("bring", 4), StageMoment("bake"), 0, 5),),
    holds=(Hold("oven", StageMoment("bring", 2), StageMoment("bake", 10)),),
    devices=(ShopDevice("door", "arm", "shut", (OPEN, SHUT)),),
)
GOOD = Schedule(
    {"bring": 3, "bake": 9, "wipe": 11},
    (Adjustment("door", OPEN, 1), Adjustment("door", SHUT, 7)),
    19,
    19,
)


def moved(**starts: int) -> Schedule:
    times = {**GOOD.starts, **starts}
    last = max(times[name] + SHOP.stages[name].duration for name in times)
    return replace(
        GOOD, starts=times, makespan=last, lower_bound=0, tardiness=max(0, times["bake"] + 10 - 20)
    )


def test_a_good_schedule_has_no_faults() -> None:
    assert check_schedule(SHOP, GOOD) == ()


@pytest.mark.parametrize(
    ("schedule", "said"),
    [
        (moved(bring=0), "before a is released"),
        (moved(bake=8), "bake needs door shut from 8 to 18"),
        (moved(bake=14), "bake comes 7 after bring, but at most 5 may pass"),
        (moved(bake=5), "bake comes -2 after bring, but at least 0 must pass"),
        (moved(wipe=8), "arm has capacity 1, but at 8 it serves door to shut, wipe"),
        (moved(wipe=10), None),
        (moved(bring=2), "arm has capacity 1, but at 2 it serves door to open, bring"),
        (replace(GOOD, adjustments=GOOD.adjustments[:1]), "bake needs door shut"),
        (replace(GOOD, adjustments=GOOD.adjustments[1:]), "door is not open at 7"),
        (replace(GOOD, makespan=18), "the makespan is 19, not 18"),
        (replace(GOOD, lower_bound=20), "the lower bound 20 is above the makespan 19"),
        (replace(GOOD, tardiness=1), "the tardiness is 0, not 1"),
        (replace(GOOD, starts={"bring": 3, "bake": 9}), "wipe is never started"),
    ],
)
def test_each_fault_is_named(schedule: Schedule, said: str | None) -> None:
    found = check_schedule(SHOP, schedule)
    assert (found == ()) if said is None else any(said in each for each in found), found


def test_empty_travel_takes_its_time() -> None:
    shop = replace(
        SHOP,
        jobs=(*SHOP.jobs[1:], ShopJob("c", (ShopStage("fetch", 1, ("arm",), (), "rack", "rack"),))),
    )
    shop = replace(shop, windows=(), holds=(), devices=())
    early = Schedule({"wipe": 0, "fetch": 3}, (), 4, 0)
    assert check_schedule(shop, early) == ("arm needs 1 from wipe to fetch, but has 0",)
    assert check_schedule(shop, Schedule({"wipe": 0, "fetch": 4}, (), 5, 0)) == ()


def test_two_objects_do_not_share_a_place() -> None:
    stages = tuple(ShopStage(name, 2) for name in ("a0", "a1", "b0", "b1"))
    jobs = ShopJob("a", stages[:2]), ShopJob("b", stages[2:])
    holds = tuple(Hold("slot", StageMoment(f"{j}0", 1), StageMoment(f"{j}1", 1)) for j in "ab")
    shop = Shop(jobs, (Resource("slot"),), (), holds)
    times = {"a0": 0, "a1": 4, "b0": 3, "b1": 6}
    assert "slot has capacity 1, but at 4" in check_schedule(shop, Schedule(times, (), 8, 0))[0]
    assert check_schedule(shop, Schedule({**times, "b0": 4, "b1": 7}, (), 9, 0)) == ()
    roomy = replace(shop, resources=(Resource("slot", 2),))
    assert check_schedule(roomy, Schedule(times, (), 8, 0)) == ()
