"""What the poses of a measurement depend on, as digests: they stay valid exactly as long as these do not change.

The first digest is of the arm, the tool and the place. The second is of every shape of a body that is near: whose box meets a box
of what the arm and its tool touch in the poses that the answer rests on. What is outside of these boxes cannot have changed the
answer. Shapes are asked one by one: a body such as the ribs of a part is everywhere, and one of its ribs is not.
"""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass

import numpy as np

from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.poses import Box
from cellwright.engine.pipelines.moves.rooms import Room
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.kinematics.arms import carrier_poses
from cellwright.engine.stages.geometry.reach.seeing import View
from cellwright.engine.stages.geometry.shapes.parts import cores
from cellwright.engine.stages.geometry.world.model import World
from cellwright.kb.model.cell import Place
from cellwright.kb.model.shapes import Mesh, PlacedShape

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
    """The shapes of the bodies of a world that no arm carries, with their boxes and digests."""

    def __init__(self, world: World) -> None:
        names = sorted(name for name in world.cell.bodies if not world.locate(name).carrier)
        shapes = [(name, placed) for name in names for placed in world.cell.bodies[name].shapes]
        self._digests = [_of_shape(world, name, placed) for name, placed in shapes]
        self._boxes = np.array([_box_of_shape(world, name, placed) for name, placed in shapes])

    def digest(self, boxes: Sequence[Box]) -> str:
        """The digest of the shapes whose own box meets one of some boxes."""
        if not boxes:
            return ""
        return _digest(sorted(self._digests[n] for n in self._near(boxes)))

    def _near(self, boxes: Sequence[Box]) -> Iterable[int]:
        if not len(self._boxes):
            return ()
        low, high = np.swapaxes(np.array(boxes), 0, 1)[:, None]
        own_low, own_high = np.swapaxes(self._boxes, 0, 1)[:, :, None]
        return np.flatnonzero(((own_low <= high) & (own_high >= low)).all(axis=2).any(axis=1)).tolist()


def _of_shape(world: World, body: str, placed: PlacedShape) -> str:
    stamp = _stamp(placed.shape) if isinstance(placed.shape, Mesh) else ""
    return _digest((body, placed, stamp, _rounded(world.pose("world", body))))


def _box_of_shape(world: World, body: str, placed: PlacedShape) -> tuple[Floats, Floats]:
    """The least and greatest corner of a shape of a body along the axes of the world."""
    at = world.pose("world", body) @ transforms.of_pose(placed.pose)
    corners = [(transforms.apply(at, core.vertices), core.radius_m) for core in cores(placed.shape)]
    lows = [each.min(axis=0) - radius for each, radius in corners]
    highs = [each.max(axis=0) + radius for each, radius in corners]
    return np.min(lows, axis=0), np.max(highs, axis=0)


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
