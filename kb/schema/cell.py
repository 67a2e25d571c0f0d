"""The form of `cell.yaml` and of arm files: the places and shapes of things, and the joints of arms."""

import re
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field
from pydantic_core import PydanticCustomError

from kb.schema.shapes import Expression, Strict, Truth

QUANTITY = re.compile(
    r"\s*([-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]{1,3})?)\s*(m|cm|mm|in|rad|deg)?\s*"
)


def _quantity(value: Any) -> Any:
    if not isinstance(value, str) or not QUANTITY.fullmatch(value):
        raise PydanticCustomError("quantity", "expected a number, with or without a unit: 0.5, 20 mm, 90 deg")
    return value


Quantity = Annotated[str, BeforeValidator(_quantity)]
Triple = Annotated[list[Quantity], Field(min_length=3, max_length=3)]
Pair = Annotated[list[str], Field(min_length=2, max_length=2)]


class UnitsEntry(Strict):
    """The units of numbers that are written without a unit."""

    length: Literal["m", "cm", "mm", "in"] = Field("m", description="unit of lengths")
    angle: Literal["rad", "deg"] = Field("deg", description="unit of angles")


class PoseEntry(Strict):
    """A pose in a frame known from the context."""

    at: Triple | None = Field(None, description="x, y, z; the origin if left out")
    rpy: Triple | None = Field(
        None, description="roll, pitch, yaw about the fixed x, y, z axes, in this order"
    )


class PlacedEntry(PoseEntry):
    """A pose in a named frame."""

    in_: str = Field("world", alias="in", description="the frame that `at` and `rpy` are given in")


class TubeEntry(Strict):
    """A round body along z."""

    radius: Quantity = Field(description="its radius")
    length: Quantity = Field(
        description="its length along z; for a tube, the distance between the centres of its round ends"
    )


class PolyhedronEntry(Strict):
    """A polyhedron with named vertices, faces and edges."""

    vertices: dict[str, Triple] = Field(description="name: x, y, z")
    faces: dict[str, list[str]] = Field(
        default_factory=dict, description="name: vertices, counter-clockwise seen from outside"
    )
    edges: dict[str, Pair] = Field(default_factory=dict, description="name: its two vertices")
    pieces: list[list[str]] = Field(
        default_factory=list, description="convex pieces that fill it; the polyhedron itself if left out"
    )


class MeshEntry(Strict):
    """A file of triangles."""

    file: str = Field(
        description="an STL, OBJ or DAE file beside this one; its numbers are metres times `scale`"
    )
    scale: Quantity | Triple = Field("1", description="one factor, or one for each axis")


class HeightFieldEntry(Strict):
    """A surface over a grid, solid below."""

    spacing: Annotated[list[Quantity], Field(min_length=2, max_length=2)] = Field(
        description="grid width along x and y"
    )
    heights: list[list[Quantity]] = Field(
        description="a list of rows along y, each a list of heights along x"
    )
    floor: Quantity = Field("0", description="the depth of the solid below the surface")


class PointsEntry(Strict):
    """Measured points."""

    points: list[Triple] = Field(description="positions")
    radius: Quantity = Field(description="the radius of the ball around each point")


class RingEntry(Strict):
    """A cylinder with a bore, along z."""

    radius: Quantity = Field(description="its outer radius")
    inner: Quantity = Field(description="the radius of its bore")
    length: Quantity = Field(description="its length along z")


class HoleEntry(Strict):
    """A round hole in a plate."""

    at: Annotated[list[Quantity], Field(min_length=2, max_length=2)] = Field(description="x, y of its middle")
    radius: Quantity = Field(description="its radius")


class PlateEntry(Strict):
    """A block with round holes along z."""

    size: Triple = Field(description="its size along x, y and z, about its middle")
    holes: list[HoleEntry] = Field(default_factory=list, description="round holes, apart from each other")


class ShapeEntry(PoseEntry):
    """One shape: give exactly one of the keys beside `at` and `rpy`."""

    sphere: Quantity | None = Field(None, description="its radius")
    tube: TubeEntry | None = Field(None, description="a cylinder with round ends, along z")
    box: Triple | None = Field(None, description="its size along x, y and z, about its middle")
    cylinder: TubeEntry | None = Field(
        None, description="a cylinder with flat ends, along z, about its middle"
    )
    ring: RingEntry | None = Field(
        None, description="a cylinder with a round bore, along z, about its middle"
    )
    plate: PlateEntry | None = Field(None, description="a block with round holes along z, about its middle")
    polyhedron: PolyhedronEntry | None = Field(None, description="vertices, faces and edges with names")
    mesh: MeshEntry | None = Field(None, description="a file of triangles")
    height_field: HeightFieldEntry | None = Field(None, description="heights over a grid")
    point_set: PointsEntry | None = Field(None, description="points with a ball around each")


