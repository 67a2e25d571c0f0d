"""A part that is pressed against the rim creeps between the fingers: this is not taken for a
drop into its hole.
"""

from dataclasses import replace

import numpy as np
import pytest

from cellwright.engine.stages.grasping.hole_insertion import (
    HoleSearch,
    Insertion,
    InsertionPhase,
    advance_insertion,
    begin_insertion,
)

PLAN = Insertion(0.03, 0.0001, 0.0015, HoleSearch.SPIRAL)
DT_S = 0.01


@pytest.mark.parametrize(("speed_m_s", "dropped"), [(0.0001, False), (0.005, True)])
def test_a_slow_descent_is_no_drop_and_a_quick_one_is(speed_m_s: float, dropped: bool) -> None:
    at = np.zeros(3)
    now = replace(begin_insertion(at), phase=InsertionPhase.SEARCH, contact=at)
    phases = set()
    for n in range(1000):
        now = advance_insertion(
            PLAN, now, np.array([0.0, 0.0, -speed_m_s * n * DT_S]), PLAN.press_n, DT_S
        )
        phases.add(now.phase)
    assert (InsertionPhase.INSERT in phases) is dropped
