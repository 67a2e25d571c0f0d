from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.stages.geometry.world.collision_scene import (
    collision_scene_of,
    free_scene_of,
)
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.kb.loader.arm_file import bundled_arms, load_arm
from cellwright.kb.model.body_shapes import Box, PlacedShape, Pose, Sphere
from cellwright.kb.model.cell_model import Body, BodyKind, Cell, MountedArm, Placement
from tests.engine.stages.geometry.rigid import is_rigid

UR5 = load_arm(bundled_arms()["ur5"])
HOME = (0.1, -1.2, 1.3, -0.4, -1.5, 0.2)


def block(
    name: str, parent: str, at: tuple[float, float, float], kind: BodyKind = BodyKind.PART
) -> Body:
    shapes = (PlacedShape(Box((0.1, 0.1, 0.1))),)
    return Body(
        name,
        kind,
        Placement(parent, Pose(at, (0.1, 0.2, 0.3))),
        shapes,
        {"top": Pose((0, 0, 0.05))},
    )


def cell_with_two_arms() -> Cell:
    arm = load_arm(bundled_arms()["ur5"])
    left = MountedArm(arm, Placement("world", Pose((-1.0, 0, 0))), Pose((0, 0, 0.1)), HOME)
    right = MountedArm(arm, Placement("table", Pose((1.0, 0, 0.2))), home=HOME)
    bodies = [block("part", "table", (0.2, 0.3, 0.1)), block("lid", "part", (0, 0, 0.1))]
    bodies.append(
        Body("gripper", BodyKind.TOOL, Placement("left.flange"), (PlacedShape(Sphere(0.05)),))
    )
    return Cell(
        "two",
        {"left": left, "right": right},
        {"table": Placement("world", Pose((0.0, 0.5, 0.7)))},
        {body.name: body for body in bodies},
    )


@pytest.fixture(scope="module")
def world() -> GeometricWorld:
    return GeometricWorld.of(cell_with_two_arms())


FRAMES = [
    "world",
    "table",
    "part",
    "part.top",
    "lid",
    "gripper",
    "left.tool",
    "right.flange",
    "right.forearm",
    "left.base",
]


@given(st.sampled_from(FRAMES), st.sampled_from(FRAMES), st.sampled_from(FRAMES))
def test_locations_are_consistent_between_all_frames(a: str, b: str, c: str) -> None:
    world = GeometricWorld.of(cell_with_two_arms())
    assert np.abs(world.pose(a, b) @ world.pose(b, c) - world.pose(a, c)).max() < 1e-12
    assert np.abs(world.pose(a, a) - np.eye(4)).max() < 1e-15


def test_what_is_affixed_moves_along_and_what_is_put_back_on_the_world_stays(
    world: GeometricWorld,
) -> None:
    gripped = world.affix("part", "left.tool")
    assert np.abs(gripped.pose("world", "part") - world.pose("world", "part")).max() < 1e-12
    moved = gripped.moved("left", np.array(HOME) + 0.3)
    assert np.abs(moved.pose("left.tool", "part") - gripped.pose("left.tool", "part")).max() < 1e-12
    assert np.abs(moved.pose("part", "lid") - world.pose("part", "lid")).max() < 1e-12
    left = moved.affix("part", "world").moved("left", np.array(HOME))
    assert np.abs(left.pose("world", "part") - moved.pose("world", "part")).max() < 1e-12


@settings(max_examples=30, deadline=None)
@given(
    st.lists(st.floats(-2, 2), min_size=6, max_size=6),
    st.sampled_from(["left.tool", "right.wrist_2"]),
)
def test_affixing_and_putting_back_restores_the_tree(q: list[float], to: str) -> None:
    before = GeometricWorld.of(cell_with_two_arms()).moved("left", np.array(q))
    after = before.affix("part", to).affix("part", "table")
    assert after.placed.keys() == before.placed.keys()
    for name, fixed in before.placed.items():
        assert after.placed[name].parent == fixed.parent
        assert np.abs(after.placed[name].T_parent_frame - fixed.T_parent_frame).max() < 1e-12


def test_a_body_cannot_be_affixed_to_itself_or_to_what_stands_on_it(world: GeometricWorld) -> None:
    for frame in ("part", "part.top", "lid"):
        with pytest.raises(ValueError, match="stands on"):
            world.affix("part", frame)
    with pytest.raises(KeyError):
        world.affix("part", "nowhere")
    with pytest.raises(KeyError):
        world.pose("world", "left.elbow")


