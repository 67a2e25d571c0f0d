"""What the poses of a measurement depend on, as digests: they stay valid exactly as long as these do not change.

The first digest is of the arm, the tool and the place. The second is of every body that is near: whose box meets the box of
all that the arm and its tool touch in the poses that were looked at. What is outside of that box cannot have changed the answer.
"""

import hashlib
from collections.abc import Collection, Mapping
from dataclasses import fields, is_dataclass

import numpy as np

from engine.model.geometry import Floats
from engine.model.poses import Box
from engine.pipelines.moves.rooms import Room
from engine.stages.geometry import transforms
from engine.stages.geometry.kinematics.arms import carrier_poses
from engine.stages.geometry.shapes.parts import cores
from engine.stages.geometry.world.model import World
from kb.model.cell import Place
from kb.model.shapes import Mesh

MARGIN_M = 0.01  # a box is grown by this much: what is farther away cannot touch


def own_digest(world: World, place: Place, how: object) -> str:
    """The digest of the arm, its tool, the place as seen from the arm's base, and how the measurement is taken."""
    cell, arm = world.cell, world.cell.arms[place.arm]
    at = world.pose(f"{place.arm}.base", place.placement.parent) @ transforms.of_pose(place.placement.pose)
    base = world.pose("world", f"{place.arm}.base")
    tool = cell.bodies.get(place.tool)
    parts = (arm.arm, arm.tool, arm.home, tool and (tool.shapes, tool.features), _rounded(at), _rounded(base))
    return _digest((*parts, place.approach_m, place.turns, place.touches, how, cell.allowed))


class Standing:
    """The bodies of a world that no arm carries, with their boxes and digests."""

    def __init__(self, world: World) -> None:
        names = sorted(name for name in world.cell.bodies if not world.locate(name).carrier)
        boxes = {name: body_box(world, name) for name in names}
        self._boxes = {name: box for name, box in boxes.items() if box is not None}
        self._digests = {name: _of_body(world, name) for name in self._boxes}

    def near(self, box: Box) -> list[str]:
        """The bodies whose own box meets a box."""
        low, high = (np.array(each) for each in box)
        return [name for name, own in self._boxes.items() if (own[0] <= high).all() and (own[1] >= low).all()]

    def digest(self, box: Box | None) -> str:
        """The digest of the bodies that meet a box."""
        return "" if box is None else _digest(tuple((name, self._digests[name]) for name in self.near(box)))


def _of_body(world: World, name: str) -> str:
    body = world.cell.bodies[name]
    stamps = [_stamp(each.shape) for each in body.shapes if isinstance(each.shape, Mesh)]
    return _digest((body.shapes, stamps, _rounded(world.pose("world", name))))


def body_box(world: World, name: str) -> tuple[Floats, Floats] | None:
    """The least and greatest corner of a body along the axes of the world; None for a body without shapes."""
    T = world.pose("world", name)
    lows, highs = [], []
    for placed in world.cell.bodies[name].shapes:
        at = T @ transforms.of_pose(placed.pose)
        for core in cores(placed.shape):
            corners = transforms.apply(at, core.vertices)
            lows.append(corners.min(axis=0) - core.radius_m)
            highs.append(corners.max(axis=0) + core.radius_m)
    return (np.min(lows, axis=0), np.max(highs, axis=0)) if lows else None


def box_of(room: Room, place: Place, configurations: Collection[Floats]) -> Box | None:
    """The box of all that moves with the arm in some configurations (n, k), grown by the margin; None without any."""
    if not len(configurations):
        return None
    scene = room.checker(place).scene
    poses = carrier_poses(scene.joints, room.whole(place.arm, np.array(list(configurations))))
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for piece in scene.pieces:
        if piece.carrier == 0:
            continue
        T = poses[:, piece.carrier] @ piece.T_carrier_piece
        corners = np.einsum("nij,vj->nvi", T[:, :3, :3], piece.vertices) + T[:, None, :3, 3]
        low = np.minimum(low, corners.min(axis=(0, 1)) - piece.radius_m - MARGIN_M)
        high = np.maximum(high, corners.max(axis=(0, 1)) + piece.radius_m + MARGIN_M)
    a, b = (tuple(float(each) for each in corner) for corner in (low, high))
    return ((a[0], a[1], a[2]), (b[0], b[1], b[2]))


def _rounded(T: Floats) -> list[float]:
    return [round(float(each), 9) + 0.0 for each in T.ravel()]


def _stamp(mesh: Mesh) -> str:
    with open(mesh.path, "rb") as file:
        return hashlib.sha256(file.read()).hexdigest()


def _digest(parts: object) -> str:
    return hashlib.sha256(repr(_plain(parts)).encode()).hexdigest()[:32]


def _plain(value: object) -> object:
    """The same for values that are equal, in every process: sets and mappings are sorted, and what does not count is left out."""
    if is_dataclass(value) and not isinstance(value, type):
        own = [_plain(getattr(value, each.name)) for each in fields(value) if each.compare]
        return (type(value).__name__, *own)
    if isinstance(value, frozenset | set):
        return sorted((_plain(each) for each in value), key=repr)
    if isinstance(value, Mapping):
        return sorted(((str(key), _plain(each)) for key, each in value.items()), key=repr)
    if isinstance(value, tuple | list):
        return [_plain(each) for each in value]
    return value
