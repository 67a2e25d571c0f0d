"""Schedules of shops: bounds are bounds, answers repeat, symmetric jobs keep their order."""

import random
import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.model.outcome import GaveUp, Infeasible
from cellwright.engine.model.shop_scheduling import (
    Resource,
    Shop,
    ShopJob,
    ShopStage,
    StageMoment,
    StageWindow,
    ValidSchedule,
    chain_windows,
)
from cellwright.engine.stages.scheduling import ScheduleLimits, check_schedule, schedule_shop
from cellwright.engine.stages.scheduling.beam_construction import construct_schedule
from cellwright.engine.stages.scheduling.makespan_bounds import jackson_bound, makespan_lower_bound
from cellwright.engine.stages.scheduling.shop_analysis import Lags, alike_jobs


def job_shop(jobs: int, machines: int, seed: int) -> Shop:
    numbers = random.Random(seed)
    made = []
    for job in range(jobs):
        order = numbers.sample(range(machines), machines)
        stages = (ShopStage(f"{job}.{m}", numbers.randint(1, 20), (f"m{m}",)) for m in order)
        made.append(ShopJob(f"job {job}", tuple(stages)))
    windows = tuple(window for each in made for window in chain_windows(each.stages))
    return Shop(tuple(made), tuple(Resource(f"m{m}") for m in range(machines)), windows)


def solved(shop: Shop, limits: ScheduleLimits = ScheduleLimits()) -> ValidSchedule:
    found = schedule_shop(shop, limits)
    assert isinstance(found, ValidSchedule)
    return found


works = st.lists(
    st.tuples(st.integers(0, 9), st.integers(1, 6), st.integers(0, 9)), min_size=1, max_size=7
)


@given(works)
def test_jackson_is_the_greatest_bound_of_any_subset(
    given_works: list[tuple[int, int, int]],
) -> None:
    bounds = [
        min(head for head, _, _ in chosen)
        + sum(size for _, size, _ in chosen)
        + min(tail for *_, tail in chosen)
        for mask in range(1, 1 << len(given_works))
        for chosen in [[work for n, work in enumerate(given_works) if mask >> n & 1]]
    ]
    assert jackson_bound(given_works) == max(bounds)  # Carlier 1982, proposition 2


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 10_000))
def test_job_shops_are_proved_and_bounded(seed: int) -> None:
    shop = job_shop(4, 4, seed)
    made = solved(shop).schedule
    assert made.proved
    assert makespan_lower_bound(Lags(shop)) <= made.makespan
    first = construct_schedule(Lags(shop), 0)
    assert first is not None
    assert check_schedule(shop, first) == ()
    assert first.makespan >= made.makespan


@pytest.mark.slow
def test_the_same_work_gives_the_same_schedule() -> None:
    shop = job_shop(6, 6, 3)
    one, other = (solved(shop, ScheduleLimits(work=0.02)).schedule for _ in range(2))
    assert one == other


def test_workers_may_race() -> None:
    assert solved(job_shop(5, 5, 1), ScheduleLimits(workers=2)).schedule.proved


def test_an_interruption_ends_the_search_with_the_best_so_far() -> None:
    started = time.monotonic()
    found = solved(
        job_shop(12, 12, 1), ScheduleLimits(interrupted=lambda: time.monotonic() > started + 0.1)
    )
    assert time.monotonic() < started + 20
    assert found.schedule.lower_bound <= found.schedule.makespan


def test_without_work_there_is_the_first_schedule() -> None:
    found = schedule_shop(job_shop(6, 6, 2), ScheduleLimits(work=0.0))
    assert isinstance(found, ValidSchedule | GaveUp)


def test_windows_that_contradict_each_other_are_infeasible() -> None:
    stages = ShopStage("a", 3), ShopStage("b", 3)
    wanted = (
        StageWindow(StageMoment("a", 3), StageMoment("b"), 0),
        StageWindow(StageMoment("a"), StageMoment("b"), -9, 2),
    )
    assert isinstance(schedule_shop(Shop((ShopJob("j", stages),), (), wanted)), Infeasible)


def test_a_dwell_window_moves_what_comes_before_it() -> None:
    """The oven is needed at 10 by another job; the dough, mixed too early, would wait too long."""
    mix, bake, other = (
        ShopStage("mix", 2),
        ShopStage("bake", 5, ("oven",)),
        ShopStage("other", 10, ("oven",)),
    )
    windows = (
        StageWindow(StageMoment("mix", 2), StageMoment("bake"), 0, 1),
        StageWindow(StageMoment("other"), StageMoment("bake"), 10),
    )
    made = solved(
        Shop((ShopJob("bread", (mix, bake)), ShopJob("o", (other,))), (Resource("oven"),), windows)
    ).schedule
    assert made.makespan == 15
    assert 7 <= made.starts["mix"] <= 8


def test_who_is_due_comes_first_whatever_the_makespan() -> None:
    jobs = (
        ShopJob("early", (ShopStage("e", 4, ("m",)),), due=4),
        ShopJob("late", (ShopStage("l", 3, ("m",)),), due=5, priority=5),
    )
    made = solved(Shop(jobs, (Resource("m"),))).schedule
    assert made.starts == {"l": 0, "e": 3}
    assert made.tardiness == 3
    assert made.proved


def test_equal_jobs_are_alike_and_others_are_not() -> None:
    jobs = tuple(
        ShopJob(f"j{n}", (ShopStage(f"a{n}", 2, ("m",)), ShopStage(f"b{n}", 3))) for n in range(3)
    )
    windows = tuple(window for job in jobs[:2] for window in chain_windows(job.stages))
    groups = alike_jobs(Shop(jobs, (Resource("m"),), windows))
    assert [[job.name for job in group] for group in groups] == [["j0", "j1"]]


def test_setups_between_families_are_kept_apart_from_places() -> None:
    """Set-ups that do not obey the triangle inequality need the sequence, not only pairs."""
    setups = {("x", "z"): 9, ("x", "y"): 1, ("y", "z"): 1}
    stages = [ShopStage(name, 1, ("m",), (), name, name) for name in "xyz"]
    order = (
        StageWindow(StageMoment("x"), StageMoment("y")),
        StageWindow(StageMoment("y"), StageMoment("z")),
    )
    jobs = tuple(ShopJob(stage.name, (stage,)) for stage in stages)
    made = solved(Shop(jobs, (Resource("m", 1, setups, "x"),), order)).schedule
    assert made.makespan == 5


@pytest.mark.parametrize("asked", [0, 1, 7, 20])
def test_an_interrupted_first_schedule_is_a_schedule(asked: int) -> None:
    shop, questions = job_shop(5, 5, 1), iter(range(10**6))
    first = construct_schedule(Lags(shop), 0, lambda: next(questions) >= asked)
    assert first is not None
    assert not check_schedule(shop, first)
