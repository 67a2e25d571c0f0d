"""Lengths, angles, poses and shapes in files, read into metres and radians."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from cellwright.kb.diagnostics import unknown_name
from cellwright.kb.files import is_file, path_below
from cellwright.kb.loader.reader import LoadFindings
from cellwright.kb.loader.yaml_tree import YamlNode, child_at, mapping_members, required_child
from cellwright.kb.model.body_shapes import (
    MAX_MAGNITUDE,
    MESH_SUFFIXES,
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
from cellwright.kb.schema.geometry_forms import QUANTITY

LENGTH_UNITS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}
ANGLE_UNITS_RAD = {"rad": 1.0, "deg": math.pi / 180}
MIN_SHAPE_SCALE = 1e-9  # a scale nearer to zero leaves nothing
LENGTH, ANGLE, FACTOR = "length", "angle", "factor"


@dataclass(frozen=True)
class QuantityReader:
    """Reads the numbers of one file.

    `length` and `angle` are the units of numbers without a unit.
    """

    findings: LoadFindings
    folder: Path
    length: str = "m"
    angle: str = "deg"

    def file(self, node: YamlNode) -> Path | None:
        """The path of a file that a node names. A name that leads out of the folder is reported."""
        path = path_below(self.folder, str(node.value))
        if path is None:
            message = f"'{str(node.value)[:60]}' leads outside the domain's folder"
            self.findings.add(node.where, "K203", message, "copy the file into the folder")
        return path

    def number(self, node: YamlNode, kind: str = LENGTH) -> float:
        """The quantity of a scalar node in metres or radians (a factor unchanged).

        Anything else is reported and becomes 0.
        """
        match = QUANTITY.fullmatch(str(node.value))
        if match is None:
            self.findings.add(node.where, "K005", "not a number", "write 0.5, 20 mm or 90 deg")
            return 0.0
        units = {LENGTH: LENGTH_UNITS_M, ANGLE: ANGLE_UNITS_RAD, FACTOR: {"": 1.0}}[kind]
        # devices count in metres and degrees, whatever the cell counts in
        own = node.file.user() is None
        bare = {
            LENGTH: self.length if own else "m",
            ANGLE: self.angle if own else "deg",
            FACTOR: "",
        }[kind]
        unit = match[2] or bare
        if unit not in units:
            hint = f"one of: {', '.join(units)}" if kind != FACTOR else "leave the unit out"
            self.findings.add(node.where, "K103", f"'{unit}' is not a unit of {_A[kind]}", hint)
            return 0.0
        value = float(match[1]) * units[unit]
        if abs(value) > MAX_MAGNITUDE:
            self.findings.add(
                node.where, "K113", f"larger than {MAX_MAGNITUDE:g}", "check the unit"
            )
            return 0.0
        return value

    def positive(self, node: YamlNode) -> float:
        """A length, which must be greater than zero."""
        value = self.number(node)
        if value <= 0 and QUANTITY.fullmatch(str(node.value)):
            self.findings.add(
                node.where, "K702", "a shape needs a positive extent", "give its size"
            )
        return value

    def vector(self, node: YamlNode | None, kind: str = LENGTH) -> Vector:
        """Three quantities; zeros if there is no node."""
        if node is None:
            return (0.0, 0.0, 0.0)
        x, y, z = (self.number(item, kind) for item in node.value)
        return (x, y, z)

    def pose(self, node: YamlNode | None) -> Pose:
        """The pose given by the keys `at` and `rpy` of a mapping."""
        return Pose(self.vector(child_at(node, "at")), self.vector(child_at(node, "rpy"), ANGLE))

    def shapes(self, node: YamlNode | None) -> tuple[PlacedShape, ...]:
        """The shapes of a list."""
        shapes = []
        for item in node.value if node else []:
            shape = self.shape(item)
            if shape is not None:
                shapes.append(PlacedShape(shape, self.pose(item)))
        return tuple(shapes)

    def shape(self, node: YamlNode) -> Shape | None:
        """The only shape among the keys of a mapping.

        If there is none or more than one, this is reported and the result is None.
        """
        given = [
            key for key in node.value if key in _SHAPE_READERS and child_at(node, key) is not None
        ]
        if len(given) != 1:
            said = "two shapes in one entry" if given else "an entry without a shape"
            self.findings.add(
                node.where, "K005", said, f"give exactly one of: {', '.join(_SHAPE_READERS)}"
            )
            return None
        return _SHAPE_READERS[given[0]](self, node.value[given[0]][1])


_A = {LENGTH: "a length", ANGLE: "an angle", FACTOR: "a factor"}


def _read_sphere(read: QuantityReader, node: YamlNode) -> Shape:
    return Sphere(read.positive(node))


def _read_tube(read: QuantityReader, node: YamlNode) -> Shape:
    return Tube(
        read.positive(required_child(node, "radius")), read.positive(required_child(node, "length"))
    )


def _read_cylinder(read: QuantityReader, node: YamlNode) -> Shape:
    return Cylinder(
        read.positive(required_child(node, "radius")), read.positive(required_child(node, "length"))
    )


def _read_box(read: QuantityReader, node: YamlNode) -> Shape:
    x, y, z = (read.positive(item) for item in node.value)
    return Box((x, y, z))


def _read_ring(read: QuantityReader, node: YamlNode) -> Shape:
    radius, inner = (read.positive(required_child(node, key)) for key in ("radius", "inner"))
    if inner >= radius > 0:
        read.findings.add(
            node.where, "K702", "the bore is as wide as the ring", "give it a smaller `inner`"
        )
    return Ring(radius, inner, read.positive(required_child(node, "length")))


def _read_plate(read: QuantityReader, node: YamlNode) -> Shape:
    x, y, z = (read.positive(item) for item in required_child(node, "size").value)
    listed = child_at(node, "holes")
    holes: list[Hole] = []
    for item in listed.value if listed else []:
        u, v = (read.number(coordinate) for coordinate in required_child(item, "at").value)
        hole = Hole((u, v), read.positive(required_child(item, "radius")))
        apart = all(
            max(abs(u - placed.at_m[0]), abs(v - placed.at_m[1])) > hole.radius_m + placed.radius_m
            for placed in holes
        )
        if abs(u) + hole.radius_m >= x / 2 or abs(v) + hole.radius_m >= y / 2 or not apart:
            hint = "the square around a hole lies within the plate, and meets no other"
            read.findings.add(item.where, "K702", "a hole leaves no plate around it", hint)
        else:
            holes.append(hole)
    return Plate((x, y, z), tuple(holes))


def _read_polyhedron(read: QuantityReader, node: YamlNode) -> Shape:
    vertices = {
        key: read.vector(value)
        for key, _, value in mapping_members(required_child(node, "vertices"))
    }
    faces = [
        Face(key, _known_vertices(read, value, vertices), value.where)
        for key, _, value in mapping_members(child_at(node, "faces"))
    ]
    edges = []
    for key, _, value in mapping_members(child_at(node, "edges")):
        ends = _known_vertices(read, value, vertices)
        if len(ends) == 2:
            edges.append(Edge(key, (ends[0], ends[1])))
    listed = child_at(node, "pieces")
    pieces = tuple(
        _known_vertices(read, piece, vertices) for piece in (listed.value if listed else [])
    )
    return Polyhedron(vertices, tuple(faces), tuple(edges), pieces, node.where)


def _known_vertices(
    read: QuantityReader, node: YamlNode, vertices: dict[str, Vector]
) -> tuple[str, ...]:
    """The vertex names in a list. Unknown names are reported and left out."""
    names = []
    for item in node.value:
        if item.value in vertices:
            names.append(item.value)
        else:
            read.findings.note(unknown_name("vertex", str(item.value), vertices, item.where))
    return tuple(names)


def _read_mesh(read: QuantityReader, node: YamlNode) -> Shape:
    file, scale = required_child(node, "file"), child_at(node, "scale")
    path = read.file(file)
    if path is None:
        path = read.folder
    elif not is_file(path):
        read.findings.add(
            file.where, "K706", f"there is no file '{file.value}'", "name a file beside this one"
        )
    elif path.suffix.lower() not in MESH_SUFFIXES:
        hint = f"convert it to one of: {', '.join(MESH_SUFFIXES)}"
        read.findings.add(
            file.where, "K702", f"'{path.suffix}' is not a supported mesh format", hint
        )
    if scale is None:
        return Mesh(str(path), where=file.where)
    x, y, z = (
        [read.number(item, FACTOR) for item in scale.value]
        if isinstance(scale.value, list)
        else [read.number(scale, FACTOR)] * 3
    )
    if not all(abs(factor) >= MIN_SHAPE_SCALE for factor in (x, y, z)):
        read.findings.add(
            scale.where,
            "K702",
            "a scale of 0 leaves no volume",
            "write 1, or 0.001 for millimetres",
        )
    return Mesh(str(path), (x, y, z), file.where)


def _height_field(read: QuantityReader, node: YamlNode) -> Shape:
    dx, dy = (read.positive(item) for item in required_child(node, "spacing").value)
    rows = required_child(node, "heights")
    heights = tuple(tuple(read.number(item) for item in row.value) for row in rows.value)
    if len(heights) < 2 or len({len(row) for row in heights}) != 1 or len(heights[0]) < 2:
        hint = "write at least two rows of at least two heights, all of the same length"
        read.findings.add(rows.where, "K702", "not a grid of heights", hint)
    floor = child_at(node, "floor")
    return HeightField((dx, dy), heights, read.number(floor) if floor else 0.0, node.where)


def _point_set(read: QuantityReader, node: YamlNode) -> Shape:
    points = required_child(node, "points")
    if not points.value:
        read.findings.add(points.where, "K702", "the point set is empty", "remove it")
    return PointSet(
        tuple(read.vector(item) for item in points.value),
        read.positive(required_child(node, "radius")),
    )


_SHAPE_READERS: dict[str, Callable[[QuantityReader, YamlNode], Shape]] = {
    "sphere": _read_sphere,
    "tube": _read_tube,
    "box": _read_box,
    "cylinder": _read_cylinder,
    "ring": _read_ring,
    "plate": _read_plate,
    "polyhedron": _read_polyhedron,
    "mesh": _read_mesh,
    "height_field": _height_field,
    "point_set": _point_set,
}
