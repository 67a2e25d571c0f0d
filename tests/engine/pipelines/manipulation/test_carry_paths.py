"""The hand goes round what stands in its straight way, in the grasp plane; what is drawn and
pushed may be stuck there.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.rigid import translation
from cellwright.engine.model.manipulation_values import HandApproach, NoApproach
from cellwright.engine.model.motion_values import Strategy
from cellwright.engine.pipelines.manipulation.carry_paths import (
    MOTION_MARGIN_M,
    ApproachPath,
    gross_motion,
    way_in,
)
from cellwright.engine.pipelines.manipulation.part_grasps import ArmReach, jaws_of, with_hand
from cellwright.engine.pipelines.manipulation.place_answers import Placed
from cellwright.engine.pipelines.manipulation.place_operation import place_part
from cellwright.engine.pipelines.manipulation.placement_views import GOAL, START, regrasp_graph
from cellwright.engine.pipelines.manipulation.scene_camera import look_for_parts
from cellwright.engine.pipelines.manipulation.workspace import (
    AssemblySite,
    HandApproachKind,
    MotionManner,
    PlaceTask,
)
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.kb.loader.scene_file import load_scene
from cellwright.kb.model.body_shapes import Box, PlacedShape
from cellwright.kb.model.cell_model import Body, BodyKind, Placement
from cellwright.kb.model.part_scene import Scene
from cellwright.kb.targets import BUNDLED_DOMAINS

SCENE = load_scene(BUNDLED_DOMAINS / "handey" / "scene.yaml")


@pytest.fixture(scope="module")
def plan() -> Placed:
    """How the part is placed where nothing stands around."""
    found, _ = place_part(SCENE, "angle", "base")
    assert isinstance(found, Placed)
    return found


@pytest.fixture(scope="module")
def barred(plan: Placed) -> Scene:
    """The scene with a bar straight above one end of the cross-piece: the hand must go aside
    before it goes up.
    """
    carry = plan.carries[0]
    T = plan.T_world_part @ carry.T_part_hand @ translation(0.065, 0.0, -0.117)
    at = Placement("world", transforms.to_pose(T))
    bar = Body("bar", BodyKind.FIXTURE, at, (PlacedShape(Box((0.016, 0.06, 0.01))),))
    return replace(SCENE, cell=replace(SCENE.cell, bodies={**SCENE.cell.bodies, "bar": bar}))


def task_of(scene: Scene, plan: Placed, manner: MotionManner) -> PlaceTask:
    world = GeometricWorld.of(scene.cell)
    site = AssemblySite.of(
        scene, world, look_for_parts(scene, world, (), 0), {"angle": plan.T_world_part}, manner
    )
    return site.task("angle", (plan.T_world_part, plan.T_world_goal))


def hold_of(task: PlaceTask, plan: Placed) -> int:
    apart = np.abs(task.holds.poses - plan.carries[0].T_part_hand).max(axis=(1, 2))
    return int(np.argmin(apart))


@pytest.mark.parametrize("coming", [HandApproachKind.STRAIGHT, HandApproachKind.COMPLETE])
def test_a_bar_above_the_hand_stops_the_straight_way_and_not_the_one_in_the_plane(
    barred: Scene, plan: Placed, coming: HandApproachKind
) -> None:
    task = task_of(barred, plan, MotionManner(coming))
    out = ApproachPath(task, hold_of(task, plan), plan.T_world_part)
    hand = with_hand(task.world, barred, task.holds.jaws, plan.carries[0].grasp.opening)
    reach = ArmReach(hand.put("angle", "world", plan.T_world_part), "arm")
    q = plan.carries[0].legs[1].path[-1]
    found = out.configurations(reach, q)
    if coming is HandApproachKind.STRAIGHT:
        assert found is None
        return
    assert found is not None
    assert not reach.checker.collides(found).any()
    assert np.abs(found[0] - q).max() < 1e-12
    away = [
        hand.moved("arm", each).pose("world", "arm.tool")[:3, 3] for each in (found[0], found[-1])
    ]
    assert np.linalg.norm(away[1] - away[0]) > 0.1


def test_whatever_way_is_found_in_the_plane_is_free_there(barred: Scene, plan: Placed) -> None:
    from cellwright.engine.pipelines.manipulation.carry_paths import _poses_between, plane_of

    task = task_of(barred, plan, MotionManner(HandApproachKind.COMPLETE))
    found = ApproachPath(task, hold_of(task, plan), plan.T_world_part).in_plane
    assert isinstance(found, HandApproach)
    assert (found.poses[-1] == 0.0).all()
    assert plane_of(task, plan.carries[0]).free(_poses_between(found.poses)).all()


def test_a_part_under_a_bar_is_placed_all_the_same(barred: Scene) -> None:
    found, _ = place_part(barred, "angle", "base")
    assert isinstance(found, Placed)
    assert all(leg.proved for carry in found.carries for leg in carry.legs)


def test_potentials_are_stuck_before_the_bar(barred: Scene, plan: Placed) -> None:
    task = task_of(barred, plan, MotionManner(HandApproachKind.POTENTIAL))
    out = ApproachPath(task, hold_of(task, plan), plan.T_world_part)
    assert isinstance(out.in_plane, NoApproach)
    assert "in balance" in out.stuck()


def test_a_plan_shows_its_way_in_as_poses_in_the_plane_that_end_at_the_grasp(plan: Placed) -> None:
    way = way_in(GeometricWorld.of(SCENE.cell), SCENE, plan.carries[0])
    np.testing.assert_allclose(way[-1], 0.0, atol=1e-6)
    np.testing.assert_allclose(way[0], (0.0, -0.1, 0.0), atol=1e-6)


@pytest.mark.parametrize("strategy", [Strategy.REDUCED, Strategy.VISIBILITY])
def test_gross_motions_may_be_those_of_the_seed(strategy: Strategy) -> None:
    found, _ = place_part(
        SCENE, "angle", "base", manner=MotionManner(HandApproachKind.COMPLETE, strategy)
    )
    assert isinstance(found, Placed)
    assert all(leg.proved for leg in found.carries[0].legs)


def test_the_graph_of_placements_holds_what_the_plan_took(plan: Placed) -> None:
    shown = regrasp_graph(task_of(SCENE, plan, MotionManner()), plan)
    assert shown.taken == (START, GOAL)
    assert shown.holds[START] == plan.holds[1]
    assert shown.holds[GOAL] == plan.holds[2]
    assert shown.ways[START, GOAL] > 0
    assert all(
        0 < count <= min(shown.holds[a], shown.holds[b]) for (a, b), count in shown.ways.items()
    )


def reach_beside(lower_m: float) -> tuple[ArmReach, Floats]:
    """The arm with its hand, and a straight line (2, k) for it; a block is so far below the
    middle of the line.
    """
    home = GeometricWorld.of(SCENE.cell)
    line = np.stack([home.configuration, home.configuration])
    line[1, home.first_carriers[SCENE.hand.arm]] += 1.0
    T = home.moved(SCENE.hand.arm, line.mean(axis=0)).pose("world", f"{SCENE.hand.arm}.tool").copy()
    T[2, 3] -= lower_m
    at = Placement("world", transforms.to_pose(T))
    block = Body("block", BodyKind.FIXTURE, at, (PlacedShape(Box((0.05, 0.05, 0.05))),))
    world = GeometricWorld.of(replace(SCENE.cell, bodies={**SCENE.cell.bodies, "block": block}))
    return ArmReach(with_hand(world, SCENE, jaws_of(SCENE), (0.05,)), SCENE.hand.arm), line


def clearance_m(reach: ArmReach, path: Floats) -> float:
    """The least clearance where a path (m, k) is looked at."""
    shares = np.linspace(0, 1, 200)[:, None]
    looks = [one + shares * (other - one) for one, other in pairwise(path)]
    return float(reach.checker.clearance(np.concatenate(looks), 1.0).min())


def grazing() -> tuple[ArmReach, Floats]:
    """The same with the block some two millimetres from the line."""
    near, far = 0.0, 0.3
    for _ in range(12):
        middle = (near + far) / 2
        near, far = (near, middle) if clearance_m(*reach_beside(middle)) > 0.002 else (middle, far)
    return reach_beside(far)


def test_a_motion_between_keeps_a_margin_where_a_straight_one_would_graze_something() -> None:
    reach, line = grazing()
    assert 0.002 < clearance_m(reach, line) < MOTION_MARGIN_M
    found = gross_motion(reach, line[0], line[1])
    assert found is not None
    assert found.proved
    assert clearance_m(reach, found.path) > MOTION_MARGIN_M


def test_a_motion_between_goes_without_the_margin_where_its_end_has_no_room_for_it() -> None:
    reach, line = grazing()
    found = gross_motion(reach, line[0], line.mean(axis=0))
    assert found is not None
    assert found.proved
