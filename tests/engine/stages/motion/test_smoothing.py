"""Smooth motions: within all limits at every moment, and as near to the path as the proof asks
for.
"""

import numpy as np

from cellwright.engine.stages.geometry.collision.builtin import BuiltinChecker
from cellwright.engine.stages.geometry.collision.planning_scene import PlanningScene
from cellwright.engine.stages.motion.path_proofs import touches_on_path
from cellwright.engine.stages.motion.timed_paths import (
    JointLimits,
    MotionTube,
    SmoothedPath,
    certify_smooth_path,
    fastest_trajectory,
    least_times,
    smooth_path,
)
from tests.engine.stages.motion.conftest import arm_among, block

LIMITS = JointLimits(np.array([1.0, 2.0]), np.array([3.0, 5.0]), np.array([40.0, 60.0]))


def test_a_smooth_motion_keeps_speed_acceleration_and_jerk(rng: np.random.Generator) -> None:
    for _ in range(40):
        path = rng.uniform(-2, 2, (int(rng.integers(2, 7)), 2))
        waits, slower = rng.choice([0.0, 0.5, 1.0], len(path)), rng.uniform(1, 2, len(path) - 1)
        found = smooth_path(path, LIMITS, waits, slower)
        times = np.linspace(-0.1, found.duration_s + 0.1, 4001)
        q, v, a = found.at(times)
        assert np.allclose(q[0], path[0], atol=1e-9)
        assert np.allclose(q[-1], path[-1], atol=1e-9)
        dt = times[1] - times[0]
        jerk = np.diff(a, axis=0) / dt
        assert (np.abs(v) <= LIMITS.speed * (1 + 1e-6)).all()
        assert (np.abs(a) <= LIMITS.acceleration * (1 + 1e-5)).all()
        assert (np.abs(jerk) <= LIMITS.jerk * (1 + 1e-3) + 1e-3).all()
        assert np.abs(np.diff(q, axis=0) / dt - (v[1:] + v[:-1]) / 2).max() < 1e-3


def test_with_whole_waits_it_stays_on_the_path() -> None:
    path = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    found = smooth_path(path, LIMITS, np.ones(3), np.ones(2))
    q = found.at(np.linspace(0, found.duration_s, 500))[0]
    assert np.minimum(np.abs(q[:, 1]), np.abs(q[:, 0] - 1.0)).max() < 1e-9


def test_a_corner_is_cut_only_as_far_as_nothing_is_touched() -> None:
    path = np.array([[0.0, 0.0], [0.0, 1.2], [1.3, 1.2], [1.3, 0.0]])
    free = PlanningScene(BuiltinChecker(arm_among([])))
    quick, proved = certify_smooth_path(
        MotionTube(free, 0.0, 1e-4), path, LIMITS, slice(0, 2), np.ones(3)
    )
    assert proved
    tight = PlanningScene(BuiltinChecker(arm_among([block("post", (1.35, 1.15), (0.5, 0.5))])))
    slow, sure = certify_smooth_path(
        MotionTube(tight, 0.0, 1e-4), path, LIMITS, slice(0, 2), np.ones(3)
    )
    assert quick.duration_s <= slow.duration_s
    if sure:
        assert not tight.collides(slow.at(np.linspace(0, slow.duration_s, 3000))[0]).any()


def test_many_corners_are_passed_sooner_than_with_rests() -> None:
    path = np.column_stack([np.linspace(0, 2, 9), 0.1 * np.sin(np.linspace(0, 2, 9))])
    found = smooth_path(path, LIMITS, np.zeros(9), np.ones(8))
    assert found.duration_s < 0.7 * fastest_trajectory(path, LIMITS).corners_s[-1]


def test_least_times_are_those_of_the_fastest_motion(rng: np.random.Generator) -> None:
    first, second = rng.uniform(-3, 3, (2, 200, 2)) * 10.0 ** rng.uniform(-3, 0, (200, 1))
    second[0] = first[0]
    found = least_times(first, second, LIMITS)
    one_by_one = [
        fastest_trajectory(np.array(each), LIMITS).corners_s[-1]
        for each in zip(first, second, strict=True)
    ]
    assert np.allclose(found, one_by_one, rtol=1e-9)


def deepest(ground: PlanningScene, found: SmoothedPath) -> float:
    """How deep any pair overlaps on a smooth motion, looked at closely."""
    q = found.at(np.linspace(0.0, found.duration_s, 400))[0]
    return max((each.depth_m for one in q for each in ground.contacts(one)), default=0.0)


def test_a_corner_of_a_path_that_touches_is_cut_only_as_deep_as_it_may_touch(
    rng: np.random.Generator,
) -> None:
    """The cut is on the inside of a corner, so what is shallow on the path may be deep beside
    it.
    """
    free, deeper, kept = PlanningScene(BuiltinChecker(arm_among([]))), 0, 0
    for _ in range(60):
        path = rng.uniform(0.5, 1.5, 2) + np.cumsum(rng.uniform(-0.8, 0.8, (3, 2)), axis=0)
        cut, _ = certify_smooth_path(
            MotionTube(free, 0.0, 1e-4), path, LIMITS, slice(0, 2), np.ones(2)
        )
        bent = cut.at(cut.corners_s[1:2])[0][0].cumsum()
        tip = np.array([np.cos(bent).sum(), np.sin(bent).sum()]) + rng.uniform(-0.08, 0.08, 2)
        meeting = PlanningScene(
            BuiltinChecker(arm_among([block("post", (tip[0], tip[1]), (0.1, 0.1))]))
        )
        met = touches_on_path(meeting, path, 0.02)
        if not met or not all(each.proved for each in met):
            continue
        deeper += deepest(meeting, cut) > 0.02
        tube = MotionTube(free, 0.0, 1e-4, meeting, 0.02)
        safe, proved = certify_smooth_path(tube, path, LIMITS, slice(0, 2), np.ones(2))
        assert deepest(meeting, safe) <= 0.02 + 1e-9
        kept += proved and safe.corners_s[-1] < fastest_trajectory(path, LIMITS).corners_s[-1]
    assert deeper
    assert kept
