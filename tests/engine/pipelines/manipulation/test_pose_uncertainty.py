"""What is doubted is brought along, and what has moved since it was seen is found again."""

from dataclasses import replace

import numpy as np
import pytest

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.pipelines.manipulation.place_answers import NotPlaced, Placed
from cellwright.engine.pipelines.manipulation.place_operation import look_again, place_part
from cellwright.engine.pipelines.manipulation.pose_uncertainty import after_grasps, at_goal
from cellwright.engine.pipelines.manipulation.scene_camera import camera_of, depth_image
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.kb.loader.scene_file import load_scene
from cellwright.kb.model.body_shapes import Pose
from cellwright.kb.model.cell_model import Placement
from cellwright.kb.targets import BUNDLED_DOMAINS

SCENE = load_scene(BUNDLED_DOMAINS / "handey" / "scene.yaml")


@pytest.fixture(scope="module")
def plan() -> Placed:
    """The bundled scene's plan."""
    found, _ = place_part(SCENE, "angle", "base")
    assert isinstance(found, Placed)
    return found


def test_jaws_take_away_the_error_along_their_way_and_keep_the_turn_about_it() -> None:
    x = np.array([1.0, 0.0, 0.0])
    found = np.diag(after_grasps(np.eye(6), [x]))
    np.testing.assert_array_equal(found, [0, 1, 1, 1, 0, 0])
    np.testing.assert_array_equal(
        after_grasps(np.eye(6), [x, np.array([0.0, 1.0, 0.0])])[2, 2], 1.0
    )


def test_grasps_never_make_a_pose_less_sure(plan: Placed) -> None:
    found = at_goal(plan)
    assert np.linalg.eigvalsh(found)[0] > -1e-15
    assert np.trace(found) <= np.trace(plan.sighting.covariance) + 1e-15


def seen_at(x: float, y: float, turn: float) -> Floats:
    """An image of the scene with the angle elsewhere."""
    body = SCENE.cell.bodies["angle"]
    moved = replace(body, placement=Placement("world", Pose((x, y, 0.025), (0.0, 0.0, turn))))
    cell = replace(SCENE.cell, bodies={**SCENE.cell.bodies, "angle": moved})
    return depth_image(SCENE, GeometricWorld.of(cell), camera_of(SCENE)).depth


@pytest.mark.slow
def test_a_part_that_was_moved_after_the_first_look_is_planned_for_anew(plan: Placed) -> None:
    since = look_again(SCENE, "angle", "base", plan, seen_at(0.43, 0.15, -0.4))
    assert since.moved_m == pytest.approx(np.hypot(0.02, 0.03), abs=0.001)
    assert isinstance(since.answer, Placed)
    np.testing.assert_allclose(since.answer.T_world_part[:3, 3], (0.43, 0.15, 0.025), atol=0.001)


def test_a_plan_is_kept_while_the_part_is_where_it_was(plan: Placed) -> None:
    assert (
        look_again(SCENE, "angle", "base", plan, seen_at(0.45, 0.18, np.radians(35))).answer is plan
    )


def test_a_part_that_is_gone_is_told(plan: Placed) -> None:
    world = GeometricWorld.of(SCENE.cell)
    gone = depth_image(SCENE, world, camera_of(SCENE), {"angle"}).depth
    since = look_again(SCENE, "angle", "base", plan, gone)
    assert isinstance(since.answer, NotPlaced)
    assert since.answer.step == "sight"
