"""Geometry: joints, convex pieces, collision scenes, contacts, and surfaces of parts.

Metres, radians. Frames that move are called carriers. Carrier 0 is the world; carrier i (1..k) is
the frame that joint i-1 moves. Every piece is fixed in one carrier. So one kind of scene serves for
one arm, several arms, and bodies that move freely.
"""

from dataclasses import dataclass, field

from cellwright.engine.kernels.arrays import Floats as Floats
from cellwright.engine.kernels.arrays import Longs as Longs
from cellwright.engine.kernels.arrays import Truths as Truths


@dataclass(frozen=True, slots=True, eq=False)
class Joints:
    """k joints as arrays.

    Carrier i+1 is at T_parent_origin(i) and moves about or along axis(i) of that frame.
    """

    parent: Longs  # (k,) the carrier that each joint stands on, less than i+1
    T_parent_origin: Floats  # (k, 4, 4)
    axis: Floats  # (k, 3) unit vectors
    prismatic: Truths  # (k,)
    lower: Floats  # (k,) rad or m
    upper: Floats  # (k,)

    @property
    def count(self) -> int:
        """The number of joints, which is the length of a configuration."""
        return int(self.parent.shape[0])


@dataclass(frozen=True, slots=True, eq=False)
class ConvexPiece:
    """A convex piece: all points within `radius_m` of the hull of `vertices` (n, 3), given in its
    own frame.

    `body` is the name that people use. `T_carrier_piece` (4, 4) is its pose in carrier `carrier`.
    With `box` the vertices are those of a block about the origin, with edges along the axes.
    """

    body: str
    carrier: int
    T_carrier_piece: Floats
    vertices: Floats
    radius_m: float
    box: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class CollisionScene:
    """Everything that can touch: joints, pieces, and the pairs of pieces (m, 2) that must not
    touch.

    A free scene has no joints and one moving carrier (number 1). Its pose is given in place of a
    configuration.
    """

    joints: Joints
    pieces: tuple[ConvexPiece, ...]
    pairs: Longs
    free: bool = False
    bodies: tuple[str, ...] = field(default=())

    @property
    def carriers(self) -> int:
        """The number of carriers, the world included."""
        return 2 if self.free else self.joints.count + 1


@dataclass(frozen=True, slots=True, eq=False)
class Contact:
    """The nearest (or deepest) points of two bodies in the world frame.

    `distance_m` is negative if the bodies overlap: then `-distance_m` is the shortest displacement
    that separates them. It is along `normal`, the unit vector from the first body to the second.
    `point_first` and `point_second` (3,) lie on the surfaces of the bodies.
    """

    first: str
    second: str
    distance_m: float
    point_first: Floats
    point_second: Floats
    normal: Floats

    @property
    def depth_m(self) -> float:
        """How far the bodies overlap; 0 if they do not."""
        return max(0.0, -self.distance_m)


@dataclass(frozen=True, slots=True, eq=False)
class Facet:
    """A plane piece of a surface: the points x with normal . x = offset, inside the `edges`.

    `edges` (e, 2, 3) run counter-clockwise seen from outside; those around a hole run the other
    way. `convex` (e,) says where the next facet falls back.
    """

    name: str
    normal: Floats
    offset: float
    edges: Floats
    convex: Truths


@dataclass(frozen=True, slots=True, eq=False)
class Solid:
    """A part's surface in its own frame: corners (m, 3, 3) of triangles, and the number of each
    one's facet (m,).
    """

    name: str
    corners: Floats
    facet_of: Longs
    facets: tuple[Facet, ...]

    @property
    def vertices(self) -> Floats:
        """The corners of all triangles (3 m, 3)."""
        vertices: Floats = self.corners.reshape(-1, 3)
        return vertices
