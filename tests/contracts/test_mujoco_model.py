"""The witness's model of a cell: it can be read by the physics engine, and everything stays
where it stands.
"""

import xml.etree.ElementTree as ET

import numpy as np
import pytest

from cellwright.engine.pipelines.simulators.mujoco_replay.mujoco_model import mujoco_xml
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.kb.loader.cell import cell_of

SETTLING = 150  # steps of the engine


@pytest.fixture(scope="module")
def world() -> GeometricWorld:
    return GeometricWorld.of(cell_of("themse/one"))


def test_every_body_is_in_the_model_and_both_fingers_are_driven(world: GeometricWorld) -> None:
    model = ET.fromstring(mujoco_xml(world))
    names = {each.get("name") for each in model.iter("body")}
    assert set(world.cell.bodies) <= names
    driven = {each.get("joint") for each in model.iter("position")}
    assert {"finger_left", "finger_right", "flap"} <= driven
    assert "drawer" not in driven


def test_an_arm_rides_on_its_carriage_and_its_tools_hang_free_in_their_rack() -> None:
    world = GeometricWorld.of(cell_of("bulkhead/one_point"))
    model = ET.fromstring(mujoco_xml(world))
    carriage = next(each for each in model.iter("body") if each.get("name") == "carriage")
    inside = {each.get("name") for each in carriage.iter("body")}
    assert {"t3_746.flange", "tool_rack"} <= inside
    assert not {"us_probe", "slra"} & inside
    assert {each.get("body2") for each in model.iter("weld")} == {"tool_rack"}
    assert "carriage" in {each.get("joint") for each in model.iter("position")}


def test_parts_stay_where_they_stand(world: GeometricWorld) -> None:
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(mujoco_xml(world))
    data = mujoco.MjData(model)
    for name, body in world.cell.bodies.items():
        if body.kind.value == "part":
            data.joint(name).qpos[:3] = world.pose("world", name)[:3, 3]
    for joint, value in zip(
        world.cell.arms["manutec_r3"].arm.joints, world.configuration, strict=True
    ):
        data.joint(f"manutec_r3/{joint.name}").qpos[0] = value
        data.actuator(f"manutec_r3/{joint.name}").ctrl[0] = value
    for _ in range(SETTLING):
        mujoco.mj_step(model, data)
    for name in ("probe_1", "probe_2", "probe_3", "probe_4", "lid"):
        assert np.linalg.norm(data.body(name).xpos - world.pose("world", name)[:3, 3]) < 0.003