class DhEntry(Strict):
    """One joint in standard Denavit-Hartenberg form: turn theta about z, move d along z and a along x, turn alpha about x."""

    a: Quantity = Field("0", description="length along x")
    alpha: Quantity = Field("0", description="angle about x")
    d: Quantity = Field("0", description="length along z")
    theta: Quantity = Field("0", description="angle about z at joint value 0")
    lower: Quantity | None = Field(None, description="the least value; no limit if left out")
    upper: Quantity | None = Field(None, description="the greatest value; no limit if left out")
    speed: Quantity | None = Field(None, description="greatest speed, per second")
    acceleration: Quantity | None = Field(None, description="greatest acceleration, per second squared")


class LinkEntry(PoseEntry):
    """A rigid link."""

    carrier: str = Field(
        pattern=r"^[0-9]{1,2}$", description="the number of joints that move it; 0 for the base"
    )
    shapes: list[ShapeEntry] = Field(default_factory=list, description="the shapes that can collide")


class ArmFile(Strict):
    """An arm: its joints as a Denavit-Hartenberg table, and the shapes of its links."""

    arm: str = Field(pattern=r"^[a-z][a-z0-9_]*$", description="the arm's name")
    units: UnitsEntry = Field(
        default_factory=lambda: UnitsEntry(length="m", angle="deg"),
        description="the units of numbers without a unit",
    )
    dh: list[DhEntry] = Field(min_length=1, description="one entry for each joint, from the base")
    links: dict[str, LinkEntry] = Field(default_factory=dict, description="name: link")
    allowed_contacts: list[Pair] = Field(
        default_factory=list, description="pairs of links that may touch or can never touch"
    )
    assumptions: list[str] = Field(
        default_factory=list, description="values that are assumed because they are not published"
    )


class MountedArmEntry(PlacedEntry):
    """An arm in the cell: give `model`, or `urdf`."""

    model: str | None = Field(None, description="a bundled arm, or an arm file beside this one")
    urdf: str | None = Field(None, description="a URDF file beside this one")
    srdf: str | None = Field(None, description="an SRDF file: which links may touch")
    chain: Pair | None = Field(None, description="first and last link of the arm in the URDF")
    packages: list[str] = Field(
        default_factory=list, description="folders in which package:// paths are looked up"
    )
    tool: PoseEntry | None = Field(None, description="the tool point after the flange")
    home: list[Quantity] = Field(default_factory=list, description="the configuration in which it rests")


class GuideEntry(Strict):
    """How a body moves on what it stands on: give `slides` or `swings`."""

    slides: Triple | None = Field(None, description="the direction, in its own frame")
    swings: Triple | None = Field(None, description="the axis through the origin of its own frame")
    range: Annotated[list[Quantity], Field(min_length=2, max_length=2)] = Field(
        description="the least and the greatest value; at 0 it is where the file places it"
    )
    follows: str | None = Field(None, description="the body with a joint that it always goes as far as")


class BodyEntry(PlacedEntry):
    """Something solid."""

    joint: GuideEntry | None = Field(
        None, description="how it moves on what it stands on; it stands still if left out"
    )
    mass: str | None = Field(
        None, pattern=r"^[0-9]+(\.[0-9]+)? *(kg|g)?$", description="its mass, in kg if no unit is given"
    )
    friction: str | None = Field(
        None, pattern=r"^[0-9]+(\.[0-9]+)?$", description="its coefficient of sliding friction"
    )

    shapes: list[ShapeEntry] = Field(default_factory=list, description="the shapes that can collide")
    features: dict[str, PoseEntry] = Field(
        default_factory=dict, description="named poses on it; `tip` is what a tool works with"
    )


class RegionEntry(PlacedEntry, ShapeEntry):
    """A region of the region tree: a sphere, tube, box or polyhedron."""

    parents: list[str] = Field(
        default_factory=list, description="regions whose union contains this one; none for a root"
    )
    solid: Truth = Field(False, description="a real thing, not only a part of space")


