"""The spiral leads over the hole, wherever it is within what is doubted."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.kernels.arrays import Floats
from engine.stages.grasping.insertion import Insertion, Phase, advance, begun, planned

ROOM_M, DT_S = 0.0002, 0.004


def ended(plan: Insertion, error: Floats, looks: int = 40_000) -> Phase:
    """The phase in which an insertion ends, with a part that goes where it is told, and in where there is room."""
    at, force = np.array([*error, 0.004]), 0.0
    now = begun(at)
    for _ in range(looks):
        now = advance(plan, now, at, force, DT_S)
        inside = float(np.hypot(*now.target[:2])) < plan.room_m or at[2] < -1e-4
        wanted = now.target[2] if now.phase is Phase.APPROACH else at[2] - 0.0004
        height = wanted if inside else max(wanted, 0.0)
        force = 8.0 if height > wanted else 0.0
        at = np.array([*now.target[:2], height])
        if now.phase in (Phase.DONE, Phase.FAILED):
            break
    return now.phase


@settings(max_examples=25, deadline=None)
@given(st.floats(0, 2 * np.pi), st.floats(0, 0.0015))
def test_a_hole_within_the_doubt_is_found(angle: float, away: float) -> None:
    plan = Insertion(0.01, ROOM_M, 0.0015, True)
    assert ended(plan, away * np.array([np.cos(angle), np.sin(angle)])) is Phase.DONE


def test_a_hole_beyond_the_doubt_is_given_up() -> None:
    assert ended(Insertion(0.01, ROOM_M, 0.001, True), np.array([0.003, 0.0])) is Phase.FAILED


def test_a_part_within_its_room_goes_straight_in() -> None:
    assert ended(Insertion(0.01, ROOM_M, 0.0001, False), np.array([0.0001, 0.0])) is Phase.DONE


@pytest.mark.parametrize(("sigma", "searches"), [(0.00005, False), (0.0005, True)])
def test_a_search_is_chosen_where_three_sigma_exceed_the_room(sigma: float, searches: bool) -> None:
    assert planned(0.01, ROOM_M, np.diag([sigma**2, sigma**2 / 4])).searches is searches
