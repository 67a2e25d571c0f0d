"""The cell: arms, frames, bodies, regions, places, scanners and sensors. Metres and radians.

A frame's location is a `Placement`: the pose `T_parent_frame` in a named parent. Nothing is
computed here; `cellwright.engine.stages.geometry` computes collisions and reach.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

from cellwright.kb.diagnostics import NOWHERE, Source
from cellwright.kb.model.body_shapes import IDENTITY_POSE, Offsets, PlacedShape, Pose, Shape, Vector
from cellwright.kb.model.domain_model import WORLD_FRAME
from cellwright.kb.terms import Atom, Function, Term


@dataclass(frozen=True, slots=True)
class Ranging:
    """A tool that scans a picture with a beam of modulated light, and measures its phase after the
    way there and back.

    `eye` is the feature of the tool that it looks from, along z. The picture is `width` by `height`
    pixels and `view_rad` wide. A range is known modulo half of `wavelength_m`. `noise_m` is its
    standard deviation on a surface square to the beam at `at_m`; it is the noise of the signal by
    its strength, so it grows with the square of the range and with the incidence. `beam_rad` is the
    full divergence of the beam (where the intensity is 1/e^2), `pointing_rad` the standard
    deviation of its direction across either axis. There is no answer where the signal is weaker
    than that at `at_m` of a surface seen at `grazing_rad`, and none from a share `dropouts` of the
    pixels.
    """

    eye: str
    width: int
    height: int
    view_rad: float
    wavelength_m: float
    noise_m: float
    at_m: float
    beam_rad: float
    pointing_rad: float = 0.0
    grazing_rad: float = 1.3962634015954636
    dropouts: float = 0.0


class Sensing(Enum):
    """What a sensor reads."""

    JOINT = "joint"  # how far a body is along its joint (m or rad)
    FORCE = "force"  # how hard something presses against a body (N)
    LOAD = "load"  # how heavy what an arm holds is on its hand (N)
    DISTANCE = "distance"  # how far the nearest thing is along z of a frame (m)
    SLIP = "slip"  # how fast what touches a body slides along it (m/s)


@dataclass(frozen=True, slots=True)
class Sensor:
    """A sensor reads something `of` a body, arm or frame. A reading is the range (least, greatest)
    that the value lies in.

    `tells` names the outcome of a test by a reading, where the two have different names.
    """

    sensing: Sensing
    of: str
    readings: Mapping[str, tuple[float, float]]
    tells: Mapping[str, str] = field(default_factory=dict)


# how deep things may overlap that touch by intention, unless the place says otherwise
TOUCH_DEPTH_M = 0.005
ZONE_SPEED_M_S = 0.25  # near people, unless the zone says otherwise (ISO 10218: reduced speed)


class JointKind(Enum):
    """How a joint moves along or about its axis."""

    REVOLUTE = "revolute"
    PRISMATIC = "prismatic"


@dataclass(frozen=True, slots=True)
class Mimic:
    """The value of a joint is `multiplier` times that of another one, and `offset` more."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, slots=True)
