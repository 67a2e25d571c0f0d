"""Which places an arm reaches, on cells made up here and on the bundled ones."""

import math
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cellwright.engine.authoring import domain_check
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.collision.builtin import BuiltinBackend
from cellwright.engine.stages.geometry.reach.cell_check import check_cell
from cellwright.engine.stages.geometry.reach.place_reachability import (
    PlaceReachability,
    ReachedPlace,
    UnreachedPlace,
)
from cellwright.engine.stages.geometry.world.collision_scene import collision_scene_of
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.kb.loader import bundled_domains, load_domain
from cellwright.kb.loader.arm_file import bundled_arms, load_arm
from cellwright.kb.loader.cell import load_cell
from cellwright.kb.model.body_shapes import Box, PlacedShape, Pose
from cellwright.kb.model.cell_model import Arm, Body, BodyKind, Cell, MountedArm, Place, Placement
from cellwright.kb.targets import bundled_devices

BACKEND = BuiltinBackend()
TOOL = Pose((0.0, 0.02, 0.1), (0.1, 0.2, 0.3))


def cell_of(arm: Arm, **changed: object) -> Cell:
    table = Body(
        "table",
        BodyKind.FIXTURE,
        Placement("world", Pose((0, 0, -0.3))),
        (PlacedShape(Box((3.0, 3.0, 0.1))),),
    )
    cell = Cell("made_up", {"arm": MountedArm(arm, Placement(), TOOL)}, bodies={"table": table})
    return replace(cell, **changed)  # type: ignore[arg-type]


@pytest.fixture(params=["ur5", "manutec_r3", "puma_560"])
def cell(request: pytest.FixtureRequest) -> Cell:
    return cell_of(load_arm(bundled_arms()[request.param]))


def place(T: np.ndarray, **more: object) -> Place:
    return replace(Place("there", Placement("world", transforms.to_pose(T)), "arm"), **more)  # type: ignore[arg-type]


def test_every_pose_of_a_free_configuration_is_reached_by_answers_that_take_it(cell: Cell) -> None:
    world, checker = (
        GeometricWorld.of(cell),
        BACKEND.checker(collision_scene_of(GeometricWorld.of(cell))),
    )
    model, T_flange_tool = world.models["arm"], transforms.of_pose(TOOL)
    q = model.random(30, np.random.default_rng(1))
    free = q[~checker.collides(q)]
    assert len(free) > 5
    ask = PlaceReachability(world, BACKEND)
    for one in free:
        answer = ask.at(place(model.flange_pose(one) @ T_flange_tool))
        assert isinstance(answer, ReachedPlace)
        assert np.abs(model.flange_pose(answer.q) - model.flange_pose(one)).max() < 1e-8
        assert model.within_limits(answer.q).all()
        assert not checker.collides(answer.q).any()
        assert np.abs(np.sin((answer.q - one) / 2)).max(axis=1).min() < 1e-5


def reason(cell: Cell, where: Place) -> str:
    answer = PlaceReachability(GeometricWorld.of(cell), BACKEND).at(where)
    assert isinstance(answer, UnreachedPlace)
    assert answer.hint
    return answer.reason


def test_a_place_out_of_reach_is_told_with_its_distance(cell: Cell) -> None:
    assert "out of the reach of arm: 5.00 m" in reason(
        cell, place(transforms.translation(3.0, 0.0, 4.0))
    )


def test_a_wrong_orientation_is_told_from_a_place_out_of_reach() -> None:
    cell = cell_of(load_arm(bundled_arms()["ur5"]))
    above = transforms.translation(0.0, 0.0, 1.0)
    outwards = replace(cell, arms={"arm": replace(cell.arms["arm"], tool=Pose((0, 0, 0.1)))})
    assert "not in this orientation" in reason(
        outwards, place(above @ transforms.of_pose(Pose((0, 0, 0), (math.pi, 0, 0))))
    )


def test_a_joint_limit_is_named_with_how_far_it_is_exceeded() -> None:
    arm = load_arm(bundled_arms()["ur5"])
    first = replace(arm.joints[0], lower=-0.1, upper=0.1)
    limited = cell_of(replace(arm, joints=(first, *arm.joints[1:])))
    model = GeometricWorld.of(limited).models["arm"]
    T = model.flange_pose(np.array([1.4, -1.3, 1.4, -1.6, -1.5, 0.0])) @ transforms.of_pose(TOOL)
    assert "joint_1 of arm would have to go" in reason(limited, place(T))


