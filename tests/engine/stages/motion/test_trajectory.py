"""Trajectories stay on the path, within every limit, and are as short as those of a library
made for it.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.stages.motion.timed_paths import JointLimits, fastest_trajectory

UR5 = JointLimits(np.full(3, 3.0), np.array([10.0, 8.0, 12.0]), np.full(3, 80.0))
values = st.floats(-3, 3).map(lambda x: round(x, 3))
paths = st.lists(st.tuples(values, values, values), min_size=1, max_size=5).map(
    lambda rows: np.array(rows)
)


@settings(deadline=None, max_examples=50)
@given(path=paths, jerk=st.floats(0.5, 1000), acceleration=st.floats(0.1, 50))
def test_limits_hold_everywhere_and_corners_are_met_at_rest(
    path: Floats, jerk: float, acceleration: float
) -> None:
    limits = JointLimits(UR5.speed, np.full(3, acceleration), np.full(3, jerk))
    made = fastest_trajectory(path, limits)
    at, speeds, changes = made.at(made.corners_s)
    assert np.allclose(at, path, atol=1e-6)
    assert np.allclose(speeds, 0.0, atol=1e-6)
    times = np.linspace(0.0, made.corners_s[-1], 200)
    _, speeds, changes = made.at(times)
    assert (np.abs(speeds) <= limits.speed * (1 + 1e-6)).all()
    assert (np.abs(changes) <= limits.acceleration * (1 + 1e-6)).all()


def test_every_moment_is_on_the_path() -> None:
    path = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, -0.5], [0.5, 2.0, 0.0]])
    made = fastest_trajectory(path, UR5)
    at, speeds, _ = made.at(np.linspace(0.0, made.corners_s[1], 50))
    share = at[:, 0]
    assert np.allclose(at, share[:, None] * path[1])
    assert (np.diff(share) >= 0).all()
    assert speeds[:, 1].max() > 1.0


def test_the_times_are_those_of_ruckig_which_may_leave_the_line() -> None:
    ruckig = pytest.importorskip("ruckig")
    rng = np.random.default_rng(6)
    for _ in range(50):
        ends = rng.uniform(-3, 3, (2, 3)) * rng.choice([0.01, 1.0])
        asked = ruckig.InputParameter(3)
        asked.current_position, asked.target_position = ends.tolist()
        asked.max_velocity = UR5.speed.tolist()
        asked.max_acceleration = UR5.acceleration.tolist()
        asked.max_jerk = UR5.jerk.tolist()
        asked.synchronization = ruckig.Synchronization.Phase
        found = ruckig.Trajectory(3)
        ruckig.Ruckig(3).calculate(asked, found)
        made = fastest_trajectory(ends, UR5)
        assert found.duration * (1 - 1e-9) <= made.corners_s[-1] <= found.duration * 1.05


def test_a_limit_of_nothing_is_refused() -> None:
    with pytest.raises(ValueError, match="above 0"):
        fastest_trajectory(np.zeros((2, 3)), JointLimits(np.zeros(3), UR5.acceleration, UR5.jerk))
