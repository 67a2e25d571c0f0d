"""The checker of schedules against a replay minute by minute, and each of its rules at its
boundary.
"""

import itertools
from dataclasses import replace

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

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
from tests.engine.stages.scheduling.brute import complete
from tests.engine.stages.scheduling.test_against_brute_force import (
    shops_with_devices,
    shops_with_windows,
)

KINDS = {
    "is released at": "release",
    "at least": "window",
    "at most": "window",
    ", but at ": "load",
    "before it begins": "hold",
    " from the start to ": "travel",
    ", but has ": "travel",
    "cannot change": "device",
    " is not ": "device",
    "is left": "device",
    " needs door ": "need",
}


def kinds(found: tuple[str, ...]) -> set[str]:
    """Which rules the checker says are broken."""
    return {next(kind for said, kind in KINDS.items() if said in each) for each in found}


def replayed(shop: Shop, made: Schedule) -> set[str]:
    """Which rules are broken, seen minute by minute."""
    broken = (
        {"release"}
        if any(each < max(0, shop.owners[n].release) for n, each in made.starts.items())
        else set()
    )
    for window in shop.windows:
        waited = moment(made, window.later) - moment(made, window.earlier)
        if waited < window.least or (window.most is not None and waited > window.most):
            broken.add("window")
    if any(moment(made, hold.end) < moment(made, hold.begin) for hold in shop.holds):
        broken.add("hold")
    if any(crowded(shop, made, resource) for resource in shop.resources):
        broken.add("load")
    if any(hurried(shop, made, resource) for resource in shop.resources):
        broken.add("travel")
    return broken.union(*(devices(shop, made, device) for device in shop.devices))


def crowded(shop: Shop, made: Schedule, resource: Resource) -> bool:
    """Whether more units are taken in some minute than there are."""
    taken = [
        range(made.starts[name], made.starts[name] + stage.duration)
        for name, stage in shop.stages.items()
        if resource.name in stage.resources
    ]
    taken += [
        range(moment(made, hold.begin), moment(made, hold.end))
        for hold in shop.holds
        if hold.resource == resource.name
    ]
    taken += [
        range(each.start, each.end)
        for each in made.adjustments
        if shop.device[each.device].operator == resource.name
    ]
    return any(
        sum(minute in each for each in taken) > resource.capacity for minute in range(-5, 30)
    )


def moment(made: Schedule, when: StageMoment | None) -> int:
    assert when is not None
    return made.starts[when.stage] + when.offset


def hurried(shop: Shop, made: Schedule, resource: Resource) -> bool:
    """Whether the way to some piece of work takes longer than there is."""
    works = [
        (made.starts[name], made.starts[name] + stage.duration, stage.origin, stage.destination)
        for name, stage in shop.stages.items()
        if resource.name in stage.resources
    ]
    works += [
        (each.start, each.end, each.change.origin, each.change.destination)
        for each in made.adjustments
        if shop.device[each.device].operator == resource.name
    ]
    works = [(0, 0, "", resource.home), *sorted(works)]
    return any(
        other[0] - one[1] < resource.travel.get((one[3], other[2]), 0)
        for one, other in itertools.pairwise(works)
        if resource.travel
    )


def devices(shop: Shop, made: Schedule, device: ShopDevice) -> set[str]:
    """What is wrong with a device whose setting is followed from minute to minute."""
    broken = set()
    setting, free = device.initial, 0
    settings_at = dict.fromkeys(range(-9, 0), setting)
    for each in sorted(
        (e for e in made.adjustments if e.device == device.name), key=lambda e: (e.start, e.end)
    ):
        if each.change not in device.changes or each.change.before != setting or each.start < free:
            broken.add("device")
        settings_at |= dict.fromkeys(range(free, each.start), setting)
        settings_at |= dict.fromkeys(range(each.start, each.end), "changing")
        setting, free = each.change.after, each.end
    settings_at |= dict.fromkeys(range(free, 40), setting)
    if device.final and setting != device.final:
        broken.add("device")
    for name, stage in shop.stages.items():
        for need in stage.needs:
            minutes = range(made.starts[name] + need.begin, made.starts[name] + need.end)
            if "device" not in broken and any(
                settings_at.get(minute) != need.setting for minute in minutes
            ):
                broken.add("need")
    return broken


@st.composite
def timed(draw: st.DrawFn) -> tuple[Shop, Schedule]:
    """A shop with a schedule that has right sums, and whatever start times."""
    shop = draw(shops_with_windows() | shops_with_devices())
    starts = {name: draw(st.integers(-1, 7)) for name in shop.stages}
    made = []
    for device in shop.devices:
        setting, now = device.initial, 0
        for _ in range(draw(st.integers(0, 2))):
            change = draw(
                st.sampled_from(
                    [c for c in device.changes if c.before == setting] * 5 + [*device.changes]
                )
            )
            now = draw(st.integers(max(0, now - 1), now + 3))
            made.append(Adjustment(device.name, change, now))
            setting, now = change.after, now + change.duration
    return shop, complete(shop, starts, tuple(made))