class Inertia:
    """Mass in kg, the pose of the centre of mass, and the moments xx, xy, xz, yy, yz, zz in kg
    m^2 about its axes.
    """

    mass_kg: float
    centre: Pose = IDENTITY_POSE
    moments: tuple[float, float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Joint:
    """A moving joint: first the fixed `origin` in the frame of the joint before, then the motion
    about or along `axis`.

    Limits are in rad or m, speed is per second, acceleration per second squared, effort in N m or
    N. None means unknown. A joint with `mimic` follows another one.
    """

    name: str
    origin: Offsets = ()
    axis: Vector = (0.0, 0.0, 1.0)
    kind: JointKind = JointKind.REVOLUTE
    lower: float = float("-inf")
    upper: float = float("inf")
    speed: float | None = None
    acceleration: float | None = None
    effort: float | None = None
    mimic: "Mimic | None" = None


@dataclass(frozen=True, slots=True)
class Link:
    """A rigid link.

    The first `carrier` joints move it (0: it stands still); `offset` leads from the last of them to
    its frame.
    """

    name: str
    carrier: int
    offset: Offsets = ()
    shapes: tuple[PlacedShape, ...] = ()
    inertia: Inertia | None = None


@dataclass(frozen=True, slots=True)
class Arm:
    """A serial arm. `flange` leads from the last joint to the mounting face.

    `assumptions` list values that are not published.
    """

    name: str
    joints: tuple[Joint, ...]
    links: tuple[Link, ...] = ()
    flange: Offsets = ()
    # pairs of links that may touch, or that can never touch
    allowed: frozenset[frozenset[str]] = frozenset()
    assumptions: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Placement:
    """Where a frame is: `pose` is T_parent_frame."""

    parent: str = WORLD_FRAME
    pose: Pose = IDENTITY_POSE
    where: Source = field(default=NOWHERE, compare=False)


@dataclass(frozen=True, slots=True)
class MountedArm:
    """An arm in a cell: where its base stands, the tool point after its flange, and a
    configuration to rest in.
    """

    arm: Arm
    base: Placement = Placement()
    tool: Pose = IDENTITY_POSE
    home: tuple[float, ...] = ()
    where: Source = field(default=NOWHERE, compare=False)


class BodyKind(Enum):
    """What a body is for."""

    FIXTURE = "fixture"
    PART = "part"
    TOOL = "tool"


@dataclass(frozen=True, slots=True)
class Guide:
    """How a body moves on what it stands on: along or about `axis`, in its own frame, from `lower`
    to `upper` (m or rad).

    At 0 it is where the file places it. With `follows` it always goes as far as that body.
    """

    kind: JointKind
    axis: Vector
    lower: float
    upper: float
    follows: str = ""


@dataclass(frozen=True, slots=True)
class Body:
    """A solid thing: its shapes, where it is at the start, and named poses on it (such as where to
    grip it, or its tip). With a `guide` it slides or swings on what it stands on.
    """

    name: str
    kind: BodyKind
    placement: Placement = Placement()
    shapes: tuple[PlacedShape, ...] = ()
    features: Mapping[str, Pose] = field(default_factory=dict)
    guide: Guide | None = None
    mass_kg: float | None = None
    friction: float | None = None


@dataclass(frozen=True, slots=True)
class Region:
    """A region of the region tree. It lies within the union of its parents (none: a root).

    Solid leaves stand for real things.
    """

    name: str
    shape: Shape
    placement: Placement = Placement()
    parents: tuple[str, ...] = ()
    solid: bool = False
    where: Source = field(default=NOWHERE, compare=False)


@dataclass(frozen=True, slots=True)
class Zone:
    """A space in which people may be: while an arm is in it, no point of the arm moves faster
    than `speed_m_s`.
    """

    name: str
    shape: Shape
    placement: Placement
    speed_m_s: float


@dataclass(frozen=True, slots=True)
class Place:
    """The meaning of a place in an atom: the pose that an arm's tool point takes there.

    With `tool`, a body in the hand, the feature `tip` of that body takes the pose instead.
    `approach_m` backs off along the tool's z. `turns` lets the tool turn about its own z. `touches`
    are the bodies that may be in contact there, overlapping by at most `depth_m`.
    """

    name: str
    placement: Placement
    arm: str
    tool: str = ""
    approach_m: float = 0.0
    turns: bool = False
    touches: tuple[str, ...] = ()
    depth_m: float = TOUCH_DEPTH_M
    patch_m: float = 0.0  # the side of what a scanner must see there; 0: the least that it measures
    surface: Placement | None = None  # what is measured lies in its plane, where the tool leans


@dataclass(frozen=True, slots=True)
class Location:
    """Where a fact puts a body: its feature `by` (else `grip`, else its own frame) takes the pose
    of a place, or of a frame.

    With `value` (m or rad) the body goes that far along its guide instead. `body` and `place` are
    terms, and `frame` is the name of a frame. All three may contain variables of the fact.
    """

    fact: Atom
    body: Term
    place: Term | None = None
    frame: str = ""
    where: Source = field(default=NOWHERE, compare=False)
    value: float | None = None
    by: str = ""


class Ends(Enum):
    """Where the arm is after a step: back before the place, in it, or before it without having
    been in it.
    """

    OUTSIDE = "outside"
    INSIDE = "inside"
    BEFORE = "before"


@dataclass(frozen=True, slots=True)
class Operation:
    """What an arm does in a step of an operator: `operator` is its name with variables.

    The arm goes to the place `at`; there it takes or leaves what the facts after the step say, and
    moves the body `drags` along its guide. `drives` is a body that moves the arm, at rest, along
    its guide. `takes_s` is spent at the place. Another arm is at the place `with_place` meanwhile:
    it goes there first and leaves last. Both carry the body `carries` together from there.
    After `at` the arm goes to the places `then`, one after the other.
    """

    operator: Function
    at: Term | None = None
    ends: Ends = Ends.OUTSIDE
    drags: str = ""
    drives: str = ""
    takes_s: float = 0.0
    where: Source = field(default=NOWHERE, compare=False)
    with_place: Term | None = None
    carries: Term | None = None
    then: tuple[Term, ...] = ()

    @property
    def stops(self) -> tuple[Term, ...]:
        """The places in their order."""
        return () if self.at is None else (self.at, *self.then)


@dataclass(frozen=True, slots=True)
class Patch:
    """A rectangle in the picture of a scanner: where its middle is and how large it is, across
    the field of view (m).
    """

    at_m: tuple[float, float]
    size_m: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Sight:
    """From where a scanner sees a patch: each of its `eyes`, features of the tool, from `range_m`
    (least, greatest), at most `incidence_rad` off the normal, with nothing in between. It looks
    while it is `back_m` off the place along its z.
    """

    eyes: tuple[str, ...]
    range_m: tuple[float, float]
    incidence_rad: float
    back_m: float = 0.0


@dataclass(frozen=True, slots=True)
class Measuring:
    """How a tool takes a measurement that has a position, but no place of its own.

    `approach_m` is how far it backs off along its z, `touches` are the bodies that it may touch.
    `tilts_rad` are the angles to the normal that are allowed, those that are preferred first.
    `field_m` is the width of what a scanner sees, `patch_m` the least and the greatest side of a
    patch. `ranging` is what a laser ranging tool is like.
    """

    approach_m: float = 0.0
    touches: tuple[str, ...] = ()
    tilts_rad: tuple[float, ...] = (0.0,)
    field_m: float = 0.0
    patch_m: tuple[float, float] = (0.0, 0.0)
    sight: Sight | None = None
    ranging: Ranging | None = None


@dataclass(frozen=True, slots=True)
class Cell:
    """A cell. Mappings keep the order of declaration."""

    name: str
    arms: Mapping[str, MountedArm] = field(default_factory=dict)
    frames: Mapping[str, Placement] = field(default_factory=dict)
    bodies: Mapping[str, Body] = field(default_factory=dict)
    regions: Mapping[str, Region] = field(default_factory=dict)
    allowed: frozenset[frozenset[str]] = frozenset()
    places: Mapping[str, Place] = field(default_factory=dict)
    locations: tuple[Location, ...] = ()
    zones: Mapping[str, Zone] = field(default_factory=dict)
    operations: tuple[Operation, ...] = ()
    measuring: Mapping[str, Measuring] = field(default_factory=dict)
    sensors: Mapping[str, Sensor] = field(default_factory=dict)
    path: str = ""


def place_position(cell: Cell, place: str, frame: str = WORLD_FRAME) -> Vector | None:
    """The point of a place in a frame of the cell; None if there is no such place, or if an arm
    moves one of them.
    """
    if place not in cell.places:
        return None
    at = cell.places[place].placement
    own, theirs = _to_world(cell, at), () if frame == WORLD_FRAME else _poses_to_world(cell, frame)
    if own is None or theirs is None:
        return None
    point = (0.0, 0.0, 0.0)
    for pose in own:
        point = _to_parent(pose, point)
    for pose in reversed(theirs):
        point = _from_parent(pose, point)
    return point


def is_fixed(cell: Cell, frame: str) -> bool:
    """Whether a cell has a frame of this name that no arm moves."""
    return frame == WORLD_FRAME or _poses_to_world(cell, frame) is not None


def _to_world(cell: Cell, at: Placement) -> tuple[Pose, ...] | None:
    """The poses that lead from a placement to the world, the innermost first."""
    above = () if at.parent == WORLD_FRAME else _poses_to_world(cell, at.parent)
    return None if above is None else (at.pose, *above)


def _poses_to_world(cell: Cell, frame: str) -> tuple[Pose, ...] | None:
    """The poses that lead from a frame to the world; None if the frame moves, or if there is
    none of its name.
    """
    owner, _, part = frame.partition(".")
    if frame in cell.frames:
        return _to_world(cell, cell.frames[frame])
    if owner in cell.arms:
        return _to_world(cell, cell.arms[owner].base) if part == "base" else None
    if owner not in cell.bodies or (part and part not in cell.bodies[owner].features):
        return None
    below = _to_world(cell, cell.bodies[owner].placement)
    if below is None or not part:
        return below
    return (cell.bodies[owner].features[part], *below)


def _to_parent(pose: Pose, point: Vector) -> Vector:
    """A point in a frame, seen from the parent of the frame: R = Rz(yaw) Ry(pitch) Rx(roll),
    then the position.
    """
    x, y, z = point
    roll, pitch, yaw = pose.rpy_rad
    y, z = _turn_coordinates(y, z, roll)
    z, x = _turn_coordinates(z, x, pitch)
    x, y = _turn_coordinates(x, y, yaw)
    a, b, c = pose.position_m
    return (x + a, y + b, z + c)


def _from_parent(pose: Pose, point: Vector) -> Vector:
    """A point in the parent of a frame, seen from the frame."""
    x, y, z = (value - own for value, own in zip(point, pose.position_m, strict=True))
    roll, pitch, yaw = pose.rpy_rad
    x, y = _turn_coordinates(x, y, -yaw)
    z, x = _turn_coordinates(z, x, -pitch)
    y, z = _turn_coordinates(y, z, -roll)
    return (x, y, z)


def _turn_coordinates(first: float, second: float, angle: float) -> tuple[float, float]:
    """Two coordinates after a turn from the first axis to the second one."""
    cosine, sine = math.cos(angle), math.sin(angle)
    return cosine * first - sine * second, sine * first + cosine * second
