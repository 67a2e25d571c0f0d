"""What the poses of a measurement depend on, as digests: they stay valid exactly as long as these do not change.

The first digest is of the arm, the tool and the place. The second is of every body that is near: whose box meets a box of what
the arm and its tool touch in the poses that the answer rests on. What is outside of these boxes cannot have changed the answer.
"""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass

import numpy as np

from engine.model.geometry import Floats
from engine.model.poses import Box
from engine.pipelines.moves.rooms import Room
from engine.stages.geometry import transforms
from engine.stages.geometry.kinematics.arms import carrier_poses
from engine.stages.geometry.reach.seeing import View
from engine.stages.geometry.shapes.parts import cores
from engine.stages.geometry.world.model import World
from kb.model.cell import Place
from kb.model.shapes import Mesh

MARGIN_M = 0.01  # a box is grown by this much: what is farther away cannot touch


class Footing:
    """An arm at a station with a tool: what all its measurements depend on, as a digest."""

    def __init__(self, world: World, arm: str, tool: str) -> None:
        cell, mounted = world.cell, world.cell.arms[arm]
        body = cell.bodies.get(tool)
        self._T_base_world = world.pose(f"{arm}.base", "world")
        self._world = world
        parts = (mounted.arm, mounted.tool, mounted.home, body and (body.shapes, body.features))
        self._same = _digest((*parts, _rounded(transforms.inverse(self._T_base_world)), cell.allowed))

    def digest(self, place: Place, how: object) -> str:
        """The digest of all that, of the place as seen from the arm's base, and of how the measurement is taken."""
        at = self._T_base_world @ self._world.pose("world", place.placement.parent)
        at = at @ transforms.of_pose(place.placement.pose)
        allowed = (place.touches, place.depth_m, place.patch_m)
        return _digest((self._same, _rounded(at), place.approach_m, place.turns, *allowed, how))


class Standing:
    """The bodies of a world that no arm carries, with their boxes and digests."""

    def __init__(self, world: World) -> None:
        names = sorted(name for name in world.cell.bodies if not world.locate(name).carrier)
        boxes = {name: body_box(world, name) for name in names}
        self._boxes = {name: box for name, box in boxes.items() if box is not None}
        self._digests = {name: _of_body(world, name) for name in self._boxes}

    def near(self, boxes: Sequence[Box]) -> list[str]:
        """The bodies whose own box meets one of some boxes."""
        if not len(boxes) or not self._boxes:
            return []
        low, high = np.swapaxes(np.array(boxes), 0, 1)[:, None]
        own_low, own_high = np.swapaxes(np.array(list(self._boxes.values())), 0, 1)[:, :, None]
        meets = ((own_low <= high) & (own_high >= low)).all(axis=2).any(axis=1)
        return [name for name, met in zip(self._boxes, meets, strict=True) if met]

    def digest(self, boxes: Sequence[Box]) -> str:
        """The digest of the bodies that meet one of some boxes."""
        return _digest(tuple((name, self._digests[name]) for name in self.near(boxes))) if boxes else ""


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


def boxes_of(room: Room, place: Place, configurations: Sequence[Floats]) -> tuple[Box, ...]:
    """For each carrier of the arm the box of all that moves with it in some configurations (k,), grown by the margin."""
    if not configurations:
        return ()
    scene = room.checker(place).scene
    poses = carrier_poses(scene.joints, room.whole(place.arm, np.array(configurations)))
    boxes: dict[int, tuple[Floats, Floats]] = {}
    for piece in scene.pieces:
        if piece.carrier == 0:
            continue
        middle = piece.vertices.mean(axis=0)
        grown = float(np.linalg.norm(piece.vertices - middle, axis=1).max()) + piece.radius_m + MARGIN_M
        at = transforms.apply(piece.T_carrier_piece, middle[None])[0]
        centres = poses[:, piece.carrier, :3, :3] @ at + poses[:, piece.carrier, :3, 3]
        low, high = centres.min(axis=0) - grown, centres.max(axis=0) + grown
        if piece.carrier in boxes:
            low, high = np.minimum(low, boxes[piece.carrier][0]), np.maximum(high, boxes[piece.carrier][1])
        boxes[piece.carrier] = low, high
    return tuple((_corner(low), _corner(high)) for _, (low, high) in sorted(boxes.items()))


def box_of(views: Sequence[View]) -> tuple[Box, ...]:
    """The box of all that a scanner looks through, grown by the margin; empty if it looks through nothing."""
    if not views:
        return ()
    low, high = np.swapaxes(np.array([view.box() for view in views]), 0, 1)
    return ((_corner(low.min(axis=0) - MARGIN_M), _corner(high.max(axis=0) + MARGIN_M)),)


def _corner(point: Floats) -> tuple[float, float, float]:
    x, y, z = (round(float(each), 6) for each in point)
    return (x, y, z)


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
