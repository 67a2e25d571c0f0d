"""The UR5 cells of MotionBenchMaker (Chamzas and others 2022) as worlds: an arm of spheres among
boxes and cylinders.

They are read from the folder `ur5_mbm` of the data: `ur5_spherized.urdf`, `ur5.srdf` and
`problems.tar.bz2`.
"""

import tarfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.kb.loader.reader import LoadFindings
from cellwright.kb.loader.urdf import urdf_arm
from cellwright.kb.model.body_shapes import Box, Cylinder, PlacedShape, Pose, Shape, Sphere
from cellwright.kb.model.cell_model import Body, BodyKind, Cell, MountedArm, Placement

KINDS = ("bookshelf_small", "bookshelf_tall", "box", "cage", "table_pick")


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """A cell, and the start and goal configurations (2, 6) of its motion planning problem."""

    name: str
    world: GeometricWorld
    ends: Floats


def tasks(folder: Path, numbers: range = range(1, 2)) -> list[Task]:
    """The cells of these numbers, of every kind."""
    arm = MountedArm(
        urdf_arm(folder / "ur5_spherized.urdf", folder / "ur5.srdf", None, [], LoadFindings())
    )
    wanted = {
        f"{kind}_ur5/{part}{n:04}.yaml"
        for kind in KINDS
        for part in ("scene", "request")
        for n in numbers
    }
    with tarfile.open(folder / "problems.tar.bz2") as archive:
        read = {
            member.name: yaml.load(archive.extractfile(member), Loader=yaml.CSafeLoader)  # type: ignore[arg-type]
            for member in archive
            if member.name in wanted
        }
    return [
        _task(
            f"{kind} {n}",
            arm,
            *(read[f"{kind}_ur5/{part}{n:04}.yaml"] for part in ("scene", "request")),
        )
        for kind in KINDS
        for n in numbers
    ]


def _task(name: str, arm: MountedArm, scene: dict[str, Any], request: dict[str, Any]) -> Task:
    bodies = [_body(each) for each in scene["world"]["collision_objects"]]
    links = ("base_link", "shoulder_link")
    touching = frozenset(frozenset((f"ur5.{link}", "ground")) for link in links)
    cell = Cell("ur5", {"ur5": arm}, bodies={body.name: body for body in bodies}, allowed=touching)
    joints = [joint.name for joint in arm.arm.joints]
    start = request["start_state"]["joint_state"]
    given = dict(zip(start["name"], start["position"], strict=True))
    goal = {
        each["joint_name"]: each["position"]
        for each in request["goal_constraints"][0]["joint_constraints"]
    }
    ends = np.array([[float(values[joint]) for joint in joints] for values in (given, goal)])
    return Task(name, GeometricWorld.of(cell), ends)


def _body(entry: dict[str, Any]) -> Body:
    shapes = [
        PlacedShape(_shape(primitive), _pose(pose))
        for primitive, pose in zip(entry["primitives"], entry["primitive_poses"], strict=True)
    ]
    return Body(entry["id"], BodyKind.FIXTURE, Placement(), tuple(shapes))


def _shape(primitive: dict[str, Any]) -> Shape:
    sizes = [float(size) for size in primitive["dimensions"]]
    match primitive["type"]:
        case "box":
            return Box((sizes[0], sizes[1], sizes[2]))
        case "cylinder":  # height, then radius
            return Cylinder(sizes[1], sizes[0])
        case "sphere":
            return Sphere(sizes[0])
    raise ValueError(f"no shape for {primitive['type']}")


def _pose(pose: dict[str, Any]) -> Pose:
    x, y, z, w = (float(each) for each in pose["orientation"])
    vector = np.array([x, y, z])
    length = float(np.linalg.norm(vector))
    axis = vector / length if length else np.array([0.0, 0.0, 1.0])
    R = transforms.rotation(axis, 2 * np.arctan2(length, w))
    return transforms.to_pose(transforms.transform(R, np.array(pose["position"], dtype=float)))