@settings(max_examples=100, deadline=None, suppress_health_check=list(HealthCheck))
@given(timed())
def test_the_checker_names_the_rules_that_a_replay_finds_broken(
    case: tuple[Shop, Schedule],
) -> None:
    shop, made = case
    found, expected = kinds(check_schedule(shop, made)), replayed(shop, made)
    if "device" in expected:  # of a device that is changed wrongly nobody knows its settings
        found, expected = found - {"need"}, expected - {"need"}
    assert found == expected


# Boundaries, one rule at a time.

ARM = Resource("arm")
ONE = Shop((ShopJob("a", (ShopStage("one", 3, ("arm",)),), release=2),), (ARM,))


def at(*starts: int, shop: Shop = ONE, **changes: object) -> Schedule:
    """The stages of a shop at these times, with right sums but for `changes`."""
    made = complete(shop, dict(zip(shop.stages, starts, strict=True)), ())
    return replace(made, **changes)  # type: ignore[arg-type]


def test_no_stage_starts_before_its_job_is_released() -> None:
    assert check_schedule(ONE, at(2)) == ()
    assert check_schedule(ONE, at(1)) == ("one starts at 1, before a is released at 2",)


def test_no_stage_starts_before_all_begins_even_if_it_was_released_earlier() -> None:
    early = replace(ONE, jobs=(replace(ONE.jobs[0], release=-5),))
    assert check_schedule(early, at(0)) == ()
    assert check_schedule(early, at(-1)) == ("one starts at -1, before a is released at -5",)


def test_every_stage_is_started() -> None:
    assert check_schedule(ONE, Schedule({}, (), 0, 0)) == ("one is never started",)


PAIR = Shop((ShopJob("a", (ShopStage("one", 3), ShopStage("two", 2))),), (Resource("slot"),))


@pytest.mark.parametrize(
    ("start", "wrong"), [(4, "at least 2"), (5, ""), (6, ""), (7, "at most 3")]
)
def test_windows_are_kept_to_the_minute(start: int, wrong: str) -> None:
    shop = replace(PAIR, windows=(StageWindow(StageMoment("one", 3), StageMoment("two"), 2, 3),))
    found = check_schedule(shop, at(0, start, shop=shop))
    assert len(found) == bool(wrong)
    assert all(wrong in each for each in found)


def test_a_window_without_an_end_is_never_too_long() -> None:
    shop = replace(PAIR, windows=(StageWindow(StageMoment("one", 3), StageMoment("two"), 2),))
    assert check_schedule(shop, at(0, 500, shop=shop)) == ()


def test_a_resource_is_taken_from_the_first_minute_to_the_last() -> None:
    jobs = tuple(ShopJob(name, (ShopStage(name, 3, ("arm",)),)) for name in ("a", "b", "c"))
    shop = Shop(jobs, (ARM,))
    assert check_schedule(shop, at(0, 3, 6, shop=shop)) == ()
    assert check_schedule(shop, at(0, 2, 5, shop=shop)) == (
        "arm has capacity 1, but at 2 it serves a, b",
    )
    two = replace(shop, resources=(replace(ARM, capacity=2),))
    assert check_schedule(two, at(0, 2, 3, shop=two)) == ()
    assert check_schedule(two, at(0, 1, 2, shop=two)) == (
        "arm has capacity 2, but at 2 it serves a, b, c",
    )


def test_of_each_resource_the_first_conflict_is_named() -> None:
    jobs = tuple(ShopJob(name, (ShopStage(name, 3, ("arm", "oven")),)) for name in ("a", "b", "c"))
    shop = Shop(jobs, (ARM, Resource("oven")))
    assert check_schedule(shop, at(0, 1, 2, shop=shop)) == (
        "arm has capacity 1, but at 1 it serves a, b",
        "oven has capacity 1, but at 1 it serves a, b",
    )