class ZoneEntry(PlacedEntry, ShapeEntry):
    """A space in which people may be, or come near."""

    speed: Quantity = Field(
        "0.25 m", description="the greatest speed of any point of an arm in it, per second"
    )


class PlaceEntry(PlacedEntry):
    """The pose of an arm's tool point for a place of the domain."""

    arm: str | None = Field(None, description="the arm; the only arm of the cell if left out")
    tool: str | None = Field(None, description="the tool in its hand, whose feature `tip` takes the pose")
    approach: Quantity = Field(
        "0", description="the distance back along the tool's z that the arm must also reach"
    )
    turns: Truth = Field(False, description="the tool may turn about its own z")
    touches: list[str] = Field(default_factory=list, description="bodies that may be in contact there")
    depth: Quantity = Field("5 mm", description="how deep the bodies in `touches` may be entered or pressed")


class LocationEntry(Strict):
    """The place that a fact of the domain gives to a body: give `place`, `in` or `joint`."""

    body: str = Field(description="the body, or a variable of the fact")
    place: Expression | None = Field(None, description="the place whose pose its feature `grip` takes")
    in_: str | None = Field(
        None, alias="in", description="the frame that its feature `grip` coincides with, such as Arm.tool"
    )
    joint: Quantity | None = Field(None, description="how far the body is along its joint")


class OperationEntry(Strict):
    """What the arm does in a step of an operator."""

    at: Expression | None = Field(None, description="the place that the arm goes to")
    ends: Literal["outside", "inside", "before"] = Field(
        "outside",
        description="where the arm is then: back before the place, in it, or before it without having been in it",
    )
    drags: str | None = Field(None, description="the body that the arm moves along its joint there")
    drives: str | None = Field(None, description="the body that moves the arm along its joint")
    takes: str | None = Field(
        None,
        pattern=r"^[0-9]+(\.[0-9]+)? *(s|ms|min)?$",
        description="the time that is spent at the place, in s",
    )


class MeasuringEntry(Strict):
    """How a tool takes a measurement that has a position, but no place of its own."""

    approach: Quantity = Field("0", description="how far the tool backs off along its z")
    touches: list[str] = Field(default_factory=list, description="bodies that it may be in contact with")
    tilts: list[Quantity] = Field(
        default_factory=lambda: ["0"],
        description="the angles to the normal that are allowed, the preferred ones first",
    )
    field: Quantity = Field("0", description="the width of what a scanner sees at its working distance")
    patch: Annotated[list[Quantity], Field(min_length=2, max_length=2)] | None = Field(
        None, description="the least and the greatest side of a patch in the picture of a scanner"
    )


class CellFile(Strict):
    """A `cell.yaml`: the geometry of a cell."""

    cell: str = Field(pattern=r"^[a-z][a-z0-9_]*$", description="the cell's name")
    units: UnitsEntry = Field(
        default_factory=lambda: UnitsEntry(length="m", angle="deg"),
        description="the units of numbers without a unit",
    )
    arms: dict[str, MountedArmEntry] = Field(default_factory=dict, description="name: arm")
    frames: dict[str, PlacedEntry] = Field(default_factory=dict, description="name: its pose")
    fixtures: dict[str, BodyEntry] = Field(default_factory=dict, description="bodies that never move")
    parts: dict[str, BodyEntry] = Field(default_factory=dict, description="bodies that are handled")
    tools: dict[str, BodyEntry] = Field(
        default_factory=dict, description="bodies that an arm holds or carries as a tool"
    )
    zones: dict[str, ZoneEntry] = Field(
        default_factory=dict,
        description="name: a space in which arms move slowly, because people may be there",
    )
    regions: dict[str, RegionEntry] = Field(default_factory=dict, description="the region tree")
    allowed_contacts: list[Pair] = Field(
        default_factory=list, description="pairs of bodies or links (arm/link) that may touch"
    )
    places: dict[Expression, PlaceEntry] = Field(
        default_factory=dict,
        description="a place of the domain, such as slot(drawer, 1), and the pose of the tool there",
    )
    locations: dict[Expression, LocationEntry] = Field(
        default_factory=dict,
        description="a fact, such as at(Item, Place), and the place that it gives to a body",
    )
    operations: dict[Expression, OperationEntry] = Field(
        default_factory=dict,
        description="an operator, such as pick(Item, Place), and what the arm does in its steps",
    )
    measuring: dict[str, MeasuringEntry] = Field(
        default_factory=dict,
        description="a tool, and how it takes the measurements whose position a problem gives",
    )
