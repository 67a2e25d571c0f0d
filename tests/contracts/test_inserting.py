"""Pegs and holes in MuJoCo (the extra `mujoco`)."""

import numpy as np
import pytest

from cellwright.engine.stages.grasping.insertion import Insertion, Phase, Search

inserting = pytest.importorskip("cellwright.engine.pipelines.placing.inserting", exc_type=ImportError)


@pytest.mark.parametrize("away", [0.0, 0.0004, 0.0012])
def test_a_peg_that_searches_goes_in_and_one_that_does_not_stays_on_the_rim(away: float) -> None:
    peg, error = inserting.Peg(), away * np.array([np.cos(1.0), np.sin(1.0)])
    room = peg.clearance_m / 2
    found, tilted, stiff = (
        inserting.tried(peg, Insertion(peg.depth_m, room, 0.0015, each, peg.radius_m, peg.length_m), error)
        for each in (Search.SPIRAL, Search.TILT, Search.NONE)
    )
    assert found.phase is tilted.phase is Phase.DONE
    assert (stiff.phase is Phase.DONE) == (away < room)
