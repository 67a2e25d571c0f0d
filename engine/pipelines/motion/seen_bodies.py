"""Bodies that are seen during a run, and the facts that put a known body where it was seen.

`at` (m) and `rpy` (degrees) say where a body is in the world: its own frame if the cell knows it,
else the middle of a box around it, whose sides are `box` (m).
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import degrees, radians
from typing import Any

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.linear import matmul
from cellwright.engine.model.run_protocol import BODIES_SEEN
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.shapes.part_shapes import shape_cores
from cellwright.engine.stages.geometry.world.geometric_world import (
    GeometricWorld,
    world_after_facts,
)
from cellwright.kb.asp import ground_term
from cellwright.kb.model.body_shapes import Box, PlacedShape, Pose
from cellwright.kb.model.cell_model import Body, BodyKind, Cell, Location, Placement
from cellwright.kb.numbers import is_number
from cellwright.kb.terms import Atom, Function, is_ground, match_term, substitute_term

FARTHEST_SEEN_M = 1e3
SEEN_ROOM_M = 0.01  # kept from what was seen: neither the look nor the arm is exact


@dataclass(frozen=True, slots=True)
class SeenBody:
    """A body where it was seen in the world, and the sides of a box around it (m); no box for
    one that the cell knows.
    """

    name: str
    pose: Pose
    box_m: tuple[float, float, float] | None = None

    @property
    def T_world(self) -> Floats:
        """Where its frame is (4, 4)."""
        return transforms.of_pose(self.pose)

    def entry(self) -> dict[str, list[float]]:
        """The same as plain JSON."""
        entry = {
            "at": list(self.pose.position_m),
            "rpy": [degrees(angle) for angle in self.pose.rpy_rad],
        }
        return entry if self.box_m is None else {**entry, "box": list(self.box_m)}


def look_at(world: GeometricWorld, name: str, boxed: bool) -> SeenBody:
    """What a look at a body tells: where it is; `boxed`, the middle and the sides of the box
    around it.
    """
    T = world.pose("world", name)
    if not boxed:
        return SeenBody(name, transforms.to_pose(T))
    low, high = _body_extent(world.cell.bodies[name])
    middle = transforms.translation(*((low + high) / 2))
    x, y, z = (float(length) for length in high - low)
    return SeenBody(name, transforms.to_pose(matmul(T, middle)), (x, y, z))


def _body_extent(body: Body) -> tuple[Floats, Floats]:
    """The lower and upper corner (3,) of the box around a body, in its own frame."""
    parts = [
        (matmul(core.vertices, T[:3, :3].T) + T[:3, 3], core.radius_m)
        for placed in body.shapes
        for T in [transforms.of_pose(placed.pose)]
        for core in shape_cores(placed.shape)
    ]
    low = np.min([points.min(axis=0) - grown for points, grown in parts], axis=0)
    high = np.max([points.max(axis=0) + grown for points, grown in parts], axis=0)
    return low, high


def seen_in(data: Mapping[str, Any], cell: Cell) -> tuple[tuple[SeenBody, ...], tuple[str, ...]]:
    """The bodies that the data of a reply tells of, and the names of those that it tells of in a
    way that cannot be read.

    What the cell does not know needs a box.
    """
    bodies_told = data.get(BODIES_SEEN, {})
    if not isinstance(bodies_told, Mapping):
        return (), (BODIES_SEEN,)
    bodies_read = {str(name): _read_seen(str(name), entry) for name, entry in bodies_told.items()}
    seen = tuple(
        seen_body
        for n, seen_body in bodies_read.items()
        if seen_body is not None and (seen_body.box_m or n in cell.bodies)
    )
    return seen, tuple(
        name for name in bodies_read if name not in {seen_body.name for seen_body in seen}
    )


def _read_seen(name: str, entry: Any) -> SeenBody | None:
    if not isinstance(entry, Mapping) or not name.isidentifier():
        return None
    at, rpy = _three_numbers(entry.get("at")), _three_numbers(entry.get("rpy", [0.0, 0.0, 0.0]))
    box = _three_numbers(entry["box"]) if "box" in entry else None
    if at is None or rpy is None or ("box" in entry and (box is None or min(box) <= 0.0)):
        return None
    return SeenBody(name, Pose(at, (radians(rpy[0]), radians(rpy[1]), radians(rpy[2]))), box)


def _three_numbers(numbers: Any) -> tuple[float, float, float] | None:
    if (
        not isinstance(numbers, Sequence)
        or len(numbers) != 3
        or not all(is_number(number, FARTHEST_SEEN_M) for number in numbers)
    ):
        return None
    return float(numbers[0]), float(numbers[1]), float(numbers[2])


def with_seen(cell: Cell, seen: Sequence[SeenBody]) -> Cell:
    """The cell with the bodies among those that it does not know, each as a box that stands
    there, `ROOM_M` larger on each side.
    """
    boxes = {
        seen_body.name: Body(
            seen_body.name,
            BodyKind.FIXTURE,
            Placement("world", seen_body.pose),
            (_grown_box(seen_body.box_m),),
        )
        for seen_body in seen
        if seen_body.box_m is not None and seen_body.name not in cell.bodies
    }
    return replace(cell, bodies={**cell.bodies, **boxes}) if boxes else cell


def _grown_box(box_m: tuple[float, float, float]) -> PlacedShape:
    x, y, z = (side_m + 2 * SEEN_ROOM_M for side_m in box_m)
    return PlacedShape(Box((x, y, z)))


NEAR_PLACE_M = 0.03  # a body so near to a place is there


def at_places(cell: Cell, seen: SeenBody) -> tuple[Atom, ...]:
    """The facts that put a body within `NEAR_M` of where it was seen, the nearest first; none
    if it lies beside all places.
    """
    seen_m, candidates = seen.T_world[:3, 3], list[tuple[float, str, Atom]]()
    for location in cell.locations:
        for fact in _location_facts(cell, location, seen.name):
            world = world_after_facts(GeometricWorld.of(cell), (fact,))
            off = float(np.linalg.norm(world.pose("world", seen.name)[:3, 3] - seen_m))
            candidates += [(off, str(fact), fact)] if off <= NEAR_PLACE_M else []
    return tuple(fact for *_, fact in sorted(candidates, key=lambda candidate: candidate[:2]))


def _location_facts(cell: Cell, location: Location, body: str) -> Iterator[Atom]:
    """The facts of one location that put a body at some place of the cell."""
    bindings = match_term(location.body, Function(body), {})
    if bindings is None or location.place is None:
        return
    for name in cell.places:
        place = ground_term(name)
        more = match_term(location.place, place, dict(bindings))
        fact = None if more is None else substitute_term(location.fact, more)
        if isinstance(fact, Function) and is_ground(fact):
            yield fact


def placing_facts(cell: Cell, facts: Collection[Atom], bodies: Collection[str]) -> tuple[Atom, ...]:
    """Those of the facts that put some bodies where they are."""
    putting_facts = []
    for fact in sorted(facts, key=str):
        for location in cell.locations:
            bindings = match_term(location.fact, fact, {})
            if bindings is not None and str(substitute_term(location.body, bindings)) in bodies:
                putting_facts.append(fact)
                break
    return tuple(putting_facts)
