"""What is served in batches, and that the bound from it is one."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.model.schedule import Schedule, Scheduled
from cellwright.engine.model.shop import Device, Hold, Job, Moment, Need, Resource, Shop, Stage, in_order
from cellwright.engine.stages.scheduling import ScheduleLimits, devices, horizon, schedule, solver
from cellwright.engine.stages.scheduling.batches import batch_bound, batches
from cellwright.engine.stages.scheduling.bounds import lower_bound
from cellwright.engine.stages.scheduling.lags import Lags
from tests.engine.stages.scheduling.brute import both_ways


def freezers(cold: list[int], room: int, hot: int, change: int, move: int, early: int) -> Shop:
    """Jobs that pass an oven for one (if `hot`) and a freezer for `room`, whose lid is shut while it cools."""
    jobs, windows, holds = [], [], []
    for n, lasts in enumerate(cold):
        into, out = Need("lid", "open", early, move), Need("lid", "open", 0, move)
        stages = [Stage(f"into {n}", move, ("arm",), (into,))]
        stages += [
            Stage(f"cool {n}", lasts, (), (Need("lid", "shut", 0, lasts),)),
            Stage(f"out {n}", move, ("arm",), (out,)),
        ]
        if hot:
            stages = [Stage(f"start {n}", move, ("arm",)), Stage(f"heat {n}", hot), *stages]
            holds.append(Hold("oven", Moment(f"start {n}", move - 1), Moment(f"into {n}", 1)))
        jobs.append(Job(f"job {n}", tuple(stages)))
        windows += in_order(jobs[-1].stages)
        holds.append(Hold("freezer", Moment(f"into {n}", early), Moment(f"out {n}", 1)))
    resources = Resource("arm"), Resource("oven"), Resource("freezer", room)
    lid = Device("lid", "arm", "shut", both_ways("open", "shut", change, change))
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
    """The least makespan, proved without any bound of ours and without what batches tell the solver."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(devices, "batches", lambda _: ())
        found = solver.improve(Lags(shop), 0, horizon(shop, None), None, ScheduleLimits())
    assert isinstance(found, Schedule)
    assert found.proved
    return found.makespan


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(shops)
def test_no_schedule_ends_before_the_bound(shop: Shop) -> None:
    best = optimum(shop)
    assert batch_bound(Lags(shop)) <= best
    assert lower_bound(Lags(shop)) <= best
    found = schedule(shop)
    assert isinstance(found, Scheduled)
    assert found.schedule.makespan == best
    assert found.schedule.proved


def test_a_freezer_for_two_serves_four_in_two_batches() -> None:
    shop = freezers([9, 9, 9, 9], 2, 0, 1, 2, 0)
    (found,) = batches(Lags(shop))
    assert (found.device, found.setting, found.most) == ("lid", "shut", 2)
    assert found.least([9, 9, 9, 9]) == 9 + 9 + 1 + 1 + 2
    assert found.least([9, 5, 3, 1]) == 9 + 3 + 4
    assert found.least([]) == 0
