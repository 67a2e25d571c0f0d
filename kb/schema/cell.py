"""The form of `cell.yaml`: the places and shapes of things, and what arms do there."""

from typing import Annotated, Literal

from pydantic import Field

from cellwright.kb.schema.form_base import Expression, Strict, Truth
from cellwright.kb.schema.geometry_forms import (
    Pair,
    PlacedEntry,
    PoseEntry,
    Quantity,
    ShapeEntry,
    Triple,
    UnitsEntry,
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
    home: list[Quantity] = Field(
        default_factory=list,
        description="the configuration in which it rests: angles, and lengths where joints slide",
    )


class GuideEntry(Strict):
    """How a body moves on what it stands on: give `slides` or `swings`."""

    slides: Triple | None = Field(None, description="the direction, in its own frame")
    swings: Triple | None = Field(None, description="the axis through the origin of its own frame")
    range: Annotated[list[Quantity], Field(min_length=2, max_length=2)] = Field(
        description="the least and the greatest value; at 0 it is where the file places it"
    )
    follows: str | None = Field(
        None, description="the body with a joint that it always goes as far as"
    )


class BodyEntry(PlacedEntry):
    """Something solid."""

    joint: GuideEntry | None = Field(
        None, description="how it moves on what it stands on; it stands still if left out"
    )
    mass: str | None = Field(
        None,
        pattern=r"^[0-9]+(\.[0-9]+)? *(kg|g)?$",
        description="its mass, in kg if no unit is given",
    )
    friction: str | None = Field(
        None, pattern=r"^[0-9]+(\.[0-9]+)?$", description="its coefficient of sliding friction"
    )

    shapes: list[ShapeEntry] = Field(
        default_factory=list, description="the shapes that can collide"
    )
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
    tool: str | None = Field(
        None, description="the tool in its hand, whose feature `tip` takes the pose"
    )
    approach: Quantity = Field(
        "0", description="the distance back along the tool's z that the arm must also reach"
    )
    turns: Truth = Field(False, description="the tool may turn about its own z")
    touches: list[str] = Field(
        default_factory=list, description="bodies that may be in contact there"
    )
    depth: Quantity = Field(
        "5 mm", description="how deep the bodies in `touches` may be entered or pressed"
    )


class LocationEntry(Strict):
    """The place that a fact of the domain gives to a body: give `place`, `in` or `joint`."""

    body: str = Field(description="the body, or a variable of the fact")
    place: Expression | None = Field(
        None, description="the place whose pose its feature `grip` takes"
    )
    in_: str | None = Field(
        None,
        alias="in",
        description="the frame that its feature `grip` coincides with, such as Arm.tool",
    )
    by: str | None = Field(
        None, description="the feature of the body that takes the pose, in place of `grip`"
    )
    joint: Quantity | None = Field(None, description="how far the body is along its joint")


class OperationEntry(Strict):
    """What the arm does in a step of an operator."""

    at: Expression | Annotated[list[Expression], Field(min_length=1)] | None = Field(
        None, description="the place that the arm goes to, or several places in a row"
    )
    ends: Literal["outside", "inside", "before"] = Field(
        "outside",
        description="where the arm is then: back before the place, in it, or before it without "
        "having "
        "been in it",
    )
    with_: Expression | None = Field(
        None,
        alias="with",
        description="the place where another arm is meanwhile: it goes there first, and leaves it "
        "last",
    )
    carries: str | None = Field(
        None,
        description="the body that both arms then carry to where the facts after the step put it",
    )
    drags: str | None = Field(None, description="the body that the arm moves along its joint there")
    drives: str | None = Field(None, description="the body that moves the arm along its joint")
    takes: str | None = Field(
        None,
        pattern=r"^[0-9]+(\.[0-9]+)? *(s|ms|min)?$",
        description="the time that is spent at the place, in s",
    )


Range = Annotated[list[Quantity], Field(min_length=2, max_length=2)]


class SightEntry(Strict):
    """From where a scanner sees what it measures."""

    eyes: Annotated[list[str], Field(min_length=1)] = Field(
        description="the features of the tool that must all see the whole patch"
    )
    range: Range = Field(description="the least and the greatest distance from an eye to the patch")
    incidence: Quantity = Field(
        "90", description="the greatest angle between the normal and the way that an eye looks"
    )
    back: Quantity = Field("0", description="how far the tool is back along its z while it looks")


class RangingEntry(Strict):
    """A laser ranging tool: its picture, its modulated light, and how it errs."""

    eye: str = Field(description="the feature of the tool that it looks from, along z")
    pixels: Annotated[
        list[Annotated[int, Field(ge=4, le=2048)]], Field(min_length=2, max_length=2)
    ] = Field(description="the width and the height of the picture in pixels")
    view: Quantity = Field(description="the angle that the width of the picture spans")
    wavelength: Quantity = Field(
        description="of the modulation: ranges are known modulo half of it"
    )
    noise: Quantity = Field(
        description="the standard deviation of a range at the distance `at`, square to the beam"
    )
    at: Quantity = Field(description="the distance that `noise` holds at")
    beam: Quantity = Field(description="the full divergence of the beam, an angle")
    pointing: Quantity = Field(
        "0", description="the standard deviation of the beam's direction, an angle"
    )
    grazing: Quantity = Field(
        "80 deg",
        description="at the distance `at`, a surface seen flatter than this gives no answer",
    )
    dropouts: Quantity = Field("0", description="the share of pixels without an answer")


class MeasuringEntry(Strict):
    """How a tool takes a measurement that has a position, but no place of its own."""

    approach: Quantity = Field("0", description="how far the tool backs off along its z")
    touches: list[str] = Field(
        default_factory=list, description="bodies that it may be in contact with"
    )
    tilts: list[Quantity] = Field(
        default_factory=lambda: ["0"],
        description="the angles to the normal that are allowed, the preferred ones first",
    )
    field: Quantity = Field(
        "0", description="the width of what a scanner sees at its working distance"
    )
    patch: Range | None = Field(
        None, description="the least and the greatest side of a patch in the picture of a scanner"
    )
    sight: SightEntry | None = Field(None, description="from where a scanner must see the patch")
    ranging: RangingEntry | None = Field(None, description="what a laser ranging tool is like")


class SensorEntry(Strict):
    """What a sensor reads: give one of `joint`, `force`, `load`, `distance` and `slip`."""

    joint: str | None = Field(None, description="the body whose way along its joint it reads")
    force: str | None = Field(None, description="the body against which something presses, in N")
    load: str | None = Field(
        None, description="the arm that carries the weight which it reads, in N"
    )
    distance: str | None = Field(
        None, description="the frame along whose z it reads how far the nearest thing is"
    )
    slip: str | None = Field(None, description="the body along which something slides, per second")
    readings: dict[str, Range] = Field(
        description="a reading, and the least and the greatest value that it has; the nearest one "
        "counts between two"
    )
    tells: dict[str, str] = Field(
        default_factory=dict,
        description="a reading, and the outcome of a test that it means, where that has another "
        "name",
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
    fixtures: dict[str, BodyEntry] = Field(
        default_factory=dict, description="bodies that never move"
    )
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
        description="a place of the domain, such as slot(drawer, 1), and the pose of the tool "
        "there",
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
    sensors: dict[str, SensorEntry] = Field(
        default_factory=dict, description="a sensor of the domain, and what it reads"
    )
