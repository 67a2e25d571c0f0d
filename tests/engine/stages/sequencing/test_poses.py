"""Orders and poses together, against all of them; and the layered shortest path against all
choices.
"""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.model.tour_problem import PoseProblem, Visit
from cellwright.engine.stages.sequencing import TourLimits
from cellwright.engine.stages.sequencing.pose_tours import (
    pose_tour_time,
    tour_then_poses,
    with_poses,
)


def problem(n: int, most: int, seed: int) -> PoseProblem:
    """Visits at random places with one to `most` random poses of three joints."""
    rng = np.random.default_rng(seed)
    poses = tuple(rng.uniform(-3, 3, (int(rng.integers(1, most + 1)), 3)) for _ in range(n))
    visits = tuple(Visit(f"v{i}", tuple(map(float, rng.uniform(0, 1, 3)))) for i in range(n))
    return PoseProblem("drawn", visits, poses, np.array([1.0, 2.0, 3.0]))


def least_time(given: PoseProblem, orders: list[tuple[int, ...]]) -> float:
    return min(
        pose_tour_time(given, order, choice)
        for order in orders
        for choice in itertools.product(*(range(len(given.poses[visit])) for visit in order))
    )


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 6), st.integers(0, 10**6))
def test_the_poses_of_an_order_are_the_best_of_all_choices(n: int, seed: int) -> None:
    drawn = problem(n, 4, seed)
    tour = tour_then_poses(drawn)
    assert sorted(tour.order) == list(range(n))
    assert tour.cost == pytest.approx(1e6 * pose_tour_time(drawn, tour.order, tour.poses), abs=1)
    assert tour.cost == pytest.approx(1e6 * least_time(drawn, [tour.order]), abs=1)


@pytest.mark.parametrize("seed", range(3))
def test_eight_visits_of_two_poses_are_toured_as_fast_as_all_orders_and_choices_say(
    seed: int,
) -> None:
    drawn = problem(8, 2, seed)
    tour = with_poses(drawn, TourLimits(work=3000))
    arrays = [q / drawn.speeds for q in drawn.poses]
    best = {(1 << 0, 0, first, first): 0.0 for first in range(len(arrays[0]))}
    for _ in range(7):  # dynamic programming over subsets, for each pose of the first visit
        longer: dict[tuple[int, int, int, int], float] = {}
        for (seen, at, pose, first), time in best.items():
            for to in range(8):
                for other in range(len(arrays[to]) if not seen >> to & 1 else 0):
                    key = (seen | 1 << to, to, other, first)
                    took = time + float(np.abs(arrays[to][other] - arrays[at][pose]).max())
                    longer[key] = min(took, longer.get(key, np.inf))
        best = longer
    ends = ((time, at, pose, first) for (_, at, pose, first), time in best.items())
    least = min(
        time + float(np.abs(arrays[at][pose] - arrays[0][first]).max())
        for time, at, pose, first in ends
    )
    assert tour.cost == pytest.approx(1e6 * least, abs=1)


@pytest.mark.parametrize("seed", range(4))
def test_together_is_never_slower_than_one_after_the_other(seed: int) -> None:
    drawn = problem(40, 6, seed)
    together, baseline = with_poses(drawn), tour_then_poses(drawn)
    assert together.cost <= baseline.cost
    assert together.cost == pytest.approx(
        1e6 * pose_tour_time(drawn, together.order, together.poses), abs=1
    )
    assert sorted(together.order) == list(range(40))


def test_the_same_work_and_seed_give_the_same_poses() -> None:
    drawn = problem(30, 5, 1)
    assert with_poses(drawn) == with_poses(drawn)


def test_an_interrupt_leaves_the_baseline() -> None:
    drawn = problem(30, 5, 2)
    assert (
        with_poses(drawn, TourLimits(interrupted=lambda: True)).cost == tour_then_poses(drawn).cost
    )


def test_a_visit_without_a_position_takes_part() -> None:
    drawn = problem(12, 3, 3)
    visits = (Visit("home"), *drawn.visits[1:])
    tour = with_poses(PoseProblem("home", visits, drawn.poses, drawn.speeds))
    assert tour.order[0] == 0
    assert sorted(tour.order) == list(range(12))
