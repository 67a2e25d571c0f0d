"""Pegs and holes in MuJoCo (the extra `mujoco`)."""

import numpy as np
import pytest

from cellwright.engine.stages.grasping.hole_insertion import HoleSearch, Insertion, InsertionPhase

inserting = pytest.importorskip("benchmarks.peg_insertion", exc_type=ImportError)


@pytest.mark.parametrize("away", [0.0, 0.0004, 0.0012])
def test_a_peg_that_searches_goes_in_and_one_that_does_not_stays_on_the_rim(away: float) -> None:
    peg, error = inserting.RoundPeg(), away * np.array([np.cos(1.0), np.sin(1.0)])
    room = peg.clearance_m / 2
    found, tilted, stiff = (
        inserting.simulate_insertion(
            peg, Insertion(peg.depth_m, room, 0.0015, each, peg.radius_m, peg.length_m), error
        )
        for each in (HoleSearch.SPIRAL, HoleSearch.TILT, HoleSearch.NONE)
    )
    assert found.phase is tilted.phase is InsertionPhase.DONE
    assert (stiff.phase is InsertionPhase.DONE) == (away < room)
