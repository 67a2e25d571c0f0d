"""What crosses the geometry port: jointed frames, convex pieces, pairs to be checked, and contacts. Metres, radians.

Frames that move are *carriers*. Carrier 0 is the world; carrier i (1..k) is what joint i-1 moves. Every piece stands
still in one carrier, so that the same scene serves arms, several arms, and bodies that fly free.
"""

from dataclasses import dataclass, field

from engine.kernels.arrays import Floats as Floats
from engine.kernels.arrays import Longs as Longs
from engine.kernels.arrays import Truths as Truths


@dataclass(frozen=True, slots=True, eq=False)
class Joints:
    """k joints as arrays: carrier i+1 stands at T_parent_origin(i) and moves about or along axis(i) of that frame."""

    parent: Longs  # (k,) the carrier that each joint stands on, less than i+1
    T_parent_origin: Floats  # (k, 4, 4)
    axis: Floats  # (k, 3) unit vectors
    prismatic: Truths  # (k,)
    lower: Floats  # (k,) rad or m
    upper: Floats  # (k,)

    @property
    def count(self) -> int:
        """How many joints, so how long a configuration is."""
        return int(self.parent.shape[0])


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """A convex piece: all points within `radius_m` of the hull of `vertices` (n, 3), given in its own frame.

    `body` is what a person calls it; `T_carrier_piece` (4, 4) puts it in carrier `carrier`. `box` tells that the
    vertices are those of a block about the origin, whose edges lie along the axes.
    """

    body: str
    carrier: int
    T_carrier_piece: Floats
    vertices: Floats
    radius_m: float
    box: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Everything that can touch: joints, pieces, and the pairs of pieces (m, 2) that must not.

    A free scene has no joints and one moving carrier (1), whose pose is asked about.
    """

    joints: Joints
    pieces: tuple[Piece, ...]
    pairs: Longs
    free: bool = False
    bodies: tuple[str, ...] = field(default=())

    @property
    def carriers(self) -> int:
        """How many carriers, the world included."""
        return 2 if self.free else self.joints.count + 1


@dataclass(frozen=True, slots=True, eq=False)
class Contact:
    """The nearest (or deepest) points of two bodies in the world frame.

    `distance_m` is negative when they overlap: then `-distance_m` is the shortest way to part them, along `normal`,
    the unit vector from the first to the second body. `point_first` and `point_second` (3,) lie on their surfaces.
    """

    first: str
    second: str
    distance_m: float
    point_first: Floats
    point_second: Floats
    normal: Floats

    @property
    def depth_m(self) -> float:
        """How far they overlap; 0 when they do not."""
        return max(0.0, -self.distance_m)
