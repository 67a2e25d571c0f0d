"""Assemblies and single parts, carried out in MuJoCo (the extra `mujoco`): what is planned
comes true, and faults are met.
"""

from dataclasses import replace

import numpy as np
import pytest

from cellwright.engine.pipelines.manipulation.assembly_order import Built, assemble_scene
from cellwright.engine.pipelines.manipulation.place_answers import Carry, Placed
from cellwright.engine.pipelines.manipulation.place_operation import place_part
from cellwright.engine.stages.geometry.shapes.facet_solids import solid_of
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.engine.stages.grasping.hole_insertion import HoleSearch
from cellwright.engine.stages.grasping.stable_placements import volume_and_centre
from cellwright.kb.loader import load_domain
from cellwright.kb.loader.scene_file import load_scene
from cellwright.kb.model.part_scene import Scene
from cellwright.kb.targets import BUNDLED_DOMAINS

running = pytest.importorskip(
    "cellwright.engine.pipelines.manipulation.assembly_execution", exc_type=ImportError
)
DOMAIN = load_domain("handey")
FIVE = load_scene(BUNDLED_DOMAINS / "handey" / "scenes" / "five.yaml")
SCENE = load_scene(BUNDLED_DOMAINS / "handey" / "scene.yaml")
NEAR_M = 0.003


def related(scene: Scene, *parts: str) -> Scene:
    """The scene with the relations of some parts only."""
    keep = [each for each in scene.relations if {each.first[0], each.second[0]} <= {*parts, "base"}]
    return replace(scene, relations=tuple(keep))


@pytest.fixture(scope="module")
def two() -> Built:
    """Two walls of the bundled assembly."""
    made, _ = assemble_scene(related(FIVE, "wall_1", "wall_2"), DOMAIN, "base")
    assert isinstance(made, Built)
    return made


def test_a_part_is_placed_by_friction_alone_within_three_millimetres() -> None:
    found, _ = place_part(SCENE, "angle", "base")
    assert isinstance(found, Placed)
    done = running.execute_carries(SCENE, "angle", found)
    assert done.went is running.CarryEnd.DONE
    assert not done.touched
    assert done.off[0] < NEAR_M
    assert done.off[1] < np.radians(1)


@pytest.mark.parametrize("carries", [False, True])
def test_an_arm_that_moves_is_where_it_is_told_to_be(carries: bool) -> None:
    """Servos that were aimed at where the arm is to be would lag by some 70 mm at this speed."""
    shop = running.MujocoCell(SCENE)
    world, tool, off = GeometricWorld.of(SCENE.cell), f"{shop.arm}.tool", []

    def seen() -> bool:
        told = world.moved(shop.arm, shop.q).pose("world", tool)
        there = shop.stage.actual(shop.stage.world).pose("world", tool)
        off.append(float(np.linalg.norm(told[:3, 3] - there[:3, 3])))
        return False

    turn = np.zeros(len(shop.q))
    turn[0] = 1.0
    assert shop.follow(np.array([shop.q, shop.q + turn, shop.q]), seen, carries)
    assert max(off) < 0.005


@pytest.mark.slow
def test_five_parts_are_assembled_and_nothing_touches_unplanned() -> None:
    made, _ = assemble_scene(FIVE, DOMAIN, "base")
    assert isinstance(made, Built)
    done = running.execute_assembly(made, DOMAIN)
    assert [run.outcome for run in done.runs] == ["reached"]
    assert not done.refused
    assert not done.touched
    assert len(done.off) == 5
    assert all(metres < NEAR_M for metres, _ in done.off.values())


@pytest.mark.slow
@pytest.mark.parametrize("shift", [(0.03, 0.02, 0.4), (0.008, 0.003, 0.0), (-0.02, 0.0, 0.2)])
def test_a_part_that_was_moved_after_it_was_seen_is_found_again_and_placed(
    two: Built, shift: tuple[float, float, float]
) -> None:
    x, y, turn = shift
    done = running.execute_assembly(two, DOMAIN, [running.PartShift("wall_2", (x, y), turn)])
    assert done.runs[-1].outcome == "reached"
    assert all(metres < NEAR_M for metres, _ in done.off.values())
    assert sum(run.exceptions for run in done.runs) >= 1


@pytest.mark.slow
def test_a_part_that_was_taken_away_is_told_missing_and_the_rest_is_built(two: Built) -> None:
    done = running.execute_assembly(two, DOMAIN, [running.PartShift("wall_1", away=True)])
    assert done.runs[-1].outcome == "partly"
    assert any("part_missing" in each for run in done.runs for each in run.story)
    assert set(done.off) == {"wall_2"}


