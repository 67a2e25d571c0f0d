"""Paths are free, repeatable, found where a grid finds one, and the reason is told where there is none."""

import numpy as np
import pytest
from scipy.ndimage import label

from engine.model.geometry import Floats
from engine.model.motion import Blocked, InCollision, Moved, OutsideLimits, Query, Refused
from engine.stages.geometry.collision.builtin import BuiltinChecker
from engine.stages.geometry.collision.ground import Ground
from engine.stages.motion.planner import plan
from tests.engine.stages.motion.conftest import arm_among, block, finely, random_ground

HERE, THERE = np.array([0.0, 0.0]), np.array([2.0, 0.5])


def wall() -> Ground:
    """A block in the straight way of the arm."""
    return Ground(BuiltinChecker(arm_among([block("post", (1.2, 1.2), (0.2, 0.2))])))


def free_ends(ground: Ground, rng: np.random.Generator) -> Floats:
    q = rng.uniform(-np.pi, np.pi, (60, ground.scene.joints.count))
    return q[ground.clearance(q) > 0.01][:2]


def connected_on_a_grid(ground: Ground, ends: Floats, cells: int = 90, clear_m: float = 0.05) -> bool:
    """Whether a grid of configurations that are well clear joins both ends: then there is a path."""
    axis = np.linspace(-np.pi, np.pi, cells)
    grid = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    regions, _ = label((ground.clearance(grid) > clear_m).reshape(cells, cells))
    at = [tuple(np.rint((q + np.pi) / (2 * np.pi) * (cells - 1)).astype(int)) for q in ends]
    return bool(regions[at[0]] == regions[at[1]] != 0)


@pytest.mark.slow
def test_no_path_goes_through_anything_and_a_path_is_found_where_a_grid_finds_one(
    rng: np.random.Generator,
) -> None:
    joined = 0
    for _ in range(25):
        ground = random_ground(rng, 5)
        ends = free_ends(ground, rng)
        answer = plan(ground, Query(ends[0], ends[1:], budget=200_000))
        if connected_on_a_grid(ground, ends):
            joined += 1
            assert isinstance(answer, Moved)
        if isinstance(answer, Moved):
            assert np.array_equal(answer.path[[0, -1]], ends)
            assert answer.proved
            assert not ground.collides(finely(answer.path, 0.0005)).any()
    assert joined > 5


def test_arms_of_three_links_never_pass_through_anything(rng: np.random.Generator) -> None:
    for _ in range(10):
        ground = random_ground(rng, 4, links=3)
        ends = free_ends(ground, rng)
        answer = plan(ground, Query(ends[0], ends[1:], budget=200_000))
        assert not isinstance(answer, Refused)
        if isinstance(answer, Moved):
            assert not ground.collides(finely(answer.path, 0.001)).any()


def test_the_same_seed_has_the_same_path_and_seeds_differ() -> None:
    paths = [plan(wall(), Query(HERE, THERE[None], seed=seed)) for seed in (0, 0, 1)]
    first, again, other = (each.path for each in paths if isinstance(each, Moved))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_a_free_straight_line_is_the_path() -> None:
    ground = Ground(BuiltinChecker(arm_among([])))
    answer = plan(ground, Query(HERE, THERE[None]))
    assert isinstance(answer, Moved)
    assert np.array_equal(answer.path, [HERE, THERE])


def test_of_several_goals_one_is_reached_and_those_that_are_not_allowed_are_left_out() -> None:
    goals = np.array([[np.pi / 4, 0.0], [9.0, 0.0], THERE])
    answer = plan(wall(), Query(HERE, goals))
    assert isinstance(answer, Moved)
    assert answer.goal == 2
    assert np.array_equal(answer.path[-1], THERE)


def test_the_margin_is_kept_everywhere() -> None:
    answer = plan(wall(), Query(HERE, THERE[None], margin_m=0.05))
    assert isinstance(answer, Moved)
    assert answer.proved
    assert wall().clearance(finely(answer.path, 0.001)).min() > 0.05 - 1e-9


def test_a_goal_in_collision_is_told_with_what_it_touches_and_how_deep() -> None:
    answer = plan(wall(), Query(HERE, np.array([[np.pi / 4, 0.0]])))
    assert isinstance(answer, Refused)
    (reason,) = answer.reasons
    assert isinstance(reason, InCollision)
    assert reason.of == "goal 1"
    assert {reason.contacts[0].first, reason.contacts[0].second} == {"link 2", "post"}
    assert reason.contacts[0].depth_m > 0.05


def test_a_start_beyond_a_limit_is_told_with_joint_value_and_limits() -> None:
    answer = plan(wall(), Query(np.array([0.0, 4.0]), THERE[None]))
    assert isinstance(answer, Refused)
    (reason,) = answer.reasons
    assert reason == OutsideLimits("start", 1, 4.0, -np.pi, np.pi)


def test_without_a_path_it_is_told_what_stands_between_the_trees() -> None:
    """Posts on all sides leave the arm no way round, because it cannot fold."""
    posts = [block("post", (0.8 * np.cos(a), 0.8 * np.sin(a)), (0.1, 0.1)) for a in (1.0, -2.0)]
    ground = Ground(BuiltinChecker(arm_among(posts, links=2)))
    answer = plan(ground, Query(HERE, THERE[None], budget=20_000))
    assert isinstance(answer, Blocked)
    assert "post" in {answer.contacts[0].first, answer.contacts[0].second}
    assert answer.contacts[0].depth_m > 0
    assert not ground.collides(answer.ends).any()
    assert ground.collides(answer.at[None])[0]


def test_any_checker_takes_part_and_agrees() -> None:
    class Foreign:
        """A checker that is not the built-in one."""

        def __init__(self) -> None:
            self.inner = wall().checker
            self.scene = self.inner.scene
            self.collides, self.clearance = self.inner.collides, self.inner.clearance
            self.contacts = self.inner.contacts

    ours, other = (plan(ground, Query(HERE, THERE[None])) for ground in (wall(), Ground(Foreign())))
    assert isinstance(ours, Moved)
    assert isinstance(other, Moved)
    assert np.array_equal(ours.path, other.path)


@pytest.mark.parametrize("start", [np.zeros(3), np.array([np.nan, 0.0])])
def test_a_start_of_another_shape_or_of_no_number_is_refused(start: Floats) -> None:
    with pytest.raises(ValueError, match="start and goals must be"):
        plan(wall(), Query(start, THERE[None]))
