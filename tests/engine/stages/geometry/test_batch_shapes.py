"""A batch of another shape is refused: the kernels would read beyond it."""

from collections.abc import Callable

import numpy as np
import pytest

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.geometry import CollisionScene
from cellwright.engine.ports import CollisionChecker
from cellwright.engine.stages.geometry.collision.builtin import BuiltinChecker
from cellwright.engine.stages.geometry.collision.region_checker import RegionChecker
from cellwright.engine.stages.geometry.world.collision_scene import (
    collision_scene_of,
    free_scene_of,
)
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.kb.model.body_shapes import Box, PlacedShape, Pose
from cellwright.kb.model.cell_model import (
    Arm,
    Body,
    BodyKind,
    Cell,
    Joint,
    Link,
    MountedArm,
    Placement,
)

SIDE = PlacedShape(Box((0.2, 0.2, 0.2)))
CHECKERS: list[Callable[[CollisionScene], CollisionChecker]] = [BuiltinChecker, RegionChecker]


@pytest.fixture(scope="module")
def world() -> GeometricWorld:
    """An arm of two joints, a block in its way, and a part."""
    joints = (Joint("shoulder"), Joint("elbow", (Pose((0.4, 0.0, 0.0)),)))
    arm = Arm("arm", joints, (Link("hand", 2, (Pose((0.4, 0.0, 0.0)),), (SIDE,)),))
    bodies = [
        Body("block", BodyKind.FIXTURE, Placement("world", Pose((0.8, 0.0, 0.0))), (SIDE,)),
        Body("part", BodyKind.PART, Placement("world", Pose((0.0, 0.0, 2.0))), (SIDE,)),
    ]
    cell = Cell("made_up", {"arm": MountedArm(arm)}, bodies={each.name: each for each in bodies})
    return GeometricWorld.of(cell)


@pytest.mark.parametrize("make", CHECKERS)
@pytest.mark.parametrize("shape", [(1500, 1), (1500, 3), (3,), (1500, 2, 2)])
def test_configurations_have_a_value_for_each_joint(
    make: Callable[[CollisionScene], CollisionChecker],
    shape: tuple[int, ...],
    world: GeometricWorld,
) -> None:
    checker, wrong = make(collision_scene_of(world)), np.zeros(shape)
    assert checker.collides(np.zeros((3, 2))).all()
    for ask in (checker.collides, checker.clearance):
        with pytest.raises(ValueError, match=r"configurations must be \(n, 2\)"):
            ask(wrong)
    with pytest.raises(ValueError, match=r"configurations must be \(n, 2\)"):
        checker.contacts(np.zeros(3))


@pytest.mark.parametrize("make", CHECKERS)
def test_poses_of_a_free_body_are_four_by_four(
    make: Callable[[CollisionScene], CollisionChecker], world: GeometricWorld
) -> None:
    checker = make(free_scene_of(world, "part"))
    far: Floats = np.tile(np.eye(4), (3, 1, 1))
    assert not checker.collides(far).any()
    for wrong in (far[:, :3], far[0], np.zeros((3, 2))):
        with pytest.raises(ValueError, match=r"poses must be \(n, 4, 4\)"):
            checker.collides(wrong)
