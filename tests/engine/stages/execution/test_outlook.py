"""Starts are forecast as far as their accuracy warrants: intervals that hold, that grow, and
that end at a horizon.
"""

import random
from functools import reduce

from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.model.run_protocol import RunPhase
from cellwright.engine.stages import execution as x
from cellwright.engine.stages.execution import Activity, ActivityProgram
from cellwright.engine.stages.execution.start_forecast import Accuracy, forecast_starts

FAR = 10**9  # a tolerance that is never reached
EXACT = reduce(lambda known, _: known.after(1_000, 1_000), range(500), Accuracy())


def chain(*lasts: int) -> ActivityProgram:
    ends = [sum(lasts[:n]) for n in range(len(lasts))]
    steps = (
        Activity(n, f"s{n}", "arm", each, (n - 1,) if n > 1 else (), ("arm",), ends[n - 1])
        for n, each in enumerate(lasts, 1)
    )
    return ActivityProgram({each.id: each for each in steps})


def fresh(program: ActivityProgram) -> x.ExecutiveState:
    return x.standing_of(program, 0, 1, RunPhase.RUNNING)


def known(spread: float, count: int, seed: int) -> Accuracy:
    chance = random.Random(seed)
    shares = (chance.uniform(-spread, spread) for _ in range(count))
    return reduce(
        lambda so_far, share: so_far.after(round(1e6 * (1 + share)), 10**6), shares, Accuracy()
    )


def test_the_interval_grows_with_the_steps_and_the_seconds_ahead() -> None:
    program = chain(*[10_000] * 12)
    off = [
        w.off_ms
        for w in forecast_starts(program, fresh(program), known(0.2, 30, 1), FAR).values()
        if w is not None
    ]
    assert len(off) == 12
    assert off[0] == 0
    assert off == sorted(off)
    longer = chain(*[100_000] * 12)
    further = forecast_starts(longer, fresh(longer), known(0.2, 30, 1), FAR)[12]
    assert further is not None
    assert further.off_ms > 9 * off[-1]


def test_where_steps_have_taken_what_was_forecast_the_starts_are_those_of_the_forecast() -> None:
    program = chain(*[30_000] * 20)
    for each, window in forecast_starts(program, fresh(program), EXACT).items():
        assert window is not None
        assert abs(window.start_ms - program.activities[each].start_ms) <= 500


def test_steps_that_all_take_longer_move_what_is_left() -> None:
    program = chain(*[30_000] * 20)
    slow = reduce(lambda so_far, _: so_far.after(1_200, 1_000), range(200), Accuracy())
    last = forecast_starts(program, fresh(program), slow, FAR)[20]
    assert last is not None
    assert 1.15 < last.start_ms / program.activities[20].start_ms < 1.25


@given(st.lists(st.integers(0, 300_000), min_size=1, max_size=25), st.integers(0, 40))
@settings(max_examples=30, deadline=None)
def test_behind_the_horizon_no_start_is_told_and_none_before_it_is_too_uncertain(
    lasts: list[int], count: int
) -> None:
    program = chain(*lasts)
    windows = list(forecast_starts(program, fresh(program), known(0.2, count, 1), 30_000).values())
    told = [each for each in windows if each is not None]
    assert windows[: len(told)] == told  # of a chain, the first ones
    assert all(
        each.off_ms <= 30_000 and each.low_ms <= each.start_ms <= each.high_ms for each in told
    )


def test_about_95_of_100_starts_are_in_their_intervals() -> None:
    """Two arms that meet at an oven, with durations that vary evenly by 20 %: run, and compare."""
    steps = [
        Activity(n, f"s{n}", "a", 9_000 + 700 * n, (n - 1,) if n > 1 else (), ("a",), n)
        for n in range(1, 9)
    ]
    steps += [
        Activity(10 + n, f"t{n}", "b", 8_000 + 900 * n, (9 + n,) if n > 1 else (n,), ("b",), n)
        for n in range(1, 9)
    ]
    steps += [
        Activity(20, "meet", "oven", 60_000, (8, 18), ("oven",), 20),
        Activity(21, "out", "a", 5, (20,), ("a",), 21),
    ]
    program, inside, told = ActivityProgram({each.id: each for each in steps}), 0, 0
    for seed in range(150):
        windows = forecast_starts(program, fresh(program), known(0.2, 100, 1_000 + seed), FAR)
        for each, start in begun(program, seed).items():
            window = windows[each]
            assert window is not None
            inside += window.low_ms - 1 <= start <= window.high_ms + 1
            told += start > 0
    assert 0.91 <= (inside - 150) / told <= 0.975


def begun(program: ActivityProgram, seed: int) -> dict[int, int]:
    """When each activity begins if each lasts between 0.8 and 1.2 of its forecast: plainly, one
    after another.
    """
    chance, ends, free, starts = (
        random.Random(seed),
        dict[int, int](),
        dict[str, int](),
        dict[int, int](),
    )
    for each in program.activities.values():
        starts[each.id] = max(
            [0, *(ends[b] for b in each.after), *(free.get(r, 0) for r in each.resources)]
        )
        ends[each.id] = starts[each.id] + round(each.lasts_ms * chance.uniform(0.8, 1.2))
        free |= dict.fromkeys(each.resources, ends[each.id])
    return starts
