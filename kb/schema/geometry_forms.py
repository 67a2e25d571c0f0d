"""The forms of quantities with units, poses and shapes, for cells, arms, contacts and scenes."""

import re
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field
from pydantic_core import PydanticCustomError

from cellwright.kb.schema.form_base import Strict

QUANTITY = re.compile(
    r"\s*([-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]{1,3})?)\s*(m|cm|mm|in|rad|deg)?\s*"
)


def _check_quantity(value: Any) -> Any:
    if not isinstance(value, str) or not QUANTITY.fullmatch(value):
        raise PydanticCustomError(
            "quantity", "expected a number, with or without a unit: 0.5, 20 mm, 90 deg"
        )
    return value


Quantity = Annotated[str, BeforeValidator(_check_quantity)]
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
        description="its length along z; for a tube, the distance between the centres of its round "
        "ends"
    )


class PolyhedronEntry(Strict):
    """A polyhedron with named vertices, faces and edges."""

    vertices: dict[str, Triple] = Field(description="name: x, y, z")
    faces: dict[str, list[str]] = Field(
        default_factory=dict, description="name: vertices, counter-clockwise seen from outside"
    )
    edges: dict[str, Pair] = Field(default_factory=dict, description="name: its two vertices")
    pieces: list[list[str]] = Field(
        default_factory=list,
        description="convex pieces that fill it; the polyhedron itself if left out",
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

    at: Annotated[list[Quantity], Field(min_length=2, max_length=2)] = Field(
        description="x, y of its middle"
    )
    radius: Quantity = Field(description="its radius")


class PlateEntry(Strict):
    """A block with round holes along z."""

    size: Triple = Field(description="its size along x, y and z, about its middle")
    holes: list[HoleEntry] = Field(
        default_factory=list, description="round holes, apart from each other"
    )


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
    plate: PlateEntry | None = Field(
        None, description="a block with round holes along z, about its middle"
    )
    polyhedron: PolyhedronEntry | None = Field(
        None, description="vertices, faces and edges with names"
    )
    mesh: MeshEntry | None = Field(None, description="a file of triangles")
    height_field: HeightFieldEntry | None = Field(None, description="heights over a grid")
    point_set: PointsEntry | None = Field(None, description="points with a ball around each")