def test_two_arms_are_one_forest_of_joints(world: GeometricWorld) -> None:
    joints = world.joints
    assert joints.count == 12
    assert list(joints.parent) == [0, 1, 2, 3, 4, 5, 0, 7, 8, 9, 10, 11]
    flange = world.models["right"].flange_pose(np.array(HOME))
    assert np.abs(world.pose("right.base", "right.flange") - flange).max() < 1e-12


def test_an_arm_on_an_arm_is_carried_by_it() -> None:
    cell = cell_with_two_arms()
    right = MountedArm(cell.arms["right"].arm, Placement("left.tool"), home=HOME)
    world = GeometricWorld.of(Cell("stacked", {"left": cell.arms["left"], "right": right}))
    assert world.joints.parent[6] == 6
    moved = world.moved("left", np.array(HOME) + 0.2)
    assert (
        np.abs(
            moved.pose("left.tool", "right.flange") - world.pose("left.tool", "right.flange")
        ).max()
        < 1e-12
    )
    assert (
        np.abs(moved.pose("world", "right.flange") - world.pose("world", "right.flange")).max()
        > 0.1
    )


def test_bodies_hang_on_the_carriers_of_what_they_are_affixed_to(world: GeometricWorld) -> None:
    carriers = {
        piece.body: piece.carrier
        for piece in collision_scene_of(world.affix("part", "right.flange")).pieces
    }
    assert carriers["gripper"] == 6
    assert carriers["part"] == carriers["lid"] == 12
    assert carriers["left.base"] == 0


def test_pairs_that_move_together_or_may_touch_are_not_checked(world: GeometricWorld) -> None:
    scene = collision_scene_of(world, allowed=frozenset({frozenset({"part", "right.forearm"})}))
    pairs = {frozenset((scene.pieces[i].body, scene.pieces[j].body)) for i, j in scene.pairs}
    assert frozenset({"part", "lid"}) not in pairs
    assert frozenset({"gripper", "left.wrist_3"}) not in pairs
    assert frozenset({"left.upper_arm", "left.forearm"}) not in pairs
    assert frozenset({"part", "right.forearm"}) not in pairs
    assert frozenset({"part", "left.forearm"}) in pairs
    assert frozenset({"left.forearm", "right.forearm"}) in pairs


def test_a_free_scene_leaves_out_what_the_arms_carry(world: GeometricWorld) -> None:
    scene = free_scene_of(world, "gripper")
    assert {piece.carrier for piece in scene.pieces if piece.body == "gripper"} == {1}
    assert {"part", "lid", "gripper", "left.base", "right.base"} == set(scene.bodies)
    assert is_rigid(np.stack([piece.T_carrier_piece for piece in scene.pieces]))


def test_the_pairs_of_a_scene_are_those_of_two_carriers_that_may_not_touch(
    world: GeometricWorld,
) -> None:
    allowed = frozenset(
        {frozenset({"part", "gripper"}), frozenset({"lid"}), frozenset({"left.forearm", "lid"})}
    )
    scene = collision_scene_of(world.affix("lid", "right.tool"), allowed=allowed)
    own = {
        frozenset(f"{arm}.{link}" for link in pair)
        for arm in ("left", "right")
        for pair in UR5.allowed
    }
    plain = [
        (i, j)
        for (i, one), (j, other) in combinations(enumerate(scene.pieces), 2)
        if one.carrier != other.carrier and frozenset((one.body, other.body)) not in allowed | own
    ]
    assert scene.pairs.tolist() == [list(pair) for pair in plain]


@pytest.mark.parametrize("values", [np.zeros(5), np.zeros(7), np.full(6, np.nan), np.zeros((1, 6))])
def test_an_arm_is_moved_by_a_finite_number_for_each_joint_alone(
    world: GeometricWorld, values: Floats
) -> None:
    with pytest.raises(ValueError, match="left has 6 joints"):
        world.moved("left", values)


def test_a_body_is_put_at_a_pose_of_finite_numbers_alone(world: GeometricWorld) -> None:
    for T in (np.full((4, 4), np.nan), np.eye(3)):
        with pytest.raises(ValueError, match="the pose of 'part'"):
            world.put("part", "world", T)
