"""Arms from URDF and SRDF: frames, package paths, and a diagnostic for whatever does not hold
together.
"""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.kinematics.arm_model import ArmModel
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, select_errors
from cellwright.kb.loader.cell import load_cell
from cellwright.kb.loader.reader import LoadFindings
from cellwright.kb.loader.urdf import urdf_arm
from cellwright.kb.model.body_shapes import Box, Cylinder, Mesh, Pose, Sphere
from cellwright.kb.model.cell_model import Arm, Inertia, JointKind, Mimic

ROBOT = """<?xml version="1.0"?>
<robot name="crane">
  <link name="foot"><collision><geometry><box size="0.4 0.4 0.1"/></geometry></collision></link>
  <link name="mast"><collision><origin xyz="0 0 0.2"/><geometry><cylinder radius="0.05" length="0.4"/></geometry>
    </collision></link>
  <link name="plate"/>
  <link name="boom"><collision><geometry><sphere radius="0.1"/></geometry></collision></link>
  <link name="trolley"><collision><geometry><mesh filename="package://crane/hook.obj" scale="2 2 2"/></geometry>
    </collision></link>
  <link name="left_jaw"/>
  <joint name="slew" type="continuous">
    <parent link="foot"/><child link="mast"/><origin xyz="0 0 0.1" rpy="0 0 0.5"/><axis xyz="0 0 2"/></joint>
  <joint name="weld" type="fixed">
    <parent link="mast"/><child link="plate"/><origin xyz="0 0 0.5" rpy="0.3 0 0"/></joint>
  <joint name="lift" type="revolute">
    <parent link="plate"/><child link="boom"/><origin xyz="0.1 0 0"/><axis xyz="0 1 1"/>
    <limit lower="-1" upper="1.5" velocity="2" effort="1"/></joint>
  <joint name="run" type="prismatic">
    <parent link="boom"/><child link="trolley"/><limit lower="0" upper="2" velocity="0.5" effort="1"/></joint>
  <joint name="jaw" type="revolute">
    <parent link="trolley"/><child link="left_jaw"/><axis xyz="0 0 1"/><limit lower="0" upper="1"/></joint>
</robot>
"""
SRDF = """<robot name="crane">
  <disable_collisions link1="foot" link2="boom" reason="Never"/>
  <disable_collisions link1="foot" link2="propeller" reason="Never"/>
</robot>
"""
HOOK = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "packages" / "crane").mkdir(parents=True)
    (tmp_path / "packages" / "crane" / "hook.obj").write_text(HOOK)
    (tmp_path / "crane.urdf").write_text(ROBOT)
    (tmp_path / "crane.srdf").write_text(SRDF)
    return tmp_path


def read(folder: Path, srdf: bool = False) -> tuple[Arm | None, list[Diagnostic]]:
    """The arm from foot to trolley, if it could be read, and everything that was found."""
    findings = LoadFindings()
    given_srdf = folder / "crane.srdf" if srdf else None
    try:
        arm = urdf_arm(
            folder / "crane.urdf", given_srdf, ("foot", "trolley"), [folder / "packages"], findings
        )
    except InvalidInput as error:
        return None, list(error.diagnostics)
    return arm, list(findings.diagnostics)


def test_the_flange_of_a_chain_is_the_product_of_its_transforms(folder: Path) -> None:
    arm, _ = read(folder)
    assert arm is not None
    assert [joint.kind for joint in arm.joints] == [
        JointKind.REVOLUTE,
        JointKind.REVOLUTE,
        JointKind.PRISMATIC,
    ]
    q = np.array([0.7, -0.4, 1.2])
    expected = (
        transforms.of_pose(Pose((0, 0, 0.1), (0, 0, 0.5)))
        @ transforms.transform(transforms.rotation((0, 0, 1), 0.7), np.zeros(3))
        @ transforms.of_pose(Pose((0, 0, 0.5), (0.3, 0, 0)))
        @ transforms.of_pose(Pose((0.1, 0, 0)))
        @ transforms.transform(
            transforms.rotation(np.array([0, 1, 1]) / math.sqrt(2), -0.4), np.zeros(3)
        )
        @ transforms.translation(1.2, 0, 0)
    )
    assert np.abs(ArmModel(arm).flange_pose(q) - expected).max() < 1e-12


