"""A scene and its motion as glTF 2.0 (Khronos): one file that holds its numbers, too.

Each joint is a node that turns or slides within a node for its origin. So viewers interpolate configurations,
not poses. Up is the z axis here and the y axis in glTF, so the root node turns one to the other.
"""

import base64
import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cellwright.engine.model.geometry import Floats, Joints
from cellwright.engine.stages.geometry.pictures.surfaces import Colour, Surface

FLOAT, UNSIGNED = 5126, 5125  # component types
VERTICES, INDICES = 34962, 34963  # buffer view targets
STEP_RAD = math.pi / 2  # viewers interpolate rotations the short way round, so steps stay below half a turn


@dataclass
class _Document:
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
        """The number of a new accessor of an array (n,) or (n, 3 or 4) of floats or unsigned integers."""
        whole = np.issubdtype(values.dtype, np.integer)
        stored = np.ascontiguousarray(values, dtype="<u4" if whole else "<f4")
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": stored.nbytes}
        self.data += stored.tobytes()
        number = self.add("bufferViews", view | ({"target": target} if target else {}))
        rows = stored.reshape(len(stored), -1)
        limits = {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        kind = {"bufferView": number, "componentType": UNSIGNED if whole else FLOAT, "count": len(stored)}
        return self.add("accessors", {**kind, "type": shape, **limits})

    def material(self, colour: Colour) -> int:
        """The number of a new material with a colour."""
        if colour not in self.materials:
            look = {"baseColorFactor": [*colour, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.8}
            self.materials[colour] = self.add(
                "materials", {"pbrMetallicRoughness": look, "doubleSided": True}
            )
        return self.materials[colour]

    def text(self, root: int) -> str:
        """The text of the whole file."""
        uri = "data:application/octet-stream;base64," + base64.b64encode(bytes(self.data)).decode("ascii")
        head = {
            "asset": {"version": "2.0", "generator": "cellwright"},
            "scene": 0,
            "scenes": [{"nodes": [root]}],
        }
        buffers = [{"byteLength": len(self.data), "uri": uri}] if self.data else []
        return json.dumps({**head, **self.content, **({"buffers": buffers} if buffers else {})}) + "\n"


def document(shown: Sequence[Surface], joints: Joints, times_s: Floats, configurations: Floats) -> str:
    """The glTF text of surfaces on their carriers.

    The joints start at the first of the configurations (n, k) and pass through all. With only one
    configuration nothing moves.
    """
    made = _Document()
    turned = [-math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]
    root = made.add("nodes", {"name": "cell", "rotation": turned, "children": []})
    carriers = [root]
    for index in range(joints.count):
        carriers.append(_joint(made, joints, index, carriers[joints.parent[index]], configurations[0, index]))
    for surface in shown:
        _child(made, carriers[surface.carrier], {"name": surface.body, "mesh": _mesh(made, surface)})
    if len(times_s) > 1 and joints.count:
        _animate(made, joints, carriers, *_refined(joints, times_s, configurations))
    for node in made.content["nodes"]:
        if not node.get("children", True):
            del node["children"]  # an empty list is not allowed
    return made.text(root)


def film(shown: Sequence[Surface], names: Sequence[str], times_s: Floats, poses: Floats) -> str:
    """The glTF text of surfaces whose carriers are at poses (m, n, 4, 4) at times (m,). `names` are those of the carriers.

    A carrier that never moves is not animated.
    """
    made = _Document()
    turned = [-math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]
    root = made.add("nodes", {"name": names[0], "rotation": turned, "children": []})
    nodes = [
        _child(made, root, {"name": name, **_placed(poses[0, n]), "children": []})
        for n, name in enumerate(names)
    ]
    for surface in shown:
        _child(made, nodes[surface.carrier], {"name": surface.body, "mesh": _mesh(made, surface)})
    clock, channels, samplers = made.numbers(times_s, "SCALAR"), list[Any](), list[Any]()
    for n, node in enumerate(nodes):
        for path, values, shape in _tracks(poses[:, n]):
            sampler = {"input": clock, "output": made.numbers(values, shape), "interpolation": "LINEAR"}
            channels.append({"sampler": len(samplers), "target": {"node": node, "path": path}})
            samplers.append(sampler)
    if channels:
        made.add("animations", {"name": "film", "channels": channels, "samplers": samplers})
    for node_ in made.content["nodes"]:
        if not node_.get("children", True):
            del node_["children"]  # an empty list is not allowed
    return made.text(root)


def _placed(T: Floats) -> dict[str, Any]:
    return {"translation": T[:3, 3].tolist(), "rotation": quaternion(T[:3, :3]).tolist()}


def _tracks(poses: Floats) -> Iterator[tuple[str, Floats, str]]:
    """What changes along poses (m, 4, 4): path, values and shape."""
    places = poses[:, :3, 3]
    if np.ptp(places, axis=0).max() > 1e-9:
        yield "translation", places, "VEC3"
    if np.ptp(poses[:, :3, :3], axis=0).max() > 1e-9:
        turns = np.stack([quaternion(T[:3, :3]) for T in poses])
        for n in range(1, len(turns)):  # the short way round: a quaternion and its opposite are one rotation
            turns[n] *= 1.0 if turns[n] @ turns[n - 1] >= 0 else -1.0
        yield "rotation", turns, "VEC4"


def _child(made: _Document, parent: int, node: dict[str, Any]) -> int:
    number = made.add("nodes", node)
    made.content["nodes"][parent]["children"].append(number)
    return number


def _joint(made: _Document, joints: Joints, index: int, parent: int, value: float) -> int:
    T = joints.T_parent_origin[index]
    place = {"translation": T[:3, 3].tolist(), "rotation": quaternion(T[:3, :3]).tolist()}
    origin = _child(made, parent, {"name": f"joint {index + 1}", **place, "children": []})
    moved = {_path(joints, index): _motion(joints, index, np.array([value]))[0].tolist()}
    return _child(made, origin, {"name": f"carrier {index + 1}", **moved, "children": []})


def _path(joints: Joints, index: int) -> str:
    return "translation" if joints.prismatic[index] else "rotation"


def _motion(joints: Joints, index: int, values: Floats) -> Floats:
    """The motion of one joint: translations (n, 3) or quaternions (n, 4; x, y, z, w)."""
    half = values[:, None] / 2
    turns: Floats = np.concatenate([np.sin(half) * joints.axis[index], np.cos(half)], axis=1)
    slides: Floats = values[:, None] * joints.axis[index]
    return slides if joints.prismatic[index] else turns


def _refined(joints: Joints, times_s: Floats, configurations: Floats) -> tuple[Floats, Floats]:
    """Times (m,) and configurations (m, k): the given ones, with others between so that no joint turns too
    far in one step.
    """
    steps = np.abs(np.diff(configurations[:, ~joints.prismatic], axis=0))
    parts = np.maximum(1, np.ceil(steps.max(axis=1, initial=0.0) / STEP_RAD).astype(int))
    marks = np.concatenate([n + np.arange(count) / count for n, count in enumerate(parts)] + [[len(parts)]])
    given = np.arange(len(times_s))
    columns = [np.interp(marks, given, configurations[:, k]) for k in range(joints.count)]
    return np.interp(marks, given, times_s), np.stack(columns, axis=1)


def _animate(
    made: _Document, joints: Joints, carriers: list[int], times_s: Floats, configurations: Floats
) -> None:
    clock = made.numbers(times_s, "SCALAR")
    channels, samplers = [], []
    for index in range(joints.count):
        path = _path(joints, index)
        values = made.numbers(
            _motion(joints, index, configurations[:, index]), "VEC4" if path == "rotation" else "VEC3"
        )
        samplers.append({"input": clock, "output": values, "interpolation": "LINEAR"})
        channels.append({"sampler": index, "target": {"node": carriers[index + 1], "path": path}})
    made.add("animations", {"name": "motion", "channels": channels, "samplers": samplers})


def _mesh(made: _Document, surface: Surface) -> int:
    positions = made.numbers(surface.vertices, "VEC3", VERTICES)
    corners = made.numbers(surface.triangles.reshape(-1), "SCALAR", INDICES)
    look = made.material(surface.colour)
    primitive = {"attributes": {"POSITION": positions}, "indices": corners, "material": look}
    return made.add("meshes", {"name": surface.body, "primitives": [primitive]})


def quaternion(R: Floats) -> Floats:
    """The unit quaternion (x, y, z, w) of a rotation (3, 3), by its largest part (Shepperd 1978)."""
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
    found: Floats = rows[int(np.argmax(np.diagonal(rows)))]
    return found / np.linalg.norm(found)
