"""Files for 3D viewers: a scene with its motion as glTF 2.0, and bodies as binary STL.

Each joint is a node that turns or slides within a node for its origin. So viewers interpolate
configurations, not poses. Up is the z axis here and the y axis in glTF, so the root node turns one
to the other.
"""

import base64
import json
import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.linear import matmul
from cellwright.engine.model.geometry import Joints
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.kinematics.arm_model import carrier_poses
from cellwright.engine.stages.geometry.pictures.picture_surfaces import (
    Colour,
    PictureSurface,
    mesh_of,
)
from cellwright.engine.stages.geometry.world.collision_scene import collision_scene_of
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld, LocatedFrame

FLOAT, UNSIGNED = 5126, 5125  # component types
VERTICES, INDICES = 34962, 34963  # buffer view targets
MAX_STEP_RAD = (
    math.pi / 2
)  # viewers interpolate rotations the short way round, so steps stay below half a turn


@dataclass
class _GltfDocument:
    """A document that is being written."""

    content: dict[str, list[Any]] = field(default_factory=dict)
    data: bytearray = field(default_factory=bytearray)
    materials: dict[Colour, int] = field(default_factory=dict)

    def add(self, kind: str, entry: dict[str, Any]) -> int:
        """Adds an entry to a list of the document. Returns its number."""
        entries = self.content.setdefault(kind, [])
        entries.append(entry)
        return len(entries) - 1

    def numbers(self, values: NDArray[Any], shape: str, target: int | None = None) -> int:
        """The number of a new accessor of an array (n,) or (n, 3 or 4) of floats or unsigned
        integers.
        """
        whole = np.issubdtype(values.dtype, np.integer)
        stored = np.ascontiguousarray(values, dtype="<u4" if whole else "<f4")
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": stored.nbytes}
        self.data += stored.tobytes()
        number = self.add("bufferViews", view | ({"target": target} if target else {}))
        rows = stored.reshape(len(stored), -1)
        limits = {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        kind = {
            "bufferView": number,
            "componentType": UNSIGNED if whole else FLOAT,
            "count": len(stored),
        }
        return self.add("accessors", {**kind, "type": shape, **limits})

    def material(self, colour: Colour) -> int:
        """The number of a new material with a colour."""
        if colour not in self.materials:
            look = {
                "baseColorFactor": [*colour, 1.0],
                "metallicFactor": 0.0,
                "roughnessFactor": 0.8,
            }
            self.materials[colour] = self.add(
                "materials", {"pbrMetallicRoughness": look, "doubleSided": True}
            )
        return self.materials[colour]

    def text(self, root: int) -> str:
        """The text of the whole file."""
        uri = "data:application/octet-stream;base64," + base64.b64encode(bytes(self.data)).decode(
            "ascii"
        )
        head = {
            "asset": {"version": "2.0", "generator": "cellwright"},
            "scene": 0,
            "scenes": [{"nodes": [root]}],
        }
        buffers = [{"byteLength": len(self.data), "uri": uri}] if self.data else []
        return (
            json.dumps({**head, **self.content, **({"buffers": buffers} if buffers else {})}) + "\n"
        )


def gltf_of_motion(
    shown: Sequence[PictureSurface], joints: Joints, times_s: Floats, configurations: Floats
) -> str:
    """The glTF text of surfaces on their carriers.

    The joints start at the first of the configurations (n, k) and pass through all. With only one
    configuration nothing moves.
    """
    gltf = _GltfDocument()
    turned = [-math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]
    root = gltf.add("nodes", {"name": "cell", "rotation": turned, "children": []})
    carriers = [root]
    for index in range(joints.count):
        carriers.append(
            _add_joint(
                gltf, joints, index, carriers[joints.parent[index]], configurations[0, index]
            )
        )
    for surface in shown:
        _add_child(
            gltf,
            carriers[surface.carrier],
            {"name": surface.body, "mesh": _add_mesh(gltf, surface)},
        )
    if len(times_s) > 1 and joints.count:
        _animate_joints(gltf, joints, carriers, *_refine_steps(joints, times_s, configurations))
    for node in gltf.content["nodes"]:
        if not node.get("children", True):
            del node["children"]  # an empty list is not allowed
    return gltf.text(root)


def gltf_of_poses(
    shown: Sequence[PictureSurface], names: Sequence[str], times_s: Floats, poses: Floats
) -> str:
    """The glTF text of surfaces whose carriers are at poses (m, n, 4, 4) at times (m,). `names` are
    those of the carriers.

    A carrier that never moves is not animated.
    """
    gltf = _GltfDocument()
    turned = [-math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]
    root = gltf.add("nodes", {"name": names[0], "rotation": turned, "children": []})
    nodes = [
        _add_child(gltf, root, {"name": name, **_node_pose(poses[0, n]), "children": []})
        for n, name in enumerate(names)
    ]
    for surface in shown:
        _add_child(
            gltf, nodes[surface.carrier], {"name": surface.body, "mesh": _add_mesh(gltf, surface)}
        )
    clock, channels, samplers = gltf.numbers(times_s, "SCALAR"), list[Any](), list[Any]()
    for n, node in enumerate(nodes):
        for path, values, shape in _pose_tracks(poses[:, n]):
            sampler = {
                "input": clock,
                "output": gltf.numbers(values, shape),
                "interpolation": "LINEAR",
            }
            channels.append({"sampler": len(samplers), "target": {"node": node, "path": path}})
            samplers.append(sampler)
    if channels:
        gltf.add("animations", {"name": "film", "channels": channels, "samplers": samplers})
    for node_ in gltf.content["nodes"]:
        if not node_.get("children", True):
            del node_["children"]  # an empty list is not allowed
    return gltf.text(root)


def _node_pose(T: Floats) -> dict[str, Any]:
    return {"translation": T[:3, 3].tolist(), "rotation": quaternion_xyzw(T[:3, :3]).tolist()}


def _pose_tracks(poses: Floats) -> Iterator[tuple[str, Floats, str]]:
    """What changes along poses (m, 4, 4): path, values and shape."""
    places = poses[:, :3, 3]
    if np.ptp(places, axis=0).max() > 1e-9:
        yield "translation", places, "VEC3"
    if np.ptp(poses[:, :3, :3], axis=0).max() > 1e-9:
        turns = np.stack([quaternion_xyzw(T[:3, :3]) for T in poses])
        # the short way round: a quaternion and its opposite are one rotation
        for n in range(1, len(turns)):
            turns[n] *= 1.0 if turns[n] @ turns[n - 1] >= 0 else -1.0
        yield "rotation", turns, "VEC4"


def _add_child(gltf: _GltfDocument, parent: int, node: dict[str, Any]) -> int:
    number = gltf.add("nodes", node)
    gltf.content["nodes"][parent]["children"].append(number)
    return number


def _add_joint(gltf: _GltfDocument, joints: Joints, index: int, parent: int, value: float) -> int:
    T = joints.T_parent_origin[index]
    place = {"translation": T[:3, 3].tolist(), "rotation": quaternion_xyzw(T[:3, :3]).tolist()}
    origin = _add_child(gltf, parent, {"name": f"joint {index + 1}", **place, "children": []})
    moved = {
        _animated_path(joints, index): _joint_motion(joints, index, np.array([value]))[0].tolist()
    }
    return _add_child(gltf, origin, {"name": f"carrier {index + 1}", **moved, "children": []})


def _animated_path(joints: Joints, index: int) -> str:
    return "translation" if joints.prismatic[index] else "rotation"


def _joint_motion(joints: Joints, index: int, values: Floats) -> Floats:
    """The motion of one joint: translations (n, 3) or quaternions (n, 4; x, y, z, w)."""
    half = values[:, None] / 2
    turns: Floats = np.concatenate([np.sin(half) * joints.axis[index], np.cos(half)], axis=1)
    slides: Floats = values[:, None] * joints.axis[index]
    return slides if joints.prismatic[index] else turns


def _refine_steps(joints: Joints, times_s: Floats, configurations: Floats) -> tuple[Floats, Floats]:
    """Times (m,) and configurations (m, k): the given ones, with others between so that no joint
    turns too far in one step.
    """
    steps = np.abs(np.diff(configurations[:, ~joints.prismatic], axis=0))
    parts = np.maximum(1, np.ceil(steps.max(axis=1, initial=0.0) / MAX_STEP_RAD).astype(int))
    marks = np.concatenate(
        [n + np.arange(count) / count for n, count in enumerate(parts)] + [[len(parts)]]
    )
    given_steps = np.arange(len(times_s))
    columns = [np.interp(marks, given_steps, configurations[:, k]) for k in range(joints.count)]
    return np.interp(marks, given_steps, times_s), np.stack(columns, axis=1)


def _animate_joints(
    gltf: _GltfDocument,
    joints: Joints,
    carriers: list[int],
    times_s: Floats,
    configurations: Floats,
) -> None:
    clock = gltf.numbers(times_s, "SCALAR")
    channels, samplers = [], []
    for index in range(joints.count):
        path = _animated_path(joints, index)
        values = gltf.numbers(
            _joint_motion(joints, index, configurations[:, index]),
            "VEC4" if path == "rotation" else "VEC3",
        )
        samplers.append({"input": clock, "output": values, "interpolation": "LINEAR"})
        channels.append({"sampler": index, "target": {"node": carriers[index + 1], "path": path}})
    gltf.add("animations", {"name": "motion", "channels": channels, "samplers": samplers})


def _add_mesh(gltf: _GltfDocument, surface: PictureSurface) -> int:
    positions = gltf.numbers(surface.vertices, "VEC3", VERTICES)
    corners = gltf.numbers(surface.triangles.reshape(-1), "SCALAR", INDICES)
    look = gltf.material(surface.colour)
    primitive = {"attributes": {"POSITION": positions}, "indices": corners, "material": look}
    return gltf.add("meshes", {"name": surface.body, "primitives": [primitive]})


def quaternion_xyzw(R: Floats) -> Floats:
    """The unit quaternion (x, y, z, w) of a rotation (3, 3), by its largest part (Shepperd
    1978).
    """
    x, y = 1 + R[0, 0] - R[1, 1] - R[2, 2], 1 - R[0, 0] + R[1, 1] - R[2, 2]
    z, w = 1 - R[0, 0] - R[1, 1] + R[2, 2], 1 + R[0, 0] + R[1, 1] + R[2, 2]
    rows = np.array(
        [
            [x, R[0, 1] + R[1, 0], R[0, 2] + R[2, 0], R[2, 1] - R[1, 2]],
            [R[0, 1] + R[1, 0], y, R[1, 2] + R[2, 1], R[0, 2] - R[2, 0]],
            [R[0, 2] + R[2, 0], R[1, 2] + R[2, 1], z, R[1, 0] - R[0, 1]],
            [R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], w],
        ]
    )
    largest: Floats = rows[int(np.argmax(np.diagonal(rows)))]
    return largest / np.linalg.norm(largest)