def test_limits_speeds_shapes_and_what_hangs_on_the_chain_are_kept(folder: Path) -> None:
    arm, found = read(folder)
    assert arm is not None
    slew, lift, run = arm.joints
    assert (slew.lower, slew.upper) == (-math.inf, math.inf)
    assert (lift.lower, lift.upper, lift.speed) == (-1.0, 1.5, 2.0)
    assert (run.lower, run.upper) == (0.0, 2.0)
    shapes = {link.name: [placed.shape for placed in link.shapes] for link in arm.links}
    assert shapes["foot"] == [Box((0.4, 0.4, 0.1))]
    assert shapes["mast"] == [Cylinder(0.05, 0.4)]
    assert shapes["boom"] == [Sphere(0.1)]
    (hook,) = shapes["trolley"]
    assert isinstance(hook, Mesh)
    assert (Path(hook.path).name, hook.scale) == ("hook.obj", (2.0, 2.0, 2.0))
    assert {link.name: link.carrier for link in arm.links} == {
        "foot": 0,
        "mast": 1,
        "plate": 1,
        "boom": 2,
        "trolley": 3,
        "left_jaw": 3,
    }
    (frozen,) = found
    assert (frozen.warning, "'jaw' is not on the chain" in frozen.message) == (True, True)


def test_pairs_that_an_srdf_disables_and_neighbours_may_touch(folder: Path) -> None:
    arm, found = read(folder, srdf=True)
    assert arm is not None
    assert frozenset({"foot", "boom"}) in arm.allowed
    assert frozenset({"plate", "boom"}) in arm.allowed
    assert frozenset({"foot", "trolley"}) not in arm.allowed
    assert any("propeller" in each.message and each.warning for each in found)


def test_a_cell_may_name_a_urdf_with_its_packages(folder: Path) -> None:
    lines = [
        "cell: yard",
        "arms:",
        "  crane: {urdf: crane.urdf, packages: [packages], chain: [foot, trolley]}",
    ]
    (folder / "cell.yaml").write_text("\n".join(lines) + "\n")
    assert len(load_cell(folder / "cell.yaml").arms["crane"].arm.joints) == 3


def test_an_arm_rests_with_sliding_joints_in_units_of_length(folder: Path) -> None:
    crane = "{urdf: crane.urdf, packages: [packages], chain: [foot, trolley], home: [90, 0, 0.5]}"
    (folder / "cell.yaml").write_text(
        f"cell: yard\nunits: {{angle: deg}}\narms:\n  crane: {crane}\n"
    )
    assert load_cell(folder / "cell.yaml").arms["crane"].home == (
        pytest.approx(math.pi / 2),
        0.0,
        0.5,
    )


