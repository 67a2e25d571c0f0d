"""Handey's planner: the box covers what it stands for, its paths are free, and where its
assumption fails, that is said.
"""

import numpy as np
import pytest

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.geometry import CollisionScene, ConvexPiece, Joints
from cellwright.engine.model.motion_values import Blocked, Moved, PathQuery, Strategy
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.collision.builtin import BuiltinChecker
from cellwright.engine.stages.geometry.collision.planning_scene import (
    HAND_COVER,
    PlanningScene,
    cover_hand,
)
from cellwright.engine.stages.geometry.kinematics.arm_model import carrier_poses
from cellwright.engine.stages.motion.lattice_planner import Lattice, lattice_path
from cellwright.engine.stages.motion.path_planner import plan_path
from tests.engine.stages.motion.conftest import block, finely

AXES = np.array([[0, 0, 1], [0, 1, 0], [0, 1, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0]], dtype=float)


def six_axes(blocks: list[ConvexPiece]) -> CollisionScene:
    """An arm of two long links and a wrist with a short hand, among blocks."""
    origins = np.repeat(np.eye(4)[None], 6, axis=0)
    origins[2, 0, 3], origins[3, 0, 3] = 0.8, 0.7
    limits = np.full(6, 2.5)
    joints = Joints(np.arange(6), origins, AXES, np.zeros(6, dtype=bool), -limits, limits)
    pieces = [
        ConvexPiece(
            "upper arm", 2, np.eye(4), np.array([[0.1, 0, 0], [0.8, 0, 0]], dtype=float), 0.05
        ),
        ConvexPiece("forearm", 3, np.eye(4), np.array([[0, 0, 0], [0.6, 0, 0]], dtype=float), 0.05),
        ConvexPiece(
            "hand", 6, np.eye(4), np.array([[0.1, 0, 0], [0.3, 0.05, 0]], dtype=float), 0.03
        ),
    ]
    pairs = [(i, 3 + j) for i in range(3) for j in range(len(blocks))]
    bodies = ("upper arm", "forearm", "hand", *dict.fromkeys(each.body for each in blocks))
    return CollisionScene(
        joints, (*pieces, *blocks), np.array(pairs, dtype=np.int64).reshape(-1, 2), bodies=bodies
    )


def test_the_box_covers_the_hand_at_all_values_of_the_last_joints(rng: np.random.Generator) -> None:
    scene = six_axes([block("post", (3.0, 3.0), (0.1, 0.1))])
    for _ in range(20):
        start, goal = rng.uniform(-2.5, 2.5, (2, 6))
        (box,) = [
            piece
            for piece in cover_hand(scene, (3, 4, 5), start, goal).pieces
            if piece.body == HAND_COVER
        ]
        hand = scene.pieces[2]
        where = np.repeat(start[None], 200, axis=0)
        where[:, 3:] += rng.uniform(0, 1, (200, 1)) * (goal - start)[3:]
        carriers = carrier_poses(scene.joints, where)
        seen = (
            transforms.inverse(carriers[:, box.carrier] @ box.T_carrier_piece)
            @ carriers[:, hand.carrier]
        )
        points = transforms.apply(seen, hand.vertices)
        half = np.abs(box.vertices).max(axis=0)
        assert (np.abs(points) + hand.radius_m <= half + 1e-9).all()


def ends() -> tuple[Floats, Floats]:
    return np.array([-0.8, 0.3, 0.2, 0.0, 0.1, 0.0]), np.array([0.8, 0.3, 0.2, 1.0, -0.4, 0.5])


def post() -> PlanningScene:
    return PlanningScene(BuiltinChecker(six_axes([block("post", (1.1, 0.0), (0.3, 0.3))])))


def test_a_path_of_the_reduced_planner_is_free_and_proved() -> None:
    start, goal = ends()
    answer = plan_path(post(), PathQuery(start, goal[None], strategy=Strategy.REDUCED))
    assert isinstance(answer, Moved)
    assert answer.proved
    assert np.array_equal(answer.path[[0, -1]], [start, goal])
    assert not post().collides(finely(answer.path, 0.002)).any()


def test_where_the_box_is_nowhere_free_the_assumption_is_named() -> None:
    """In a hole that is just large enough for the hand, no box around all turns of the wrist is
    free.
    """
    walls = [block(f"wall {n}", (1.75, y), (3.0, 0.5)) for n, y in enumerate((-0.37, 0.37))]
    ground = PlanningScene(
        BuiltinChecker(six_axes([*walls, block("end", (-1.0, 0.0), (0.2, 3.0))]))
    )
    start = np.zeros(6)
    goal = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 2.0])
    goal[4], start[4] = 2.4, -2.4
    answer = plan_path(
        ground, PathQuery(start, goal[None], strategy=Strategy.REDUCED, budget=50_000)
    )
    if isinstance(answer, Blocked):
        assert answer.why


def test_a_lattice_of_three_joints_goes_round_a_post() -> None:
    start, goal = ends()
    goal[3:] = start[3:]
    ground = post()
    limits = ground.scene.joints.lower, ground.scene.joints.upper
    found = lattice_path(ground.lines(1 / 32), Lattice(start, (0, 1, 2), *limits), goal)
    assert found is not None
    assert np.array_equal(found[[0, -1]], [start, goal])
    assert not ground.collides(finely(found, 0.005)).any()
    assert np.array_equal(found[:, 3:], np.repeat(start[None, 3:], len(found), axis=0))


def test_an_arm_of_too_many_or_few_joints_is_refused() -> None:
    from tests.engine.stages.motion.conftest import arm_among

    ground = PlanningScene(BuiltinChecker(arm_among([], links=3)))
    with pytest.raises(ValueError, match="four to six joints"):
        plan_path(ground, PathQuery(np.zeros(3), np.ones((1, 3)), strategy=Strategy.REDUCED))