STL_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
FIXED_TO_WORLD = LocatedFrame(0, np.eye(4))  # regions stand still, and have no frame of their own


def frames_of_bodies(world: GeometricWorld, names: Iterable[str]) -> dict[str, LocatedFrame]:
    """The frames of links (`arm.link`), bodies and solid regions, by their names in a scene."""
    links = {
        f"{name}.{link.name}": world.locate_link(name, link)
        for name, mounted in world.cell.arms.items()
        for link in mounted.arm.links
    }
    bodies = world.cell.bodies
    return {
        name: world.locate(name) if name in bodies else links.get(name, FIXED_TO_WORLD)
        for name in names
    }


def body_poses(world: GeometricWorld, names: Iterable[str]) -> dict[str, Floats]:
    """T_world_body (4, 4) of links, bodies and solid regions, by their names in a scene."""
    carriers = carrier_poses(world.joints, world.configuration)
    return {
        name: matmul(carriers[at.carrier], at.T_carrier_frame)
        for name, at in frames_of_bodies(world, names).items()
    }


def body_triangles(world: GeometricWorld) -> dict[str, Floats]:
    """The corners (n, 3, 3) of the triangles of everything that has a surface, each in its own
    frame.
    """
    pieces, by_body = collision_scene_of(world).pieces, defaultdict(list)
    frames = frames_of_bodies(world, {piece.body: None for piece in pieces})
    for piece in pieces:
        vertices, triangles = mesh_of(piece)
        own = transforms.apply(transforms.inverse(frames[piece.body].T_carrier_frame), vertices)
        by_body[piece.body].append(own[triangles])
    return {name: np.concatenate(parts) for name, parts in by_body.items()}


def stl_of_triangles(triangles: Floats) -> bytes:
    """Triangles (n, 3, 3) as binary STL."""
    across = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    length = np.linalg.norm(across, axis=1, keepdims=True)
    rows = np.zeros(len(triangles), dtype=STL_TRIANGLE)
    rows["normal"], rows["corners"] = across / np.maximum(length, 1e-30), triangles
    return bytes(80) + np.uint32(len(rows)).tobytes() + rows.tobytes()
