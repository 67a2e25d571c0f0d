"""The spiral leads over the hole, wherever it is within what is doubted."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.stages.grasping.hole_insertion import (
    HoleSearch,
    Insertion,
    InsertionPhase,
    advance_insertion,
    begin_insertion,
    plan_insertion,
)

ROOM_M, DT_S = 0.0002, 0.004


def ended(plan: Insertion, error: Floats, looks: int = 40_000) -> InsertionPhase:
    """The phase in which an insertion ends, with a part that goes where it is told, and in
    where there is room.
    """
    at, force = np.array([*error, 0.004]), 0.0
    now = begin_insertion(at)
    for _ in range(looks):
        now = advance_insertion(plan, now, at, force, DT_S)
        inside = float(np.hypot(*now.target[:2])) < plan.room_m or at[2] < -1e-4
        wanted = now.target[2] if now.phase is InsertionPhase.APPROACH else at[2] - 0.0004
        height = wanted if inside else max(wanted, 0.0)
        force = 8.0 if height > wanted else 0.0
        at = np.array([*now.target[:2], height])
        if now.phase in (InsertionPhase.DONE, InsertionPhase.FAILED):
            break
    return now.phase


@settings(max_examples=25, deadline=None)
@given(st.floats(0, 2 * np.pi), st.floats(0, 0.0015))
def test_a_hole_within_the_doubt_is_found(angle: float, away: float) -> None:
    plan = Insertion(0.01, ROOM_M, 0.0015, HoleSearch.SPIRAL)
    assert ended(plan, away * np.array([np.cos(angle), np.sin(angle)])) is InsertionPhase.DONE


def test_a_hole_beyond_the_doubt_is_given_up() -> None:
    assert (
        ended(Insertion(0.01, ROOM_M, 0.001, HoleSearch.SPIRAL), np.array([0.003, 0.0]))
        is InsertionPhase.FAILED
    )


def test_a_part_within_its_room_goes_straight_in() -> None:
    assert (
        ended(Insertion(0.01, ROOM_M, 0.0001, HoleSearch.NONE), np.array([0.0001, 0.0]))
        is InsertionPhase.DONE
    )


@pytest.mark.parametrize(("sigma", "searches"), [(0.00005, False), (0.0005, True)])
def test_a_search_is_chosen_where_three_sigma_exceed_the_room(sigma: float, searches: bool) -> None:
    assert plan_insertion(0.01, ROOM_M, np.diag([sigma**2, sigma**2 / 4])).search is (
        HoleSearch.SPIRAL if searches else HoleSearch.NONE
    )


def test_a_round_part_is_tilted_where_the_spiral_would_take_longer_and_its_edge_is_sure_to_meet_the_hole() -> (
    None
):
    doubt = np.diag([0.0005**2, 0.0005**2])
    assert (
        plan_insertion(0.01, 0.0001, doubt, radius_m=0.01, length_m=0.05).search is HoleSearch.TILT
    )
    assert (
        plan_insertion(0.01, 0.0004, doubt, radius_m=0.01, length_m=0.05).search
        is HoleSearch.SPIRAL
    )
    assert (
        plan_insertion(0.01, 0.0001, doubt, radius_m=0.004, length_m=0.05).search
        is HoleSearch.SPIRAL
    )


def test_a_part_that_is_led_past_every_wall_is_given_up() -> None:
    plan = Insertion(0.01, ROOM_M, 0.0005, HoleSearch.TILT, 0.01, 0.05)
    at, now = np.array([0.0, 0.0, 0.004]), begin_insertion(np.zeros(3), plan)
    for _ in range(20_000):
        now = advance_insertion(plan, now, at, 8.0 if at[2] <= 0.0 else 0.0, DT_S)
        at = np.array([*now.target[:2], max(now.target[2], 0.0)])
    assert now.phase is InsertionPhase.FAILED