BROKEN = {  # what is replaced by what: the code, and a word of the message
    "not XML": ("</robot>", "", "K703", "not XML"),
    "another root": ("robot", "tractor", "K703", "is not a robot"),
    "an entity": ('<?xml version="1.0"?>', '<!DOCTYPE robot [<!ENTITY a "b">]>', "K703", "refused"),
    "no name": ('<link name="plate"/>', "<link/>", "K703", "without a name"),
    "twice": (
        '<link name="plate"/>',
        '<link name="plate"/><link name="plate"/>',
        "K703",
        "second one",
    ),
    "no such link": (
        '<child link="boom"/>',
        '<child link="bloom"/>',
        "K703",
        "names no link 'bloom'",
    ),
    "two parents": (
        '<child link="boom"/>',
        '<child link="mast"/>',
        "K703",
        "has two parent joints",
    ),
    "a circle": (
        '<parent link="foot"/>',
        '<parent link="trolley"/>',
        "K703",
        "is its own ancestor",
    ),
    "no chain": ('<parent link="plate"/>', '<parent link="left_jaw"/>', "K703", ""),
    "joint type": ('type="prismatic"', 'type="elastic"', "K703", "unknown joint type 'elastic'"),
    "no limits": (
        '<limit lower="0" upper="2" velocity="0.5" effort="1"/>',
        "",
        "K703",
        "no limits",
    ),
    "limits": ('lower="-1" upper="1.5"', 'lower="1.5" upper="-1"', "K703", "cannot move"),
    "no axis": ('<axis xyz="0 1 1"/>', '<axis xyz="0 0 0"/>', "K703", "has no axis"),
    "no number": ('xyz="0 0 0.1"', 'xyz="0 0 up"', "K703", "not 3 finite numbers"),
    "two numbers": ('xyz="0 0 0.1"', 'xyz="0 0"', "K703", "not 3 finite numbers"),
    "endless": ('xyz="0 0 0.1"', 'xyz="0 0 inf"', "K703", "not 3 finite numbers"),
    "empty box": ('size="0.4 0.4 0.1"', 'size="0.4 0 0.1"', "K702", "without a positive size"),
    "empty sphere": ('radius="0.1"', 'radius="-0.1"', "K702", "without a positive size"),
    "empty cylinder": ('length="0.4"', 'length="0"', "K702", "without a positive size"),
    "no geometry": (
        '<geometry><sphere radius="0.1"/></geometry>',
        "",
        "K703",
        "without one geometry",
    ),
    "a shape": ('<sphere radius="0.1"/>', "<cone/>", "K703", "<cone> is not a shape"),
    "leaving": (
        "package://crane/hook.obj",
        "package://crane/../../hook.obj",
        "K706",
        "leaves its package",
    ),
    "absolute": ("package://crane/hook.obj", "package:///etc/passwd", "K706", "there is no mesh"),
    "no scale": ('scale="2 2 2"', 'scale="2 0 2"', "K702", "a scale of 0"),
    "far away": ('xyz="0 0 0.1"', 'xyz="0 0 1e30"', "K113", "larger than"),
    "huge": ('<sphere radius="0.1"/>', '<sphere radius="1e30"/>', "K113", "larger than"),
    "mass": (
        '<link name="plate"/>',
        '<link name="plate"><inertial><mass value="-1"/></inertial></link>',
        "K703",
        "below zero",
    ),
    "no mesh": ("crane/hook.obj", "crane/crook.obj", "K706", "there is no mesh"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_urdf_is_told(name: str, folder: Path) -> None:
    old, new, code, said = BROKEN[name]
    assert old in ROBOT
    (folder / "crane.urdf").write_text(ROBOT.replace(old, new))
    _, found = read(folder)
    assert any(each.code == code and said in each.message for each in select_errors(found)), found
    assert all(each.hint for each in found)


def test_a_mesh_in_another_format_is_told(folder: Path) -> None:
    (folder / "packages" / "crane" / "hook.ply").write_text("ply")
    (folder / "crane.urdf").write_text(ROBOT.replace("hook.obj", "hook.ply"))
    assert any("not a supported mesh format" in each.message for each in read(folder)[1])


PARTS = re.findall(r"<[^>]*>|[^<]+", ROBOT)


@settings(max_examples=150, deadline=None)
@given(
    st.integers(0, len(PARTS) - 1),
    st.integers(0, len(PARTS) - 1),
    st.sampled_from(["cut", "swap", "copy", "blank"]),
)
def test_no_garbled_urdf_makes_the_reader_stumble(
    tmp_path_factory: pytest.TempPathFactory, one: int, other: int, how: str
) -> None:
    parts = list(PARTS)
    if how == "cut":
        del parts[min(one, other) : max(one, other)]
    elif how == "swap":
        parts[one], parts[other] = parts[other], parts[one]
    elif how == "copy":
        parts.insert(one, parts[other])
    else:
        parts[one] = re.sub(r'"[^"]*"', '""', parts[one])
    folder = tmp_path_factory.mktemp("garbled")
    (folder / "crane.urdf").write_text("".join(parts))
    arm, found = read(folder)
    assert arm is not None or select_errors(found)
    assert all(each.hint and each.where.path.endswith("crane.urdf") for each in found)


def test_effort_inertia_and_what_a_joint_follows_are_kept(folder: Path) -> None:
    inertial = (
        '<link name="plate"><inertial><origin xyz="0 0 0.2"/><mass value="3.5"/>'
        '<inertia ixx="1" ixy="0.1" ixz="0.2" iyy="2" iyz="0.3" izz="3"/></inertial></link>'
    )
    text = ROBOT.replace('<link name="plate"/>', inertial)
    text = text.replace(
        'velocity="0.5" effort="1"/>',
        'velocity="0.5" effort="1"/><mimic joint="lift" multiplier="-2" offset="0.5"/>',
    )
    (folder / "crane.urdf").write_text(text)
    arm, found = read(folder)
    assert arm is not None
    (plate,) = (link for link in arm.links if link.name == "plate")
    assert plate.inertia == Inertia(3.5, Pose((0, 0, 0.2)), (1.0, 0.1, 0.2, 2.0, 0.3, 3.0))
    (follower,) = (joint for joint in arm.joints if joint.mimic)
    assert follower.mimic == Mimic("lift", -2.0, 0.5)
    assert follower.effort == 1.0
    assert any("follows 'lift'" in each.message and each.warning for each in found)