@pytest.mark.parametrize(
    ("hold", "found"),
    [
        (Hold("slot", StageMoment("one", 3), StageMoment("two")), ()),
        (Hold("slot", StageMoment("one", 3), StageMoment("one", 3)), ()),
        (
            Hold("slot", StageMoment("two"), StageMoment("one", 3)),
            ("the hold of two ends at 3, before it begins",),
        ),
        (
            Hold("slot", StageMoment("one", 3), None),
            ("slot has capacity 1, but at 5 it serves hold of one, two",),
        ),
        (Hold("slot", None, StageMoment("one", 3)), ()),
        (
            Hold("slot", None, StageMoment("two", 1)),
            ("slot has capacity 1, but at 5 it serves hold of two, two",),
        ),
        (
            Hold("slot", None, None),
            ("slot has capacity 1, but at 5 it serves hold of no stage, two",),
        ),
        (
            Hold("slot", StageMoment("one", 3), StageMoment("two", 1)),
            ("slot has capacity 1, but at 5 it serves hold of one, two",),
        ),
        (Hold("other", None, None), ()),
    ],
)
def test_what_is_held_is_taken_from_its_beginning_to_its_end(
    hold: Hold, found: tuple[str, ...]
) -> None:
    """A hold without a beginning is from the start, one without an end is for good."""
    job = ShopJob("a", (ShopStage("one", 3), ShopStage("two", 2, ("slot",))))
    shop = Shop((job,), (Resource("slot"), Resource("other")), (), (hold,))
    assert check_schedule(shop, at(0, 5, shop=shop)) == found


def test_a_hold_without_a_beginning_is_there_at_time_zero() -> None:
    job = ShopJob("a", (ShopStage("one", 1, ("slot",)), ShopStage("two", 2)))
    shop = Shop((job,), (Resource("slot"),), (), (Hold("slot", None, StageMoment("one", 1)),))
    assert check_schedule(shop, at(0, 5, shop=shop)) == (
        "slot has capacity 1, but at 0 it serves hold of one, one",
    )


def test_a_hold_for_good_lasts_beyond_the_end() -> None:
    last = ShopJob("b", (ShopStage("last", 1),))
    shop = Shop((last,), (Resource("slot"),), (), (Hold("slot", StageMoment("last", 1), None),) * 2)
    assert check_schedule(shop, at(4, shop=shop)) == (
        "slot has capacity 1, but at 5 it serves hold of last, hold of last",
    )
    late = replace(shop, holds=(Hold("slot", StageMoment("last", 9), None),) * 2)
    assert check_schedule(late, at(4, shop=late)) == (
        "slot has capacity 1, but at 13 it serves hold of last, hold of last",
    )


WAYS = Resource("arm", 1, {("rack", "oven"): 2, ("oven", "rack"): 3, ("oven", "bench"): 1}, "rack")
OVEN = ShopStage("bake", 4, ("arm",), (), "oven", "oven")
RACK = ShopStage("store", 1, ("arm",), (), "rack", "bench")


@pytest.mark.parametrize(
    ("bake", "store", "found"),
    [
        (2, 9, ()),
        (1, 9, ("arm needs 2 from the start to bake, but has 1",)),
        (2, 8, ("arm needs 3 from bake to store, but has 2",)),
        (1, 0, ()),
    ],
)
def test_a_resource_that_travels_has_the_time_for_it(
    bake: int, store: int, found: tuple[str, ...]
) -> None:
    shop = Shop((ShopJob("a", (OVEN, RACK)),), (WAYS, Resource("cart", 1, {("", ""): 99})))
    assert check_schedule(shop, at(bake, store, shop=shop)) == found


def test_a_resource_that_changes_a_device_travels_to_it() -> None:
    door = ShopDevice("door", "arm", "shut", (Changeover("shut", "open", 2, "oven", "bench"),))
    shop = Shop((ShopJob("a", (RACK,)),), (WAYS,), (), (), (door,))
    opening = Adjustment("door", door.changes[0], 3)
    assert check_schedule(shop, complete(shop, {"store": 0}, (opening,))) == ()
    assert check_schedule(shop, complete(shop, {"store": 6}, (opening,))) == ()
    early = replace(opening, start=1)
    assert check_schedule(shop, complete(shop, {"store": 6}, (early,))) == (
        "arm needs 2 from the start to door to open, but has 1",
    )
    back = replace(shop, resources=(replace(WAYS, travel={("bench", "rack"): 2}),))
    assert check_schedule(back, complete(back, {"store": 6}, (opening,))) == (
        "arm needs 2 from door to open to store, but has 1",
    )


# Devices.

OPEN, SHUT = Changeover("shut", "open", 2), Changeover("open", "shut", 3)
DOOR = ShopDevice("door", "arm", "shut", (OPEN, SHUT))


def cell(begin: int = 1, end: int = 3, setting: str = "open", final: str = "") -> Shop:
    """One stage that needs a door for a part of its time."""
    stage = ShopStage("bake", 4, (), (Need("door", setting, begin, end),))
    return Shop((ShopJob("a", (stage,)),), (ARM,), (), (), (replace(DOOR, final=final),))


def doors(
    start: int, *changes: tuple[Changeover, int], shop: Shop | None = None
) -> tuple[str, ...]:
    shop = shop or cell()
    return check_schedule(
        shop, complete(shop, {"bake": start}, tuple(Adjustment("door", c, t) for c, t in changes))
    )


