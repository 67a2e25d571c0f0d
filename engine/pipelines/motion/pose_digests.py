"""Digests of what the poses of a measurement depend on: equal digests keep them valid.

The first digest is of the arm, the tool and the place. The second is of every shape of a body that
is near: whose box meets a box of what the arm and its tool touch in the poses that the answer rests
on. What is outside of these boxes cannot have changed the answer. Shapes are asked one by one: a
body such as the ribs of a part is everywhere, and one of its ribs is not.
"""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.arm_poses import Box
from cellwright.engine.pipelines.motion.cell_state import CellState
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.kinematics.arm_model import carrier_poses
from cellwright.engine.stages.geometry.reach.scanner_view import PatchView
from cellwright.engine.stages.geometry.shapes.part_shapes import shape_cores
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.kb.model.body_shapes import Mesh, PlacedShape
from cellwright.kb.model.cell_model import Place

DIGEST_MARGIN_M = 0.01  # a box is grown by this much: what is farther away cannot touch


class ArmFooting:
    """An arm at a station with a tool: what all its measurements depend on, as a digest."""

    def __init__(self, world: GeometricWorld, arm: str, tool: str) -> None:
        cell, mounted = world.cell, world.cell.arms[arm]
        body = cell.bodies.get(tool)
        self._T_base_world = world.pose(f"{arm}.base", "world")
        self._world = world
        parts = (mounted.arm, mounted.tool, mounted.home, body and (body.shapes, body.features))
        self._same = _digest_of(
            (*parts, _rounded_pose(transforms.inverse(self._T_base_world)), cell.allowed)
        )

    def digest(self, place: Place, how: object) -> str:
        """The digest of all that, of the place as seen from the arm's base, and of how the
        measurement is taken.
        """
        at = self._T_base_world @ self._world.pose("world", place.placement.parent)
        at = at @ transforms.of_pose(place.placement.pose)
        allowed = (place.touches, place.depth_m, place.patch_m)
        return _digest_of(
            (self._same, _rounded_pose(at), place.approach_m, place.turns, *allowed, how)
        )


class StandingBodies:
    """The shapes of the bodies of a world that no arm carries, with their boxes and digests."""

    def __init__(self, world: GeometricWorld) -> None:
        names = sorted(name for name in world.cell.bodies if not world.locate(name).carrier)
        shapes = [(name, placed) for name in names for placed in world.cell.bodies[name].shapes]
        self._digests = [_of_shape(world, name, placed) for name, placed in shapes]
        self._boxes = np.array([_box_of_shape(world, name, placed) for name, placed in shapes])

    def digest(self, boxes: Sequence[Box]) -> str:
        """The digest of the shapes whose own box meets one of some boxes."""
        if not boxes:
            return ""
        return _digest_of(sorted(self._digests[n] for n in self._near(boxes)))

    def _near(self, boxes: Sequence[Box]) -> Iterable[int]:
        if not len(self._boxes):
            return ()
        low, high = np.swapaxes(np.array(boxes), 0, 1)[:, None]
        own_low, own_high = np.swapaxes(self._boxes, 0, 1)[:, :, None]
        return np.flatnonzero(
            ((own_low <= high) & (own_high >= low)).all(axis=2).any(axis=1)
        ).tolist()


def _of_shape(world: GeometricWorld, body: str, placed: PlacedShape) -> str:
    stamp = _mesh_stamp(placed.shape) if isinstance(placed.shape, Mesh) else ""
    return _digest_of((body, placed, stamp, _rounded_pose(world.pose("world", body))))


def _box_of_shape(world: GeometricWorld, body: str, placed: PlacedShape) -> tuple[Floats, Floats]:
    """The least and greatest corner of a shape of a body along the axes of the world."""
    at = world.pose("world", body) @ transforms.of_pose(placed.pose)
    corners = [
        (transforms.apply(at, core.vertices), core.radius_m) for core in shape_cores(placed.shape)
    ]
    lows = [shape_corners.min(axis=0) - radius for shape_corners, radius in corners]
    highs = [shape_corners.max(axis=0) + radius for shape_corners, radius in corners]
    return np.min(lows, axis=0), np.max(highs, axis=0)


def boxes_of(room: CellState, place: Place, configurations: Sequence[Floats]) -> tuple[Box, ...]:
    """For each carrier of the arm the box of all that moves with it in some configurations
    (k,), grown by the margin.
    """
    if not configurations:
        return ()
    scene = room.checker(place).scene
    poses = carrier_poses(scene.joints, room.whole(place.arm, np.array(configurations)))
    boxes: dict[int, tuple[Floats, Floats]] = {}
    for piece in scene.pieces:
        if piece.carrier == 0:
            continue
        middle = piece.vertices.mean(axis=0)
        grown = (
            float(np.linalg.norm(piece.vertices - middle, axis=1).max())
            + piece.radius_m
            + DIGEST_MARGIN_M
        )
        at = transforms.apply(piece.T_carrier_piece, middle[None])[0]
        centres = poses[:, piece.carrier, :3, :3] @ at + poses[:, piece.carrier, :3, 3]
        low, high = centres.min(axis=0) - grown, centres.max(axis=0) + grown
        if piece.carrier in boxes:
            low, high = (
                np.minimum(low, boxes[piece.carrier][0]),
                np.maximum(high, boxes[piece.carrier][1]),
            )
        boxes[piece.carrier] = low, high
    return tuple(
        (_rounded_corner(low), _rounded_corner(high)) for _, (low, high) in sorted(boxes.items())
    )


def box_of(views: Sequence[PatchView]) -> tuple[Box, ...]:
    """The box of all that a scanner looks through, grown by the margin; empty if it looks
    through nothing.
    """
    if not views:
        return ()
    low, high = np.swapaxes(np.array([view.box() for view in views]), 0, 1)
    return (
        (
            _rounded_corner(low.min(axis=0) - DIGEST_MARGIN_M),
            _rounded_corner(high.max(axis=0) + DIGEST_MARGIN_M),
        ),
    )


def _rounded_corner(point: Floats) -> tuple[float, float, float]:
    x, y, z = (round(float(coordinate), 6) for coordinate in point)
    return (x, y, z)


def _rounded_pose(T: Floats) -> list[float]:
    return [round(float(number), 9) + 0.0 for number in T.ravel()]


def _mesh_stamp(mesh: Mesh) -> str:
    with open(mesh.path, "rb") as file:
        return hashlib.sha256(file.read()).hexdigest()


def _digest_of(parts: object) -> str:
    return hashlib.sha256(repr(_plain_value(parts)).encode()).hexdigest()[:32]


def _plain_value(value: object) -> object:
    """The same for values that are equal, in every process: sets and mappings are sorted, and
    what does not count is left out.
    """
    if is_dataclass(value) and not isinstance(value, type):
        own = [_plain_value(getattr(value, field.name)) for field in fields(value) if field.compare]
        return (type(value).__name__, *own)
    if isinstance(value, frozenset | set):
        return sorted((_plain_value(item) for item in value), key=repr)
    if isinstance(value, Mapping):
        return sorted(((str(key), _plain_value(item)) for key, item in value.items()), key=repr)
    if isinstance(value, tuple | list):
        return [_plain_value(item) for item in value]
    return value