@pytest.mark.slow
def test_a_second_look_from_near_by_is_taken_where_the_tolerance_asks_for_it(two: Built) -> None:
    """The tolerance lies between what the first look and a nearer one allow."""
    from cellwright.engine.pipelines.manipulation.assembly_execution import PlacingCell
    from cellwright.engine.pipelines.manipulation.pose_uncertainty import (
        brought_covariance,
        within_m,
    )

    assert PlacingCell
    yard = two.yard
    doubts = {
        move.part: within_m(
            brought_covariance(two.looked.sightings[move.part], carries, yard.goals[move.part])
        )
        for move, carries in two.moves
    }
    part, most = max(doubts.items(), key=lambda each: each[1])
    scene = replace(yard.site.scene, tolerance_m=most * 0.95)
    strict = replace(two, yard=replace(yard, site=replace(yard.site, scene=scene)))
    done = running.execute_assembly(strict, DOMAIN)
    assert done.runs[-1].outcome == "reached", done.runs
    assert any("place_unsure" in each and part in each for run in done.runs for each in run.story)


@pytest.mark.slow
def test_a_camera_that_was_knocked_is_found_out_and_calibrated_by_the_arm_itself() -> None:
    from cellwright.engine.pipelines.manipulation.camera_optics import CameraErrors, CameraOptics
    from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld

    knock, scene = CameraErrors((0.025, 0.01, 0.0)), related(FIVE, "wall_1", "wall_2")
    image = CameraOptics.of(scene, knock).image(GeometricWorld.of(scene.cell), 0)
    made, _ = assemble_scene(scene, DOMAIN, "base", image=image)
    assert isinstance(made, Built)
    done = running.execute_assembly(made, DOMAIN, knock=knock)
    assert done.runs[-1].outcome == "reached"
    assert any(
        "camera_moved; calibrate_the_camera" in each for run in done.runs for each in run.story
    )
    assert all(metres < NEAR_M for metres, _ in done.off.values())


@pytest.mark.slow
def test_three_fingers_hold_a_part_still_and_place_it() -> None:
    scene = load_scene(BUNDLED_DOMAINS / "handey" / "scenes" / "fingers.yaml")
    found, _ = place_part(scene, "angle", "base")
    assert isinstance(found, Placed)
    done = running.execute_carries(scene, "angle", found)
    assert done.went is running.CarryEnd.DONE
    assert not done.touched
    assert done.off[0] < NEAR_M
    assert done.off[1] < np.radians(1)


@pytest.mark.slow
def test_a_round_peg_whose_hole_is_a_millimetre_beside_goes_in_when_it_is_tilted() -> None:
    """On whatever side the hole is; and on none when it goes straight down."""
    scene = load_scene(BUNDLED_DOMAINS / "handey" / "scenes" / "round_peg.yaml")
    found, _ = place_part(scene, "peg", "block")
    assert isinstance(found, Placed)
    (carry,) = found.carries
    assert carry.insertion is not None
    assert carry.insertion.search is HoleSearch.TILT
    straight = replace(carry, insertion=replace(carry.insertion, search=HoleSearch.NONE))

    def goes_in(tried: Carry, direction: int) -> bool:
        angle, block = (
            np.pi * direction / 4,
            GeometricWorld.of(scene.cell).pose("world", "block").copy(),
        )
        block[:2, 3] += 0.00114 * np.cos(angle), 0.00114 * np.sin(angle)
        moved = running.MujocoCell(scene, {"block": block})
        return (
            running.execute_carries(scene, "peg", replace(found, carries=(tried,)), moved).went
            is running.CarryEnd.DONE
        )

    assert all(goes_in(carry, each) for each in range(8))
    assert not any(goes_in(straight, each) for each in (0, 3))


def test_a_body_of_several_blocks_weighs_where_its_volume_is() -> None:
    """An angle stands on its toe with four millimetres to spare; with its mass shared out
    evenly it would tip over.
    """
    shop = running.MujocoCell(SCENE)
    body = shop.stage.model.body("angle")
    volume, centre = volume_and_centre(solid_of(SCENE.cell.bodies["angle"]))
    assert body.mass[0] == pytest.approx(volume * SCENE.density)
    np.testing.assert_allclose(body.ipos, centre, atol=1e-6)