def test_a_device_stands_as_it_is_needed_to_the_minute() -> None:
    assert doors(1, (OPEN, 0)) == ()
    assert doors(0, (OPEN, 0)) == ("bake needs door open from 1 to 3",)
    assert doors(1, (OPEN, 0), (SHUT, 4)) == ()
    assert doors(1, (OPEN, 0), (SHUT, 3)) == ("bake needs door open from 2 to 4",)
    assert doors(0) == ("bake needs door open from 1 to 3",)
    assert doors(0, shop=cell(setting="shut")) == ()
    assert doors(4, (OPEN, 0), (SHUT, 2), shop=cell(setting="shut")) == ()
    assert doors(3, (OPEN, 0), (SHUT, 2), shop=cell(setting="shut")) == (
        "bake needs door shut from 4 to 6",
    )
    assert doors(4, (OPEN, 0), (SHUT, 2)) == ("bake needs door open from 5 to 7",)


def test_a_device_is_changed_from_where_it_is_and_once_at_a_time() -> None:
    idle = replace(cell(), jobs=(ShopJob("a", (ShopStage("bake", 4),)),))
    assert doors(0, (OPEN, 0), (SHUT, 2), shop=idle) == ()
    assert doors(0, (SHUT, 0), shop=idle) == ("door is not open at 0",)
    assert doors(0, (OPEN, -1), shop=idle) == ("door is not shut at -1",)
    free = replace(idle, resources=(replace(ARM, capacity=2),))
    assert doors(0, (OPEN, 0), (SHUT, 1), shop=free) == ("door is not open at 1",)
    assert doors(0, (Changeover("shut", "ajar", 1), 0), shop=idle) == (
        "door cannot change from shut to ajar",
    )
    assert doors(0, (SHUT, 5), (OPEN, 0), shop=idle) == ()  # they come in the order of time


def test_a_device_is_left_as_it_must_be() -> None:
    assert doors(1, (OPEN, 0), shop=cell(final="open")) == ()
    assert doors(1, (OPEN, 0), shop=cell(final="shut")) == ("door is left open, not shut",)
    assert doors(1, (OPEN, 0), (SHUT, 4), shop=cell(final="shut")) == ()


# Sums.


def test_the_makespan_is_the_end_of_all_work() -> None:
    assert check_schedule(ONE, at(2, makespan=5)) == ()
    assert check_schedule(ONE, at(2, makespan=6)) == ("the makespan is 5, not 6",)
    idle = replace(cell(), jobs=())
    opened = Schedule({}, (Adjustment("door", OPEN, 3),), 5, 0)
    assert check_schedule(idle, opened) == ()
    assert check_schedule(Shop((), ()), Schedule({}, (), 0, 0)) == ()


def test_the_lower_bound_is_at_most_the_makespan() -> None:
    assert check_schedule(ONE, at(2, lower_bound=5)) == ()
    assert check_schedule(ONE, at(2, lower_bound=6)) == (
        "the lower bound 6 is above the makespan 5",
    )


def test_tardiness_is_the_weighted_sum_of_what_jobs_end_too_late() -> None:
    jobs = (
        ShopJob("a", (ShopStage("one", 3), ShopStage("two", 2)), due=6, priority=5),
        ShopJob("b", (ShopStage("three", 1),), due=4, priority=2),
        ShopJob("c", (ShopStage("four", 9),)),
        ShopJob("d", (), due=0, priority=7),
    )
    shop = Shop(jobs, ())
    starts = dict(zip(shop.stages, (6, 0, 9, 0), strict=True))
    made = Schedule(starts, (), 10, 0, 5 * 3 + 2 * 6)
    assert check_schedule(shop, made) == ()
    assert check_schedule(shop, replace(made, tardiness=26)) == ("the tardiness is 27, not 26",)
    early = Schedule({**starts, "one": 3, "three": 0}, (), 9, 0, 0)
    assert check_schedule(shop, early) == ()


def test_a_change_of_a_device_takes_only_the_resource_that_makes_it() -> None:
    """Resources before and after its name in the alphabet are free, and need no way to the
    device.
    """
    others = [Resource(name, 1, {("home", "door"): 9}, "home") for name in ("aisle", "cart")]
    door = ShopDevice("door", "arm", "shut", (Changeover("shut", "open", 2, "door", "door"),))
    shop = Shop(
        (ShopJob("a", (ShopStage("wait", 3, ("aisle", "cart")),)),), (ARM, *others), (), (), (door,)
    )
    assert (
        check_schedule(shop, complete(shop, {"wait": 0}, (Adjustment("door", door.changes[0], 1),)))
        == ()
    )
