"""What is served in batches, and that the bound from it is one."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.model.shop_scheduling import (
    Hold,
    Need,
    Resource,
    Schedule,
    Shop,
    ShopDevice,
    ShopJob,
    ShopStage,
    StageMoment,
    ValidSchedule,
    chain_windows,
)
from cellwright.engine.stages.scheduling import (
    ScheduleLimits,
    makespan_horizon,
    schedule_shop,
    shop_model,
    shop_solver,
)
from cellwright.engine.stages.scheduling.makespan_bounds import (
    batch_bound,
    makespan_lower_bound,
    service_batches,
)
from cellwright.engine.stages.scheduling.shop_analysis import Lags
from tests.engine.stages.scheduling.brute import both_ways


def freezers(cold: list[int], room: int, hot: int, change: int, move: int, early: int) -> Shop:
    """Jobs that pass an oven for one (if `hot`) and a freezer for `room`, whose lid is shut
    while it cools.
    """
    jobs, windows, holds = [], [], []
    for n, lasts in enumerate(cold):
        into, out = Need("lid", "open", early, move), Need("lid", "open", 0, move)
        stages = [ShopStage(f"into {n}", move, ("arm",), (into,))]
        stages += [
            ShopStage(f"cool {n}", lasts, (), (Need("lid", "shut", 0, lasts),)),
            ShopStage(f"out {n}", move, ("arm",), (out,)),
        ]
        if hot:
            stages = [ShopStage(f"start {n}", move, ("arm",)), ShopStage(f"heat {n}", hot), *stages]
            holds.append(
                Hold("oven", StageMoment(f"start {n}", move - 1), StageMoment(f"into {n}", 1))
            )
        jobs.append(ShopJob(f"job {n}", tuple(stages)))
        windows += chain_windows(jobs[-1].stages)
        holds.append(Hold("freezer", StageMoment(f"into {n}", early), StageMoment(f"out {n}", 1)))
    resources = Resource("arm"), Resource("oven"), Resource("freezer", room)
    lid = ShopDevice("lid", "arm", "shut", both_ways("open", "shut", change, change))
    return Shop(tuple(jobs), resources, tuple(windows), tuple(holds), (lid,))


shops = st.builds(
    freezers,
    st.lists(st.integers(1, 9), min_size=2, max_size=4),
    st.integers(1, 3),
    st.sampled_from((0, 2, 5)),
    st.integers(1, 3),
    st.integers(2, 3),
    st.integers(0, 1),
)


def optimum(shop: Shop) -> int:
    """The least makespan, proved without any bound of ours and without what batches tell the
    solver.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(shop_model, "service_batches", lambda _: ())
        found = shop_solver.improve_schedule(
            Lags(shop), 0, makespan_horizon(shop, None), None, ScheduleLimits()
        )
    assert isinstance(found, Schedule)
    assert found.proved
    return found.makespan


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(shops)
def test_no_schedule_ends_before_the_bound(shop: Shop) -> None:
    best = optimum(shop)
    assert batch_bound(Lags(shop)) <= best
    assert makespan_lower_bound(Lags(shop)) <= best
    found = schedule_shop(shop)
    assert isinstance(found, ValidSchedule)
    assert found.schedule.makespan == best
    assert found.schedule.proved


def test_a_freezer_for_two_serves_four_in_two_batches() -> None:
    shop = freezers([9, 9, 9, 9], 2, 0, 1, 2, 0)
    (found,) = service_batches(Lags(shop))
    assert (found.device, found.setting, found.most) == ("lid", "shut", 2)
    assert found.least([9, 9, 9, 9]) == 9 + 9 + 1 + 1 + 2
    assert found.least([9, 5, 3, 1]) == 9 + 3 + 4
    assert found.least([]) == 0
