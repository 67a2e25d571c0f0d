"""How tightly a part sits at its goal, and the insertion that follows from it."""

from dataclasses import replace

import numpy as np
import pytest

from cellwright.engine.pipelines.manipulation.clearance import insertion_of
from cellwright.engine.pipelines.manipulation.place_answers import Placed
from cellwright.engine.pipelines.manipulation.place_operation import place_part
from cellwright.engine.pipelines.manipulation.scene_camera import look_for_parts
from cellwright.engine.pipelines.manipulation.workspace import AssemblySite, PlaceTask
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.engine.stages.grasping.hole_insertion import HoleSearch
from cellwright.kb.loader.scene_file import load_scene
from cellwright.kb.model.part_scene import Scene
from cellwright.kb.targets import BUNDLED_DOMAINS

PEG = load_scene(BUNDLED_DOMAINS / "handey" / "scenes" / "peg.yaml")
NOTHING, UPRIGHT = np.zeros((6, 6)), np.eye(4)


def task(scene: Scene, x_m: float = 0.0, z_m: float = 0.0) -> PlaceTask:
    world = GeometricWorld.of(scene.cell)
    T = np.eye(4)
    T[:3, 3] = 0.42 + x_m, -0.29, 0.06 + z_m
    looked = look_for_parts(scene, world, (), 0)
    start = world.pose("world", "peg")
    return AssemblySite.of(scene, world, looked, {"peg": start}).task("peg", (start, T))


@pytest.mark.parametrize("x_m", [0.0, 0.00004, -0.00004])
def test_the_room_and_the_depth_are_those_of_the_hole(x_m: float) -> None:
    found = insertion_of(task(PEG, x_m), NOTHING, UPRIGHT)
    assert found is not None
    assert found.room_m == pytest.approx(0.0001, abs=0.00003)
    assert found.depth_m == pytest.approx(0.03, abs=0.003)


def test_a_part_that_stands_free_is_not_inserted() -> None:
    assert insertion_of(task(PEG, z_m=0.1), NOTHING, UPRIGHT) is None


@pytest.mark.parametrize(
    ("accuracy_m", "search"), [(0.0, HoleSearch.NONE), (0.0003, HoleSearch.SPIRAL)]
)
def test_a_search_is_chosen_where_the_doubt_exceeds_the_room(
    accuracy_m: float, search: HoleSearch
) -> None:
    found, _ = place_part(
        replace(PEG, hand=replace(PEG.hand, accuracy_m=accuracy_m)), "peg", "block"
    )
    assert isinstance(found, Placed)
    last = found.carries[-1].insertion
    assert last is not None
    assert last.search is search
