"""Lengths, angles, poses and shapes in files. Numbers with units become metres and radians; their places are kept."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from cellwright.kb.files import is_file, within
from cellwright.kb.loader.reader import Findings
from cellwright.kb.loader.tree import Node
from cellwright.kb.model.shapes import (
    LARGEST,
    MESHES,
    Box,
    Cylinder,
    Edge,
    Face,
    HeightField,
    Hole,
    Mesh,
    PlacedShape,
    Plate,
    PointSet,
    Polyhedron,
    Pose,
    Ring,
    Shape,
    Sphere,
    Tube,
    Vector,
)
from cellwright.kb.schema.solids import QUANTITY

LENGTHS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}
ANGLES = {"rad": 1.0, "deg": math.pi / 180}
LEAST = 1e-9  # a scale nearer to zero leaves nothing
LENGTH, ANGLE, FACTOR = "length", "angle", "factor"


@dataclass(frozen=True)
class Quantities:
    """Reads the numbers of one file. `length` and `angle` are the units of numbers without a unit."""

    findings: Findings
    folder: Path
    length: str = "m"
    angle: str = "deg"

    def file(self, node: Node) -> Path | None:
        """The path of a file that a node names. A name that leads out of the folder is reported."""
        found = within(self.folder, str(node.value))
        if found is None:
            message = f"'{str(node.value)[:60]}' leads outside the domain's folder"
            self.findings.add(node.where, "K203", message, "copy the file into the folder")
        return found

    def number(self, node: Node, kind: str = LENGTH) -> float:
        """The quantity of a scalar node in metres or radians (a factor unchanged). Anything else is reported and becomes 0."""
        found = QUANTITY.fullmatch(str(node.value))
        if found is None:
            self.findings.add(node.where, "K005", "not a number", "write 0.5, 20 mm or 90 deg")
            return 0.0
        units = {LENGTH: LENGTHS, ANGLE: ANGLES, FACTOR: {"": 1.0}}[kind]
        own = node.file.user() is None  # devices count in metres and degrees, whatever the cell counts in
        bare = {LENGTH: self.length if own else "m", ANGLE: self.angle if own else "deg", FACTOR: ""}[kind]
        unit = found[2] or bare
        if unit not in units:
            hint = f"one of: {', '.join(units)}" if kind != FACTOR else "leave the unit out"
            self.findings.add(node.where, "K103", f"'{unit}' is not a unit of {_A[kind]}", hint)
            return 0.0
        value = float(found[1]) * units[unit]
        if abs(value) > LARGEST:
            self.findings.add(node.where, "K113", f"larger than {LARGEST:g}", "check the unit")
            return 0.0
        return value

    def positive(self, node: Node) -> float:
        """A length, which must be greater than zero."""
        value = self.number(node)
        if value <= 0 and QUANTITY.fullmatch(str(node.value)):
            self.findings.add(node.where, "K702", "a shape needs a positive extent", "give its size")
        return value

    def vector(self, node: Node | None, kind: str = LENGTH) -> Vector:
        """Three quantities; zeros if there is no node."""
        if node is None:
            return (0.0, 0.0, 0.0)
        x, y, z = (self.number(item, kind) for item in node.value)
        return (x, y, z)

    def pose(self, node: Node | None) -> Pose:
        """The pose given by the keys `at` and `rpy` of a mapping."""
        return Pose(self.vector(child(node, "at")), self.vector(child(node, "rpy"), ANGLE))

    def shapes(self, node: Node | None) -> tuple[PlacedShape, ...]:
        """The shapes of a list."""
        found = []
        for item in node.value if node else []:
            shape = self.shape(item)
            if shape is not None:
                found.append(PlacedShape(shape, self.pose(item)))
        return tuple(found)

    def shape(self, node: Node) -> Shape | None:
        """The only shape among the keys of a mapping. If there is none or more than one, this is reported and the result is None."""
        given = [key for key in node.value if key in _SHAPES and child(node, key) is not None]
        if len(given) != 1:
            said = "two shapes in one entry" if given else "an entry without a shape"
            self.findings.add(node.where, "K005", said, f"give exactly one of: {', '.join(_SHAPES)}")
            return None
        return _SHAPES[given[0]](self, node.value[given[0]][1])


_A = {LENGTH: "a length", ANGLE: "an angle", FACTOR: "a factor"}


def child(node: Node | None, key: str) -> Node | None:
    """The value under `key` of a mapping, or None."""
    if node is None or not isinstance(node.value, dict) or key not in node.value:
        return None
    value: Node = node.value[key][1]
    return value if value.value != "" else None


def required(node: Node, key: str) -> Node:
    """The value under a key that the checked form of the file guarantees."""
    value: Node = node.value[key][1]
    return value


def members(node: Node | None) -> Iterator[tuple[str, Node, Node]]:
    """The (key, key node, value node) of a mapping; empty if there is no node."""
    if node is not None and isinstance(node.value, dict):
        for key, (key_node, value) in node.value.items():
            yield key, key_node, value


def _sphere(read: Quantities, node: Node) -> Shape:
    return Sphere(read.positive(node))


def _tube(read: Quantities, node: Node) -> Shape:
    return Tube(read.positive(required(node, "radius")), read.positive(required(node, "length")))


def _cylinder(read: Quantities, node: Node) -> Shape:
    return Cylinder(read.positive(required(node, "radius")), read.positive(required(node, "length")))


def _box(read: Quantities, node: Node) -> Shape:
    x, y, z = (read.positive(item) for item in node.value)
    return Box((x, y, z))


def _ring(read: Quantities, node: Node) -> Shape:
    radius, inner = (read.positive(required(node, key)) for key in ("radius", "inner"))
    if inner >= radius > 0:
        read.findings.add(node.where, "K702", "the bore is as wide as the ring", "give it a smaller `inner`")
    return Ring(radius, inner, read.positive(required(node, "length")))


def _plate(read: Quantities, node: Node) -> Shape:
    x, y, z = (read.positive(item) for item in required(node, "size").value)
    listed = child(node, "holes")
    holes: list[Hole] = []
    for item in listed.value if listed else []:
        u, v = (read.number(each) for each in required(item, "at").value)
        hole = Hole((u, v), read.positive(required(item, "radius")))
        apart = all(
            max(abs(u - one.at_m[0]), abs(v - one.at_m[1])) > hole.radius_m + one.radius_m for one in holes
        )
        if abs(u) + hole.radius_m >= x / 2 or abs(v) + hole.radius_m >= y / 2 or not apart:
            hint = "the square around a hole lies within the plate, and meets no other"
            read.findings.add(item.where, "K702", "a hole leaves no plate around it", hint)
        else:
            holes.append(hole)
    return Plate((x, y, z), tuple(holes))


def _polyhedron(read: Quantities, node: Node) -> Shape:
    vertices = {key: read.vector(value) for key, _, value in members(required(node, "vertices"))}
    faces = [Face(key, _known(read, value, vertices)) for key, _, value in members(child(node, "faces"))]
    edges = []
    for key, _, value in members(child(node, "edges")):
        ends = _known(read, value, vertices)
        if len(ends) == 2:
            edges.append(Edge(key, (ends[0], ends[1])))
    listed = child(node, "pieces")
    pieces = tuple(_known(read, piece, vertices) for piece in (listed.value if listed else []))
    return Polyhedron(vertices, tuple(faces), tuple(edges), pieces, node.where)


def _known(read: Quantities, node: Node, vertices: dict[str, Vector]) -> tuple[str, ...]:
    """The vertex names in a list. Unknown names are reported and left out."""
    from cellwright.kb.diagnostics import unknown_name

    names = []
    for item in node.value:
        if item.value in vertices:
            names.append(item.value)
        else:
            read.findings.note(unknown_name("vertex", str(item.value), vertices, item.where))
    return tuple(names)


def _mesh(read: Quantities, node: Node) -> Shape:
    file, scale = required(node, "file"), child(node, "scale")
    path = read.file(file)
    if path is None:
        path = read.folder
    elif not is_file(path):
        read.findings.add(
            file.where, "K706", f"there is no file '{file.value}'", "name a file beside this one"
        )
    elif path.suffix.lower() not in MESHES:
        hint = f"convert it to one of: {', '.join(MESHES)}"
        read.findings.add(file.where, "K702", f"'{path.suffix}' is not a supported mesh format", hint)
    if scale is None:
        return Mesh(str(path), where=file.where)
    x, y, z = (
        [read.number(item, FACTOR) for item in scale.value]
        if isinstance(scale.value, list)
        else [read.number(scale, FACTOR)] * 3
    )
    if not all(abs(factor) >= LEAST for factor in (x, y, z)):
        read.findings.add(
            scale.where, "K702", "a scale of 0 leaves no volume", "write 1, or 0.001 for millimetres"
        )
    return Mesh(str(path), (x, y, z), file.where)


def _height_field(read: Quantities, node: Node) -> Shape:
    dx, dy = (read.positive(item) for item in required(node, "spacing").value)
    rows = required(node, "heights")
    heights = tuple(tuple(read.number(item) for item in row.value) for row in rows.value)
    if len(heights) < 2 or len({len(row) for row in heights}) != 1 or len(heights[0]) < 2:
        hint = "write at least two rows of at least two heights, all of the same length"
        read.findings.add(rows.where, "K702", "not a grid of heights", hint)
    floor = child(node, "floor")
    return HeightField((dx, dy), heights, read.number(floor) if floor else 0.0, node.where)


def _point_set(read: Quantities, node: Node) -> Shape:
    points = required(node, "points")
    if not points.value:
        read.findings.add(points.where, "K702", "the point set is empty", "remove it")
    return PointSet(
        tuple(read.vector(item) for item in points.value), read.positive(required(node, "radius"))
    )


_SHAPES: dict[str, Callable[[Quantities, Node], Shape]] = {
    "sphere": _sphere,
    "tube": _tube,
    "box": _box,
    "cylinder": _cylinder,
    "ring": _ring,
    "plate": _plate,
    "polyhedron": _polyhedron,
    "mesh": _mesh,
    "height_field": _height_field,
    "point_set": _point_set,
}
