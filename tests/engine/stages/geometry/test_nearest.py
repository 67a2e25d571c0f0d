"""The nearest two bodies are those of the clearance, whichever checker is asked."""

import numpy as np
import pytest

from cellwright.engine.stages.geometry.collision.builtin import nearest_contacts
from cellwright.engine.stages.geometry.collision.planning_scene import PlanningScene
from tests.engine.kernels.geometry.test_lanes import any_ground


@pytest.mark.parametrize("seed", range(5))
def test_the_nearest_bodies_are_as_far_apart_as_the_clearance_says(seed: int) -> None:
    rng = np.random.default_rng(seed)
    checker = any_ground(rng).checker
    q = rng.uniform(-3, 3, (20, checker.scene.joints.count))
    others = zip(
        nearest_contacts(checker, q, 0.4),
        nearest_contacts(PlanningScene(checker), q, 0.4),
        strict=True,
    )
    for gap, (ours, other) in zip(checker.clearance(q, 0.4), others, strict=True):
        assert (ours is None) == (other is None) == (gap == 0.4)
        if ours is not None and other is not None:
            assert ours.distance_m == gap
            assert other.distance_m == pytest.approx(gap, abs=1e-9)
            apart = ours.point_second - ours.point_first
            assert np.allclose(apart, ours.distance_m * ours.normal, atol=1e-6)


def test_what_is_no_number_has_no_nearest_bodies() -> None:
    checker = any_ground(np.random.default_rng(1)).checker
    with pytest.raises(ValueError, match="not a finite number"):
        nearest_contacts(checker, np.full((1, checker.scene.joints.count), np.nan))
