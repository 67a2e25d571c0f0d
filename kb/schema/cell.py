"""The shape of `cell.yaml` and of arm files: where things stand, what they look like, how arms move."""

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
    """What numbers without a unit count."""

    length: Literal["m", "cm", "mm", "in"] = Field("m", description="unit of lengths")
    angle: Literal["rad", "deg"] = Field("deg", description="unit of angles")


class PoseEntry(Strict):
    """A pose in a frame known from the context."""

    at: Triple | None = Field(None, description="x, y, z; the origin when left out")
    rpy: Triple | None = Field(
        None, description="roll, pitch, yaw about the fixed x, y, z axes, in this order"
    )


class PlacedEntry(PoseEntry):
    """A pose in a named frame."""

    in_: str = Field("world", alias="in", description="the frame that `at` and `rpy` are given in")


class TubeEntry(Strict):
    """A round body along z."""

    radius: Quantity = Field(description="its radius")
    length: Quantity = Field(description="along z; of a tube between the centres of its round ends")


class PolyhedronEntry(Strict):
    """A polyhedron with named vertices, faces and edges."""

    vertices: dict[str, Triple] = Field(description="name: x, y, z")
    faces: dict[str, list[str]] = Field(
        default_factory=dict, description="name: vertices, counter-clockwise seen from outside"
    )
    edges: dict[str, Pair] = Field(default_factory=dict, description="name: its two vertices")
    pieces: list[list[str]] = Field(
        default_factory=list, description="convex pieces that fill it; itself when left out"
    )


class MeshEntry(Strict):
    """A file of triangles."""

    file: str = Field(description="an STL or OBJ file beside this one; its numbers are metres times `scale`")
    scale: Quantity | Triple = Field("1", description="one factor, or one for each axis")


class HeightFieldEntry(Strict):
    """A surface over a grid, solid below."""

    spacing: Annotated[list[Quantity], Field(min_length=2, max_length=2)] = Field(
        description="grid width along x and y"
    )
    heights: list[list[Quantity]] = Field(description="rows along y of heights along x")
    floor: Quantity = Field("0", description="how deep it is filled")


class PointsEntry(Strict):
    """Measured points."""

    points: list[Triple] = Field(description="positions")
    radius: Quantity = Field(description="of the ball around each")


class ShapeEntry(PoseEntry):
    """One shape: give exactly one of the keys beside `at` and `rpy`."""

    sphere: Quantity | None = Field(None, description="its radius")
    tube: TubeEntry | None = Field(None, description="a cylinder with round ends, along z")
    box: Triple | None = Field(None, description="its size along x, y and z, about its middle")
    cylinder: TubeEntry | None = Field(None, description="with flat ends, along z, about its middle")
    polyhedron: PolyhedronEntry | None = Field(None, description="vertices, faces and edges with names")
    mesh: MeshEntry | None = Field(None, description="a file of triangles")
    height_field: HeightFieldEntry | None = Field(None, description="heights over a grid")
    point_set: PointsEntry | None = Field(None, description="points with a ball around each")


class DhEntry(Strict):
    """One joint in standard Denavit-Hartenberg form: turn theta about z, go d along z and a along x, turn alpha about x."""

    a: Quantity = Field("0", description="length along x")
    alpha: Quantity = Field("0", description="angle about x")
    d: Quantity = Field("0", description="length along z")
    theta: Quantity = Field("0", description="angle about z at joint value 0")
    lower: Quantity | None = Field(None, description="least value; none when left out")
    upper: Quantity | None = Field(None, description="greatest value; none when left out")
    speed: Quantity | None = Field(None, description="greatest speed, per second")
    acceleration: Quantity | None = Field(None, description="greatest acceleration, per second squared")


class LinkEntry(PoseEntry):
    """A rigid link."""

    carrier: str = Field(pattern=r"^[0-9]{1,2}$", description="how many joints move it; 0 for the base")
    shapes: list[ShapeEntry] = Field(default_factory=list, description="what can collide")


class ArmFile(Strict):
    """An arm: its joints as a Denavit-Hartenberg table, and the shapes of its links."""

    arm: str = Field(pattern=r"^[a-z][a-z0-9_]*$", description="the arm's name")
    units: UnitsEntry = Field(
        default_factory=lambda: UnitsEntry(length="m", angle="deg"), description="what bare numbers count"
    )
    dh: list[DhEntry] = Field(min_length=1, description="one entry for each joint, from the base")
    links: dict[str, LinkEntry] = Field(default_factory=dict, description="name: link")
    allowed_contacts: list[Pair] = Field(
        default_factory=list, description="pairs of links that may touch or never can"
    )
    assumptions: list[str] = Field(default_factory=list, description="what is assumed, not published")


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
    home: list[Quantity] = Field(default_factory=list, description="a configuration to rest in")


class BodyEntry(PlacedEntry):
    """Something solid."""

    shapes: list[ShapeEntry] = Field(default_factory=list, description="what can collide")
    features: dict[str, PoseEntry] = Field(
        default_factory=dict, description="named poses on it; `tip` is what a tool works with"
    )


class RegionEntry(PlacedEntry, ShapeEntry):
    """A region of the region tree: a sphere, tube, box or polyhedron."""

    parents: list[str] = Field(
        default_factory=list, description="regions whose union contains this one; none for a root"
    )
    solid: Truth = Field(False, description="a real thing, not only a part of space")


class PlaceEntry(PlacedEntry):
    """Where an arm's tool point goes for a place of the domain."""

    arm: str | None = Field(None, description="which arm; the only one when left out")
    tool: str | None = Field(None, description="the tool in its hand, whose feature `tip` takes the pose")
    approach: Quantity = Field("0", description="how far back along the tool's z it must also get")
    turns: Truth = Field(False, description="the tool may turn about its own z")
    touches: list[str] = Field(default_factory=list, description="bodies that may be in contact there")


class LocationEntry(Strict):
    """Where a fact of the domain puts a body: give `place` or `in`."""

    body: str = Field(description="the body, or a variable of the fact")
    place: Expression | None = Field(None, description="the place whose pose its feature `grip` takes")
    in_: str | None = Field(
        None, alias="in", description="the frame that its feature `grip` coincides with, such as Arm.tool"
    )


class CellFile(Strict):
    """A `cell.yaml`: the geometry of a cell."""

    cell: str = Field(pattern=r"^[a-z][a-z0-9_]*$", description="the cell's name")
    units: UnitsEntry = Field(
        default_factory=lambda: UnitsEntry(length="m", angle="deg"), description="what bare numbers count"
    )
    arms: dict[str, MountedArmEntry] = Field(default_factory=dict, description="name: arm")
    frames: dict[str, PlacedEntry] = Field(default_factory=dict, description="name: where it is")
    fixtures: dict[str, BodyEntry] = Field(default_factory=dict, description="what stands still")
    parts: dict[str, BodyEntry] = Field(default_factory=dict, description="what is handled")
    tools: dict[str, BodyEntry] = Field(
        default_factory=dict, description="what an arm takes in hand or wears"
    )
    regions: dict[str, RegionEntry] = Field(default_factory=dict, description="the region tree")
    allowed_contacts: list[Pair] = Field(
        default_factory=list, description="pairs of bodies or links (arm/link) that may touch"
    )
    places: dict[Expression, PlaceEntry] = Field(
        default_factory=dict,
        description="a place of the domain, such as slot(drawer, 1): where the tool goes",
    )
    locations: dict[Expression, LocationEntry] = Field(
        default_factory=dict, description="a fact, such as at(Item, Place): where it puts a body"
    )
