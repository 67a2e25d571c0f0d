"""The shapes of bodies: spheres, boxes, cylinders, plates, polyhedra, meshes. Metres."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from cellwright.kb.diagnostics import NOWHERE, Source

Vector = tuple[float, float, float]
MESH_SUFFIXES = (".stl", ".obj", ".dae")  # kinds of mesh files, by the ends of their names
MAX_MAGNITUDE = 1e6  # metres, radians or factors: no cell is larger, and sums are exact enough


@dataclass(frozen=True, slots=True)
class Pose:
    """A position, and roll, pitch and yaw about the fixed x, y and z axes, in that order: R =
    Rz(yaw) Ry(pitch) Rx(roll).
    """

    position_m: Vector = (0.0, 0.0, 0.0)
    rpy_rad: Vector = (0.0, 0.0, 0.0)


IDENTITY_POSE = Pose()
Offsets = tuple[
    Pose, ...
]  # poses taken one after the other, each in the frame of the one before; empty: no offset


@dataclass(frozen=True, slots=True)
class Sphere:
    """A ball about the origin."""

    radius_m: float


@dataclass(frozen=True, slots=True)
class Tube:
    """A cylinder along z with a half-sphere of the same radius at both ends.

    `length_m` is the distance between their centres.
    """

    radius_m: float
    length_m: float


@dataclass(frozen=True, slots=True)
class Box:
    """A rectangular block about the origin."""

    size_m: Vector


@dataclass(frozen=True, slots=True)
class Cylinder:
    """A flat-ended cylinder along z about the origin. Collision uses a prism around it."""

    radius_m: float
    length_m: float


@dataclass(frozen=True, slots=True)
class Ring:
    """A flat-ended cylinder along z about the origin, with a round bore of radius `inner_m` all
    the way through.
    """

    radius_m: float
    inner_m: float
    length_m: float


@dataclass(frozen=True, slots=True)
class Hole:
    """A round hole in a plate, along its z: where its middle is, and its radius."""

    at_m: tuple[float, float]
    radius_m: float


@dataclass(frozen=True, slots=True)
class Plate:
    """A rectangular block about the origin with round holes along z, each in a square of its
    own.
    """

    size_m: Vector
    holes: tuple[Hole, ...] = ()


@dataclass(frozen=True, slots=True)
class Face:
    """A named planar face: its vertices in order, counter-clockwise seen from outside."""

    name: str
    vertices: tuple[str, ...]
    where: Source = field(default=NOWHERE, compare=False)


@dataclass(frozen=True, slots=True)
class Edge:
    """A named edge between two vertices."""

    name: str
    vertices: tuple[str, str]


@dataclass(frozen=True, slots=True)
class Polyhedron:
    """Named vertices, faces and edges.

    `pieces` are the convex pieces that fill it (empty: it is convex itself).
    """

    vertices: Mapping[str, Vector]
    faces: tuple[Face, ...] = ()
    edges: tuple[Edge, ...] = ()
    pieces: tuple[tuple[str, ...], ...] = ()
    where: Source = field(default=NOWHERE, compare=False)


@dataclass(frozen=True, slots=True)
class Mesh:
    """An STL, OBJ or DAE file, scaled. Collision uses convex pieces that fill it."""

    path: str
    scale: Vector = (1.0, 1.0, 1.0)
    where: Source = field(default=NOWHERE, compare=False)


@dataclass(frozen=True, slots=True)
class HeightField:
    """Heights on a grid, solid down to `floor_m`; `heights_m[row][column]` is at (column * dx,
    row * dy).
    """

    spacing_m: tuple[float, float]
    heights_m: tuple[tuple[float, ...], ...]
    floor_m: float = 0.0
    where: Source = field(default=NOWHERE, compare=False)


@dataclass(frozen=True, slots=True)
class PointSet:
    """Points, each with a ball around it."""

    points_m: tuple[Vector, ...]
    radius_m: float


Shape = Sphere | Tube | Box | Cylinder | Ring | Plate | Polyhedron | Mesh | HeightField | PointSet


@dataclass(frozen=True, slots=True)
class PlacedShape:
    """A shape at a pose in the frame of its body, link or region."""

    shape: Shape
    pose: Pose = IDENTITY_POSE
