"""Regrasps through PLACE: a wheel that only its two ends can be held at, and a hand that can
lean little.
"""

from dataclasses import replace
from itertools import pairwise, product

import numpy as np
import pytest

from cellwright.engine.kernels.arrays import Truths
from cellwright.engine.kernels.rigid import rotation, transform
from cellwright.engine.model.manipulation_values import Regrasps, Unplaceable
from cellwright.engine.pipelines.manipulation.place_answers import NotPlaced, Placed
from cellwright.engine.pipelines.manipulation.place_operation import place_part
from cellwright.engine.pipelines.manipulation.regrasp_paths import (
    fewest_regrasps,
    possible_holds,
    reached_holds,
    serving_holds,
    table_rests,
)
from cellwright.engine.pipelines.manipulation.scene_camera import look_for_parts
from cellwright.engine.pipelines.manipulation.workspace import AssemblySite, PlaceTask
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.shapes.facet_solids import solid_of
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.engine.stages.grasping.stable_placements import stable_placements, volume_and_centre
from cellwright.kb.loader.scene_file import load_scene
from cellwright.kb.model.cell_model import Placement
from cellwright.kb.model.part_scene import Scene
from cellwright.kb.targets import BUNDLED_DOMAINS

SCENE = load_scene(BUNDLED_DOMAINS / "handey" / "scenes" / "turning.yaml")
WHEEL = solid_of(SCENE.cell.bodies["wheel"])
RESTS = {each.facet: each for each in stable_placements(WHEEL, volume_and_centre(WHEEL)[1])}


def lying(facet: str) -> Scene:
    """The wheel lies on a facet."""
    T = transform(rotation((0, 0, 1), 0.3), np.array([0.43, 0.15, 0.0])) @ RESTS[facet].T_table_part
    body = replace(SCENE.cell.bodies["wheel"], placement=Placement("world", transforms.to_pose(T)))
    return replace(SCENE, cell=replace(SCENE.cell, bodies={**SCENE.cell.bodies, "wheel": body}))


def regrasps_of(scene: Scene) -> int:
    """How many regrasps PLACE plans; each carry begins where the one before it has ended."""
    found, _ = place_part(scene, "wheel", "base")
    assert isinstance(found, Placed)
    legs = [leg for carry in found.carries for leg in carry.legs]
    assert all(np.array_equal(a.path[-1], b.path[0]) for a, b in pairwise(legs))
    for one, other in zip(found.carries, found.carries[1:], strict=False):
        np.testing.assert_array_equal(one.T_world_to, other.T_world_from)
    return len(found.carries) - 1


@pytest.mark.slow
def test_the_bundled_wheel_is_turned_over_with_three_regrasps() -> None:
    assert regrasps_of(SCENE) == 3


@pytest.mark.parametrize(
    ("facet", "count"),
    [("south", 0), ("west", 1), pytest.param("north_west", 2, marks=pytest.mark.slow)],
)
def test_a_wheel_that_lies_further_round_takes_more_regrasps(facet: str, count: int) -> None:
    assert regrasps_of(lying(facet)) == count


def test_a_hand_that_cannot_lean_cannot_turn_the_wheel_at_all() -> None:
    scene = lying("north")
    found, _ = place_part(
        replace(scene, hand=replace(scene.hand, cross_m=(0.14, 0.5, 0.03))), "wheel", "base"
    )
    assert isinstance(found, NotPlaced)
    assert found.step == "regrasp"


def task_of(facet: str) -> PlaceTask:
    """The task from a facet to the goal: lying on `south`."""
    scene = lying(facet)
    world = GeometricWorld.of(scene.cell)
    start = world.pose("world", "wheel")
    goal = transform(np.eye(3), np.array([0.4, -0.3, 0.02]))
    return AssemblySite.of(
        scene, world, look_for_parts(scene, world, (), 0), {"wheel": start}
    ).task("wheel", (start, goal))


def fewest(start: Truths, goal: Truths, table: Truths) -> int | None:
    """The least number of rests, tried one after the other, by looking at all sequences of
    their kinds.
    """
    kinds = np.unique(table, axis=1).T
    for count in range(1, 4):
        for sequence in product(kinds, repeat=count):
            held = start
            for rest in sequence:
                held = rest & (held & rest).any()
            if (held & goal).any():
                return count
    return None


@pytest.mark.slow
@pytest.mark.parametrize("facet", ["west", "north_west", "north"])
def test_asking_for_the_arm_late_finds_the_fewest_regrasps(facet: str) -> None:
    task = task_of(facet)
    poses = [T for _, T in table_rests(task)]
    start, goal = possible_holds(task, task.T_start), possible_holds(task, task.T_goal)
    table = serving_holds(task, poses)
    found = fewest_regrasps(task, (start, goal), poses, table.copy())
    whole = np.array([reached_holds(task, T, table[:, n]) for n, T in enumerate(poses)]).T
    least = fewest(start, goal, whole)
    assert not isinstance(found, Unplaceable) or least is None
    assert not isinstance(found, Regrasps) or len(found.then) == least
