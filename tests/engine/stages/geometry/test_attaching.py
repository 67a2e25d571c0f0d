"""A body taken in hand without building the scene anew is checked as in a scene built anew."""

import numpy as np
import pytest

from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.collision.builtin import (
    BuiltinChecker,
    allow_contacts,
    attach_body,
)
from cellwright.engine.stages.geometry.kinematics.arm_model import carrier_poses
from cellwright.engine.stages.geometry.world.collision_scene import collision_scene_of
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.kb.loader.arm_file import bundled_arms, load_arm
from cellwright.kb.model.body_shapes import Box, PlacedShape, Pose, Sphere
from cellwright.kb.model.cell_model import Body, BodyKind, Cell, MountedArm, Placement

SHAPES = (
    PlacedShape(Box((0.05, 0.1, 0.2))),
    PlacedShape(Sphere(0.06), Pose((0.1, 0, 0), (0, 0, 0))),
)
Q = np.array([0.3, -1.0, 0.5, 0.2, 0.4, 0.1])


def world(shapes: tuple[PlacedShape, ...]) -> GeometricWorld:
    part = Body(
        "part", BodyKind.PART, Placement("world", Pose((0.5, 0.2, 0.4), (0.1, 0, 0))), shapes
    )
    table = Body(
        "table",
        BodyKind.FIXTURE,
        Placement("world", Pose((0, 0, -0.35), (0, 0, 0))),
        (PlacedShape(Box((2, 2, 0.1))),),
    )
    ball = Body(
        "ball", BodyKind.FIXTURE, Placement("world", Pose((0.4, -0.3, 0.5), (0, 0, 0))), SHAPES
    )
    arm = MountedArm(load_arm(bundled_arms()["ur5"]), home=tuple(Q))
    bodies = {each.name: each for each in (part, table, ball)}
    return GeometricWorld.of(Cell("cell", {"ur5": arm}, bodies=bodies))


@pytest.mark.parametrize("shapes", [SHAPES, SHAPES[:1]])
def test_taken_and_put_down_are_as_in_scenes_built_anew(shapes: tuple[PlacedShape, ...]) -> None:
    standing, rng = world(shapes), np.random.default_rng(3)
    first = BuiltinChecker(collision_scene_of(standing))
    carried = standing.affix("part", "ur5.flange")
    T_world_last = carrier_poses(standing.joints, Q)[6]
    taken = attach_body(first, "part", 6, transforms.inverse(T_world_last))
    later = rng.uniform(-2, 2, 6)
    moved = carried.moved("ur5", later).affix("part", "world")
    down = attach_body(taken, "part", 0, carrier_poses(standing.joints, later)[6])
    for ours, anew in ((taken, carried), (down, moved)):
        whole, q = BuiltinChecker(collision_scene_of(anew)), rng.uniform(-3, 3, (300, 6))
        assert np.array_equal(ours.collides(q), whole.collides(q))
        assert np.allclose(ours.clearance(q[:50]), whole.clearance(q[:50]), atol=1e-9)


def test_what_is_allowed_once_is_not_checked_and_all_else_is() -> None:
    scene, q = collision_scene_of(world(SHAPES)), np.random.default_rng(3).uniform(-3, 3, (300, 6))
    may = frozenset({frozenset(("ur5.forearm", "table")), frozenset(("ball", "ur5.wrist_1"))})
    ours = allow_contacts(BuiltinChecker(scene), may)
    whole = BuiltinChecker(collision_scene_of(world(SHAPES), allowed=may))
    assert np.array_equal(ours.collides(q), whole.collides(q))
    assert ours.collides(q).sum() < BuiltinChecker(scene).collides(q).sum()


def test_a_body_that_is_not_there_cannot_be_taken() -> None:
    with pytest.raises(ValueError, match="no body 'cup'"):
        attach_body(BuiltinChecker(collision_scene_of(world(SHAPES))), "cup", 6, np.eye(4))
