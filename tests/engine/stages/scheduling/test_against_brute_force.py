"""The scheduler agrees with the enumeration of all schedules of tiny shops, with every option."""

from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.model.outcome import Infeasible
from cellwright.engine.model.shop_scheduling import (
    Hold,
    Need,
    Resource,
    Shop,
    ShopDevice,
    ShopJob,
    ShopStage,
    StageMoment,
    StageWindow,
    ValidSchedule,
)
from cellwright.engine.stages.scheduling import check_schedule, schedule_shop
from cellwright.engine.stages.scheduling.beam_construction import Estimates, ScheduleBuilder
from cellwright.engine.stages.scheduling.shop_analysis import CircularLags, Lags
from tests.engine.stages.scheduling.brute import best, both_ways

PLACES = ("", "here", "there")
durations = st.integers(1, 2)
UNTIL = 8


@st.composite
def stages(
    draw: st.DrawFn, name: str, resources: tuple[str, ...], devices: tuple[str, ...] = ()
) -> ShopStage:
    lasts = draw(durations)
    needs = tuple(
        Need(device, draw(st.sampled_from(("open", "shut"))), begin, end)
        for device in devices
        if draw(st.booleans())
        for begin, end in [draw(st.sampled_from(((0, lasts), (0, 1), (lasts - 1, lasts))))]
    )
    held = (draw(st.sampled_from(resources)),)
    return ShopStage(
        name, lasts, held, needs, draw(st.sampled_from(PLACES)), draw(st.sampled_from(PLACES))
    )


@st.composite
def jobs(
    draw: st.DrawFn, name: str, many: int, resources: tuple[str, ...], devices: tuple[str, ...] = ()
) -> ShopJob:
    made = tuple(draw(stages(f"{name}{n}", resources, devices)) for n in range(many))
    due = draw(st.none() | st.integers(1, 6))
    return ShopJob(name, made, draw(st.integers(0, 1)), due, draw(st.integers(1, 3)))


@st.composite
def windows(draw: st.DrawFn, one: ShopStage, other: ShopStage) -> StageWindow:
    first = StageMoment(one.name, draw(st.sampled_from((0, one.duration))))
    last = StageMoment(other.name, draw(st.sampled_from((0, other.duration))))
    least = draw(st.integers(-2, 2))
    return StageWindow(first, last, least, draw(st.none() | st.integers(least, 3)))


pairs = st.tuples(st.sampled_from(PLACES[1:]), st.sampled_from(PLACES[1:]))
# with shortcuts through work that is nowhere
travels = st.dictionaries(pairs, st.integers(0, 2), max_size=4)
# no change of a device is a shortcut
short_travels = st.dictionaries(pairs, st.integers(0, 1), max_size=4)


@st.composite
def shops_with_windows(draw: st.DrawFn) -> Shop:
    """Two jobs of two stages: capacities, travel, holds, dwell windows, release and due times."""
    made = (draw(jobs("a", 2, ("arm", "oven"))), draw(jobs("b", 2, ("arm", "oven"))))
    ties = [draw(windows(*job.stages)) for job in made]
    ties += [draw(windows(made[0].stages[0], made[1].stages[1]))] if draw(st.booleans()) else []
    holds = tuple(
        Hold(
            "slot",
            StageMoment(job.stages[0].name, draw(st.integers(0, 1))),
            StageMoment(job.stages[1].name, 1),
        )
        for job in made
        if draw(st.booleans())
    )
    arm = Resource("arm", 1, draw(travels), draw(st.sampled_from(PLACES)))
    oven = Resource("oven", draw(st.integers(1, 2)))
    return Shop(made, (arm, oven, Resource("slot", draw(st.integers(1, 2)))), tuple(ties), holds)


@st.composite
def shops_with_devices(draw: st.DrawFn) -> Shop:
    """Three stages of one or two jobs with a door that the arm opens and shuts."""
    two = draw(st.booleans())
    made = [draw(jobs("a", 2, ("arm", "oven"), ("door",)))]
    made += [draw(jobs("b", 1, ("arm", "oven"), ("door",)))] if two else []
    ways = both_ways("open", "shut", draw(st.integers(1, 2)), draw(st.integers(1, 2)))
    door = ShopDevice(
        "door",
        "arm",
        draw(st.sampled_from(("open", "shut"))),
        ways,
        draw(st.sampled_from(("", "open"))),
    )
    arm = Resource("arm", 1, draw(short_travels), draw(st.sampled_from(PLACES)))
    return Shop(
        tuple(made), (arm, Resource("oven", 2)), (draw(windows(*made[0].stages)),), (), (door,)
    )


def agrees(shop: Shop, until: int) -> None:
    found = schedule_shop(shop)
    if isinstance(found, Infeasible):
        assert best(shop, until) is None
        return
    assert isinstance(found, ValidSchedule)
    made = found.schedule
    assert check_schedule(shop, made) == ()
    assert made.proved
    expected = best(shop, min(until, made.makespan))
    if made.makespan <= until:
        assert expected == (made.tardiness, made.makespan)
    else:
        assert expected is None or expected >= (made.tardiness, made.makespan)


@settings(max_examples=20, deadline=None)
@given(shops_with_windows())
def test_schedules_with_windows_are_as_short_as_the_best_of_all(shop: Shop) -> None:
    agrees(shop, 7)


@settings(max_examples=20, deadline=None)
@given(shops_with_devices())
def test_schedules_with_devices_are_as_short_as_the_best_of_all(shop: Shop) -> None:
    agrees(shop, 6)


class Whole(Estimates):
    """Estimates that look at all resources after each stage."""

    def _concerned(self, stage: ShopStage) -> list[str]:
        return list(self.served) if stage else []


@given(st.one_of(shops_with_windows(), shops_with_devices()))
def test_an_estimate_need_only_look_at_what_a_stage_concerns(shop: Shop) -> None:
    lags = Lags(shop)
    try:
        one, other = ScheduleBuilder(lags), ScheduleBuilder(lags)
        other.estimates = Whole(lags)
        found = [one.beam(width) for width in (1, 6)]
    except CircularLags:
        return
    assert found == [other.beam(width) for width in (1, 6)]
