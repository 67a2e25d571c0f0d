"""Whole turns: many configurations at once agree with every turn of every joint, tried one by
one.
"""

import numpy as np

from cellwright.engine.stages.geometry.kinematics.arm_model import (
    ArmModel,
    reachable_nearest_turns,
    whole_turns,
)


def test_no_turn_within_the_limits_is_nearer_in_any_joint(
    model: ArmModel, rng: np.random.Generator
) -> None:
    q, now = rng.uniform(-np.pi, np.pi, (100, model.joints.count)), model.random(1, rng)[0]
    for each in q:
        inside, near = whole_turns(model, each), reachable_nearest_turns(model, each[None], now)
        assert len(near) == (len(inside) > 0)
        assert np.allclose(
            np.abs(inside - now).min(axis=0, initial=np.inf),
            np.abs(near - now).min(axis=0, initial=np.inf),
        )
