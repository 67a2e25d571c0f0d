"""Paths are free, repeatable, found where a grid finds one, and the reason is told where there
is none.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import label

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.geometry import ConvexPiece
from cellwright.engine.model.motion_values import (
    Blocked,
    InCollision,
    Moved,
    OutsideLimits,
    PathQuery,
    RefusedQuery,
)
from cellwright.engine.stages.geometry.collision.builtin import BuiltinChecker
from cellwright.engine.stages.geometry.collision.planning_scene import PlanningScene
from cellwright.engine.stages.motion.no_path import prove_severed
from cellwright.engine.stages.motion.path_planner import plan_path
from tests.engine.stages.motion.conftest import arm_among, block, finely, random_ground, touching

STEP = 1 / 32  # what a query asks for if it says nothing else
LENGTH_M = 0.6  # of the links among which a grid looks for ways
HERE, THERE = np.array([0.0, 0.0]), np.array([2.0, 0.5])


def wall() -> PlanningScene:
    """A block in the straight way of the arm."""
    return PlanningScene(BuiltinChecker(arm_among([block("post", (1.2, 1.2), (0.2, 0.2))])))


def grid_of(ground: PlanningScene, cells: int) -> tuple[Floats, Floats]:
    """Every configuration of a grid (n, k), and which region of well clear ones each belongs to
    (n,); 0 for none.

    Neighbours differ in one joint. They are clear by more than half of what anything moves between
    them, so that the way from one to the other is free.
    """
    links = ground.scene.joints.count
    axis = np.linspace(-np.pi, np.pi, cells)
    grid = np.stack(np.meshgrid(*[axis] * links, indexing="ij"), axis=-1).reshape(-1, links)
    clear_m = 0.5 * (axis[1] - axis[0]) * (links * LENGTH_M + 0.03)
    regions, _ = label((ground.clearance(grid, clear_m + 0.01) > clear_m).reshape((cells,) * links))
    return grid, regions.ravel()


def agree_with_a_grid(rng: np.random.Generator, links: int, cells: int, rounds: int) -> int:
    """How many plans in random cells a grid has a way for.

    All of these are found, and none of those found touches anything.
    """
    joined = 0
    for _ in range(rounds):
        ground = random_ground(rng, 5, links, LENGTH_M)
        grid, regions = grid_of(ground, cells)
        rows = rng.permutation(np.nonzero(regions)[0])[:4].reshape(-1, 2)
        for ends, marks in zip(grid[rows], regions[rows], strict=True):
            answer = plan_path(ground, PathQuery(ends[0], ends[1:], budget=200_000))
            joined += int(marks[0] == marks[1])
            assert isinstance(answer, Moved) or marks[0] != marks[1]
            if isinstance(answer, Moved):
                assert np.array_equal(answer.path[[0, -1]], ends)
                assert answer.proved
                assert not touching(ground, finely(answer.path, 0.002)).any()
    return joined


@pytest.mark.parametrize(("links", "cells", "rounds"), [(2, 80, 6), (3, 34, 3)])
def test_a_path_is_found_where_a_grid_has_one_and_none_goes_through_anything(
    rng: np.random.Generator, links: int, cells: int, rounds: int
) -> None:
    assert agree_with_a_grid(rng, links, cells, rounds) >= rounds


@pytest.mark.slow
@pytest.mark.parametrize(("links", "cells", "rounds"), [(2, 120, 40), (3, 44, 15)])
def test_many_paths_are_found_where_a_grid_has_one(
    rng: np.random.Generator, links: int, cells: int, rounds: int
) -> None:
    assert agree_with_a_grid(rng, links, cells, rounds) >= rounds


@pytest.mark.parametrize("rounds", [2, pytest.param(16, marks=pytest.mark.slow)])
def test_what_is_proved_touches_nothing_at_a_hundredth_of_the_step(
    rng: np.random.Generator, rounds: int
) -> None:
    sure = 0
    for _ in range(rounds):
        ground = random_ground(rng, 5, links=2)
        q = rng.uniform(-np.pi, np.pi, (60, 2))
        ends = q[ground.clearance(q) > 0.01][:2]
        answer = plan_path(ground, PathQuery(ends[0], ends[1:], budget=50_000))
        if isinstance(answer, Moved) and answer.proved:
            sure += 1
            assert not touching(ground, finely(answer.path, STEP / 100)).any()
    assert sure >= rounds / 2


def test_the_same_seed_has_the_same_path_and_seeds_differ() -> None:
    paths = [plan_path(wall(), PathQuery(HERE, THERE[None], seed=seed)) for seed in (0, 0, 1)]
    first, again, other = (each.path for each in paths if isinstance(each, Moved))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_a_free_straight_line_is_the_path() -> None:
    ground = PlanningScene(BuiltinChecker(arm_among([])))
    answer = plan_path(ground, PathQuery(HERE, THERE[None]))
    assert isinstance(answer, Moved)
    assert np.array_equal(answer.path, [HERE, THERE])


def test_of_several_goals_one_is_reached_and_those_that_are_not_allowed_are_left_out() -> None:
    goals = np.array([[np.pi / 4, 0.0], [9.0, 0.0], THERE])
    answer = plan_path(wall(), PathQuery(HERE, goals))
    assert isinstance(answer, Moved)
    assert answer.goal == 2
    assert np.array_equal(answer.path[-1], THERE)


def test_the_margin_is_kept_everywhere() -> None:
    answer = plan_path(wall(), PathQuery(HERE, THERE[None], margin_m=0.05))
    assert isinstance(answer, Moved)
    assert answer.proved
    assert wall().clearance(finely(answer.path, 0.001)).min() > 0.05 - 1e-9


def test_a_goal_in_collision_is_told_with_what_it_touches_and_how_deep() -> None:
    answer = plan_path(wall(), PathQuery(HERE, np.array([[np.pi / 4, 0.0]])))
    assert isinstance(answer, RefusedQuery)
    (reason,) = answer.reasons
    assert isinstance(reason, InCollision)
    assert reason.of == "goal 1"
    assert {reason.contacts[0].first, reason.contacts[0].second} == {"link 2", "post"}
    assert reason.contacts[0].depth_m > 0.05


def test_a_start_beyond_a_limit_is_told_with_joint_value_and_limits() -> None:
    answer = plan_path(wall(), PathQuery(np.array([0.0, 4.0]), THERE[None]))
    assert isinstance(answer, RefusedQuery)
    (reason,) = answer.reasons
    assert reason == OutsideLimits("start", 1, 4.0, -np.pi, np.pi)


def test_without_a_path_it_is_told_what_stands_between_the_trees() -> None:
    """Posts on all sides leave the arm no way round, because it cannot fold."""
    posts = [block("post", (0.8 * np.cos(a), 0.8 * np.sin(a)), (0.1, 0.1)) for a in (1.0, -2.0)]
    ground = PlanningScene(BuiltinChecker(arm_among(posts, links=2)))
    answer = plan_path(ground, PathQuery(HERE, THERE[None], budget=20_000))
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

    ours, other = (
        plan_path(ground, PathQuery(HERE, THERE[None]))
        for ground in (wall(), PlanningScene(Foreign()))
    )
    assert isinstance(ours, Moved)
    assert isinstance(other, Moved)
    assert np.array_equal(ours.path, other.path)


@pytest.mark.parametrize("start", [np.zeros(3), np.array([np.nan, 0.0])])
def test_a_start_of_another_shape_or_of_no_number_is_refused(start: Floats) -> None:
    with pytest.raises(ValueError, match="start and goals must be"):
        plan_path(wall(), PathQuery(start, THERE[None]))


def walled(side_m: float) -> PlanningScene:
    """Posts that the first link cannot pass, if they are as thick as this."""
    posts = [
        block("post", (0.8 * np.cos(a), 0.8 * np.sin(a)), (side_m, side_m)) for a in (1.0, -2.0)
    ]
    return PlanningScene(BuiltinChecker(arm_among(posts, links=3)))


def test_that_there_is_no_path_is_proved_where_the_first_link_cannot_pass() -> None:
    start, goal = np.zeros(3), np.array([2.0, 0.5, 0.0])
    answer = plan_path(walled(0.1), PathQuery(start, goal[None], budget=5_000))
    assert isinstance(answer, Blocked)
    assert answer.severed is not None
    assert answer.severed.joints == (0,)
    assert {answer.severed.contacts[0].first, answer.severed.contacts[0].second} == {
        "link 1",
        "post",
    }
    assert walled(0.1).collides(answer.severed.at[None])[0]


def carrying(rng: np.random.Generator) -> PlanningScene:
    """A random arm of three links with a ball round its base and two posts on its first link,
    among two blocks.
    """
    base = ConvexPiece("base", 0, np.eye(4), np.zeros((1, 3)), rng.uniform(0.05, 0.3))
    turned = rng.uniform(0.5, 2.6) * np.array([1.0, -1.0])
    posts = [
        replace(block("post", (0.6 + 0.4 * np.cos(a), 0.4 * np.sin(a)), (0.15, 0.15)), carrier=1)
        for a in turned
    ]
    blocks = [piece for piece in random_ground(rng, 2, 3, 0.6).scene.pieces if piece.carrier == 0]
    scene = arm_among([base, *posts, *blocks], 3, 0.6)
    beside = [{scene.pieces[n].body for n in pair} != {"link 1", "base"} for pair in scene.pairs]
    return PlanningScene(BuiltinChecker(replace(scene, pairs=scene.pairs[beside])))


@pytest.mark.parametrize("rounds", [2, pytest.param(12, marks=pytest.mark.slow)])
def test_a_proof_about_links_among_themselves_agrees_with_the_grid(
    rng: np.random.Generator, rounds: int
) -> None:
    proofs = set()
    for _ in range(rounds):
        ground = carrying(rng)
        grid, regions = grid_of(ground, 34)
        rows = rng.permutation(np.nonzero(regions)[0])[:8].reshape(-1, 2)
        for ends, marks in zip(grid[rows], regions[rows], strict=True):
            found = prove_severed(ground, PathQuery(ends[0], ends[1:]))
            if found is not None:
                proofs.add(found.joints)
                assert marks[0] != marks[1]
                assert ground.collides(found.at[None])[0]
    assert (1,) in proofs


def test_nothing_is_proved_where_there_is_a_way(rng: np.random.Generator) -> None:
    for _ in range(12):
        ground = random_ground(rng, 5, 2, LENGTH_M)
        q = rng.uniform(-np.pi, np.pi, (60, 2))
        ends = q[ground.clearance(q) > 0.01][:2]
        query = PathQuery(ends[0], ends[1:], budget=30_000)
        if isinstance(plan_path(ground, query), Moved):
            assert prove_severed(ground, query) is None


def test_a_proof_on_two_joints_agrees_with_the_grid(rng: np.random.Generator) -> None:
    proofs = 0
    for _ in range(12):
        ground = random_ground(rng, 8, 2)
        q = rng.uniform(-np.pi, np.pi, (200, 2))
        ends = q[ground.clearance(q) > 0.0][:2]
        query = PathQuery(ends[0], ends[1:], budget=20_000)
        if prove_severed(ground, query) is not None:
            proofs += 1
            assert isinstance(plan_path(ground, query), Blocked)
    assert proofs
