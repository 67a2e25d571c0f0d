"""Bodies that are seen while a run goes on, as replies and records have them: `{"crate": {"at": [...], "rpy": [...], "box": [...]}}`.

`at` (m) and `rpy` (degrees) say where a body is in the world: its own frame if the cell knows it, else the middle of a box around it,
whose sides are `box` (m).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import degrees, radians
from typing import Any

import numpy as np

from cellwright.engine.kernels.linear import matmul
from cellwright.engine.model.execution import SEEN
from cellwright.engine.model.geometry import Floats
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.shapes.parts import cores
from cellwright.engine.stages.geometry.world.model import World
from cellwright.kb.model.cell import Body, BodyKind, Cell, Placement
from cellwright.kb.model.shapes import Box, PlacedShape, Pose
from cellwright.kb.numbers import is_number

FARTHEST_M = 1e3
ROOM_M = 0.01  # kept from what was seen: neither the look nor the arm is exact


@dataclass(frozen=True, slots=True)
class Seen:
    """A body where it was seen in the world, and the sides of a box around it (m); no box for one that the cell knows."""

    name: str
    pose: Pose
    box_m: tuple[float, float, float] | None = None

    @property
    def T_world(self) -> Floats:
        """Where its frame is (4, 4)."""
        return transforms.of_pose(self.pose)

    def entry(self) -> dict[str, list[float]]:
        """The same as plain JSON."""
        found = {"at": list(self.pose.position_m), "rpy": [degrees(each) for each in self.pose.rpy_rad]}
        return found if self.box_m is None else {**found, "box": list(self.box_m)}


def look_at(world: World, name: str, boxed: bool) -> Seen:
    """What a look at a body tells: where it is; `boxed`, the middle and the sides of the box around it."""
    T = world.pose("world", name)
    if not boxed:
        return Seen(name, transforms.to_pose(T))
    low, high = _extent(world.cell.bodies[name])
    middle = transforms.translation(*((low + high) / 2))
    x, y, z = (float(each) for each in high - low)
    return Seen(name, transforms.to_pose(matmul(T, middle)), (x, y, z))


def _extent(body: Body) -> tuple[Floats, Floats]:
    """The lower and upper corner (3,) of the box around a body, in its own frame."""
    parts = [
        (matmul(core.vertices, T[:3, :3].T) + T[:3, 3], core.radius_m)
        for placed in body.shapes
        for T in [transforms.of_pose(placed.pose)]
        for core in cores(placed.shape)
    ]
    low = np.min([points.min(axis=0) - grown for points, grown in parts], axis=0)
    high = np.max([points.max(axis=0) + grown for points, grown in parts], axis=0)
    return low, high


def seen_in(data: Mapping[str, Any], cell: Cell) -> tuple[tuple[Seen, ...], tuple[str, ...]]:
    """The bodies that the data of a reply tells of, and the names of those that it tells of in a way that cannot be read.

    What the cell does not know needs a box.
    """
    told = data.get(SEEN, {})
    if not isinstance(told, Mapping):
        return (), (SEEN,)
    found = {str(name): _read(str(name), entry) for name, entry in told.items()}
    seen = tuple(each for n, each in found.items() if each is not None and (each.box_m or n in cell.bodies))
    return seen, tuple(name for name in found if name not in {each.name for each in seen})


def _read(name: str, entry: Any) -> Seen | None:
    if not isinstance(entry, Mapping) or not name.isidentifier():
        return None
    at, rpy = _three(entry.get("at")), _three(entry.get("rpy", [0.0, 0.0, 0.0]))
    box = _three(entry["box"]) if "box" in entry else None
    if at is None or rpy is None or ("box" in entry and (box is None or min(box) <= 0.0)):
        return None
    return Seen(name, Pose(at, (radians(rpy[0]), radians(rpy[1]), radians(rpy[2]))), box)


def _three(said: Any) -> tuple[float, float, float] | None:
    if (
        not isinstance(said, Sequence)
        or len(said) != 3
        or not all(is_number(each, FARTHEST_M) for each in said)
    ):
        return None
    return float(said[0]), float(said[1]), float(said[2])


def with_seen(cell: Cell, seen: Sequence[Seen]) -> Cell:
    """The cell with the bodies among those that it does not know, each as a box that stands there, `ROOM_M` larger on each side."""
    boxes = {
        each.name: Body(each.name, BodyKind.FIXTURE, Placement("world", each.pose), (_grown(each.box_m),))
        for each in seen
        if each.box_m is not None and each.name not in cell.bodies
    }
    return replace(cell, bodies={**cell.bodies, **boxes}) if boxes else cell


def _grown(box_m: tuple[float, float, float]) -> PlacedShape:
    x, y, z = (each + 2 * ROOM_M for each in box_m)
    return PlacedShape(Box((x, y, z)))
