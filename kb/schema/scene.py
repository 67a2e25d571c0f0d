"""The form of scene files: what `cellwright place` works on."""

from typing import Annotated

from pydantic import Field

from cellwright.kb.schema.form_base import Strict, WholeNumber
from cellwright.kb.schema.geometry_forms import PlacedEntry, Quantity, Triple, UnitsEntry


class CameraFileEntry(PlacedEntry):
    """A depth camera. Its z axis looks forward, x goes right and y down in its picture."""

    width: Annotated[WholeNumber, Field(ge=8, le=4096)] = Field(640, description="pixels in a row")
    height: Annotated[WholeNumber, Field(ge=8, le=4096)] = Field(480, description="rows of pixels")
    view: Quantity = Field("0.6 m", description="the width that it sees at `distance`")
    distance: Quantity = Field("1 m", description="the distance at which it sees `view`")
    noise: Quantity = Field("1 mm", description="the standard deviation of a depth")
    dropouts: Quantity = Field("0", description="the share of pixels without a depth")


class HandFileEntry(Strict):
    """Parallel jaws, or three fingers, at the tool point of an arm: z points to the part, x is
    the way in which they close.
    """

    arm: str = Field(description="the arm that carries it")
    fingers: Annotated[WholeNumber, Field(ge=2, le=3)] = Field(
        2, description="2 for parallel jaws; 3 for a hand with one finger against two that spread"
    )
    opening: Quantity = Field("100 mm", description="the greatest distance between the pads")
    pad: Quantity = Field("16 mm", description="the side of a square pad")
    finger: Quantity = Field("60 mm", description="the length of a finger")
    thick: Quantity = Field("12 mm", description="how thick a finger is in the closing direction")
    cross: Triple = Field(
        default_factory=lambda: ["140 mm", "40 mm", "30 mm"],
        description="the extents of the cross-piece that carries the fingers",
    )
    sensor: Triple = Field(
        default_factory=lambda: ["60 mm", "60 mm", "30 mm"],
        description="the extents of the force sensor behind it",
    )
    friction: Quantity = Field("0.4", description="the friction coefficient of the pads")
    accuracy: Quantity = Field(
        "0",
        description="the standard deviation of where the arm brings what is held, beside what was "
        "seen",
    )
    force: Quantity = Field("40", description="the force of each pad, in newtons")


class SceneFile(Strict):
    """A scene: a cell, how parts shall lie on each other, and with what they are seen, taken
    and laid down.
    """

    scene: str = Field(pattern=r"^[a-z][a-z0-9_]*$", description="the scene's name")
    cell: str = Field(description="the cell file, beside this one")
    units: UnitsEntry = Field(
        default_factory=lambda: UnitsEntry(length="m", angle="deg"),
        description="the units of numbers without a unit",
    )
    camera: CameraFileEntry = Field(description="the depth camera")
    hand: HandFileEntry = Field(description="the gripper")
    relations: list[str] = Field(
        default_factory=list,
        description="what shall hold, such as: bracket.bottom against base.top; lid.rim distance "
        "base.top = 5 mm",
    )
    preferred: list[str] = Field(
        default_factory=list, description="relations that hold as far as the others allow"
    )
    clutter: list[str] = Field(
        default_factory=list,
        description="bodies of the cell that only the camera sees, and nobody has modelled",
    )
    table: PlacedEntry = Field(
        default_factory=lambda: PlacedEntry.model_validate({}),
        description="a free place on a table, z upwards, where parts are taken anew",
    )
    target: str | None = Field(
        None,
        description="the part that is held before the camera when this is calibrated; it looks the "
        "same "
        "from no two sides",
    )
    calibration: str | None = Field(
        None,
        description="a file beside this one with what was found of the camera; it counts instead "
        "of "
        "`camera`",
    )
    inset: Quantity = Field("15 mm", description="how far inside an edge the jaws take a part")
    density: Quantity = Field("1000", description="of the parts, in kg per cubic metre")
    tolerance: Quantity | None = Field(
        None,
        description="how far from its goal a part may come to lie: where three standard deviations "
        "exceed it, it is looked at anew",
    )