def test_what_is_in_the_way_is_named_unless_the_place_may_be_touched() -> None:
    cell = cell_of(load_arm(bundled_arms()["ur5"]))
    q = np.array([0.3, -1.3, 1.4, -1.6, -1.5, 0.0])
    T = GeometricWorld.of(cell).models["arm"].flange_pose(q) @ transforms.of_pose(TOOL)
    block = Body(
        "block",
        BodyKind.FIXTURE,
        Placement("world", transforms.to_pose(T)),
        (PlacedShape(Box((0.3, 0.3, 0.3))),),
    )
    blocked = replace(cell, bodies={**cell.bodies, "block": block})
    assert "touches block by" in reason(blocked, place(T))
    small = replace(block, shapes=(PlacedShape(Box((0.1, 0.1, 0.24))),))
    touching = replace(cell, bodies={**cell.bodies, "block": small})
    assert "touches block" in reason(touching, place(T))
    allowed = place(T, touches=("block",))
    assert "touches block" in reason(touching, allowed)
    deep = replace(allowed, depth_m=1.0)
    assert isinstance(
        PlaceReachability(GeometricWorld.of(touching), BACKEND).at(deep), ReachedPlace
    )


def test_the_approach_must_be_reached_too(cell: Cell) -> None:
    world = GeometricWorld.of(cell)
    model = world.models["arm"]
    checker = BACKEND.checker(collision_scene_of(world))
    q = model.random(200, np.random.default_rng(2))
    free = q[~checker.collides(q)]
    T = model.flange_pose(free[0]) @ transforms.of_pose(TOOL)
    assert "approaching it from 20 m" in reason(cell, place(T, approach_m=20.0))


def test_a_tool_that_may_turn_reaches_whatever_its_turn(cell: Cell) -> None:
    model = GeometricWorld.of(cell).models["arm"]
    checker = BACKEND.checker(collision_scene_of(GeometricWorld.of(cell)))
    q = model.random(200, np.random.default_rng(3))
    T = model.flange_pose(q[~checker.collides(q)][0]) @ transforms.of_pose(TOOL)
    turned = T @ transforms.of_pose(Pose((0, 0, 0), (0, 0, math.pi / 3)))
    answer = PlaceReachability(GeometricWorld.of(cell), BACKEND).at(place(turned, turns=True))
    assert isinstance(answer, ReachedPlace)
    tips = model.flange_pose(answer.q) @ transforms.of_pose(TOOL)
    assert np.abs(tips[:, :3, 2:] - T[:3, 2:]).max() < 1e-8


@pytest.mark.parametrize("name", ["themse", "bulkhead"])
def test_every_place_of_the_bundled_cells_is_reached(name: str) -> None:
    path = bundled_domains()[name] / "cell.yaml"
    assert check_cell(path, load_domain(name), BuiltinBackend) == []
    world = GeometricWorld.of(load_cell(path))
    assert not BACKEND.checker(collision_scene_of(world)).collides(world.configuration[None]).any()


def test_a_place_that_the_domain_does_not_know_is_told(tmp_path: Path) -> None:
    text = (
        (bundled_domains()["bulkhead"] / "cell.yaml").read_text().replace("meas(m1):", "mess(m1):")
    )
    (tmp_path / "cell.yaml").write_text(text)
    (found,) = check_cell(tmp_path / "cell.yaml", load_domain("bulkhead"))
    assert (found.code, found.warning, found.hint) == ("K101", True, "did you mean 'meas'?")


def test_a_depot_of_some_problem_without_a_pose_is_told(tmp_path: Path) -> None:
    for file in ("domain.yaml", "rules.lp", "cell.yaml", "problems/furnace_of_two.yaml"):
        (tmp_path / file).parent.mkdir(exist_ok=True)
        (tmp_path / file).write_text(
            (bundled_domains()["themse"] / file).read_text("utf-8"), "utf-8"
        )
    assert codes(tmp_path) == set()
    furnace = (
        shutil.copytree(bundled_devices()["furnace"], tmp_path / "devices" / "furnace")
        / "cell.yaml"
    )
    furnace.write_text(
        furnace.read_text("utf-8").replace("slot($name, 2)", "slot($name, 3)"), "utf-8"
    )
    (found,) = [
        each
        for each in domain_check.check_domain_files(str(tmp_path)).diagnostics
        if each.code == "K705"
    ]
    assert found.message == "no configuration reaches slot(furnace, 2): it has no place"
    assert found.warning


def codes(folder: Path) -> set[str]:
    """What is wrong with the cell of a domain folder."""
    found = domain_check.check_domain_files(str(folder)).diagnostics
    return {each.code for each in found if each.where.path.endswith("cell.yaml")}


def test_a_shape_that_encloses_nothing_is_told_before_anything_is_computed(tmp_path: Path) -> None:
    (tmp_path / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    lines = [
        "cell: flat",
        "arms: {arm: {model: ur5}}",
        "fixtures: {sheet: {shapes: [{mesh: {file: flat.obj}}]}}",
    ]
    (tmp_path / "cell.yaml").write_text("\n".join(lines) + "\n")
    (found,) = check_cell(tmp_path / "cell.yaml", load_domain("bulkhead"), BuiltinBackend)
    assert found.code == "K702"
    assert found.where.line == 3
