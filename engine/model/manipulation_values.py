"""Manipulation: relations between features of parts, grippers, grasps and placements."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import TypeAlias

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Truths


class FeatureKind(Enum):
    """What a feature is geometrically: a face lies in a plane; edges and axes lie on lines;
    vertices and centres are points.
    """

    PLANE = "plane"
    LINE = "line"
    POINT = "point"


class RelationKind(Enum):
    """What may be said of two features."""

    PARALLEL = "parallel"
    AGAINST = "against"
    COPLANAR = "coplanar"
    ALIGNED = "aligned"
    FITS = "fits"
    CONCENTRIC = "concentric"
    DISTANCE = "distance"
    ANGLE = "angle"


@dataclass(frozen=True, slots=True, eq=False)
class PartFeature:
    """A feature in the frame of its part.

    It passes through `point` (3,). `direction` (3,) is the unit vector of a line, or the outward
    normal of a plane; zero for a point.
    """

    part: str
    name: str
    kind: FeatureKind
    point: Floats
    direction: Floats

    def __str__(self) -> str:
        return f"{self.part}.{self.name}"


@dataclass(frozen=True, slots=True, eq=False)
class Relation:
    """`kind` holds between two features; `value` is in metres or radians where the kind takes one.

    A preferred relation holds as far as the others allow.
    """

    kind: RelationKind
    first: PartFeature
    second: PartFeature
    value: float = 0.0
    preferred: bool = False

    def __str__(self) -> str:
        return f"{self.first} {self.kind.value} {self.second}"


@dataclass(frozen=True, slots=True, eq=False)
class Freedom:
    """A way in which a part may still move in the base's frame: `pitch_m` metres along a line for
    each radian about it.

    The line has a unit `direction` (3,) and passes through `point` (3,). A pitch of 0 is a turn, an
    infinite one a slide.
    """

    part: str
    direction: Floats
    point: Floats
    pitch_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Assembled:
    """Poses T_base_part (4, 4) with which all relations hold.

    `degrees` counts how many numbers are still free, for all parts together; `freedoms` lists the
    ways of each part. `redundant` can all be left out, and nothing changes. `others` are further
    solutions, none reached from another by the free numbers; each is a mapping as `poses`.
    `residual` is what the worst equation lacks, with lengths over the size of the parts.
    """

    poses: Mapping[str, Floats]
    degrees: int
    freedoms: tuple[Freedom, ...]
    redundant: tuple[Relation, ...]
    others: tuple[Mapping[str, Floats], ...]
    residual: float


@dataclass(frozen=True, slots=True, eq=False)
class RelationContradiction:
    """Relations that cannot hold together. No smaller set of those given is contradictory."""

    relations: tuple[Relation, ...]


AssemblyAnswer: TypeAlias = Assembled | RelationContradiction


@dataclass(frozen=True, slots=True)
class _Fingers:
    """What hands have in common: fingers, and behind them a cross-piece and a force sensor.

    The tips are square pads of side `pad_m`; fingers are `finger_m` long, and as thick as `thick_m`
    in the closing direction. `cross_m` and `sensor_m` are extents along x, y and z. `friction` and
    `force_n` are those of each pad.
    """

    opening_m: float
    pad_m: float
    finger_m: float
    thick_m: float
    cross_m: tuple[float, float, float]
    sensor_m: tuple[float, float, float]
    friction: float = 0.4
    force_n: float = 40.0
    clearance_m: float = 0.004


@dataclass(frozen=True, slots=True)
class ParallelJaws(_Fingers):
    """A gripper with two parallel fingers, all of its parts blocks."""

    def blocks(self, opening: Sequence[float]) -> tuple[Floats, Floats]:
        """Middles (4, 3) and half extents (4, 3) of the fingers, cross-piece and sensor, opened
        for a width and a clearance.
        """
        half, pad = opening[0] / 2 + self.clearance_m + self.thick_m / 2, self.pad_m / 2
        back = pad - self.finger_m
        finger = (self.thick_m / 2, pad, self.finger_m / 2)
        middles = [
            (-half, 0.0, pad - self.finger_m / 2),
            (half, 0.0, pad - self.finger_m / 2),
            (0.0, 0.0, back - self.cross_m[2] / 2),
            (0.0, 0.0, back - self.cross_m[2] - self.sensor_m[2] / 2),
        ]
        halves = [finger, finger, np.array(self.cross_m) / 2, np.array(self.sensor_m) / 2]
        return np.array(middles), np.array(halves)


@dataclass(frozen=True, slots=True)
class ThreeFingers(_Fingers):
    """A hand with a palm and three round fingers of diameter `thick_m` that close one by one, as
    Barrett's.

    One finger comes from -x. The others stand `thick_m` to both sides of the x axis and come from
    +x, each turned outwards by the spread: at 0 they are parallel, at 60 degrees all three come
    from evenly around. Otherwise it is as `ParallelJaws`.
    """

    spreads_rad: tuple[float, ...] = tuple(math.radians(degrees) for degrees in (0, 15, 30, 45, 60))

    def ways(self, spread_rad: float) -> tuple[Floats, Floats]:
        """Where the fingers' ways begin (3, 2), and the outward directions (3, 2) in which they
        open, in the plane of x and y.
        """
        c, s = math.cos(spread_rad), math.sin(spread_rad)
        begins = np.array([(0.0, 0.0), (0.0, self.thick_m), (0.0, -self.thick_m)])
        return begins, np.array([(-1.0, 0.0), (c, s), (c, -s)])

    def blocks(self, opening: Sequence[float]) -> tuple[Floats, Floats]:
        """Middles (5, 3) and half extents (5, 3) of blocks around fingers, palm and sensor.

        `opening` is the width, the way of each finger (m) and the spread (rad).
        """
        begins, outwards = self.ways(opening[4])
        tips = (
            begins
            + outwards * (np.array(opening[1:4]) + self.clearance_m + self.thick_m / 2)[:, None]
        )
        back = self.pad_m / 2 - self.finger_m
        fingers = np.column_stack([tips, np.full(3, self.pad_m / 2 - self.finger_m / 2)])
        palm = [
            (0.0, 0.0, back - self.cross_m[2] / 2),
            (0.0, 0.0, back - self.cross_m[2] - self.sensor_m[2] / 2),
        ]
        finger = np.array([self.thick_m / 2, self.thick_m / 2, self.finger_m / 2])
        halves = np.array([*[finger] * 3, np.array(self.cross_m) / 2, np.array(self.sensor_m) / 2])
        return np.concatenate([fingers, palm]), halves


@dataclass(frozen=True, slots=True, eq=False)
class Grasp:
    """Two parallel facets held at opposite points, about whose line the hand may turn; or three
    facets, held by three fingers.

    `T_part_hand` (n, 4, 4) are the hand's poses at the turns that were looked at, evenly spread
    over a whole turn, and `free` (n,) says at which the hand touches nothing but the two facets.
    `torque_margin` is the torque that the pads hold over that of the weight, at its worst; of three
    fingers, how many times the weight they hold, whichever way it pulls.
    """

    facets: tuple[str, ...]
    width_m: float
    T_part_hand: Floats
    free: Truths
    torque_margin: float
    fingers: tuple[float, ...] = ()

    @property
    def opening(self) -> tuple[float, ...]:
        """How the hand is opened: the width, and what three fingers have beside it
        (`ThreeFingers.blocks`).
        """
        return (self.width_m, *self.fingers)


@dataclass(frozen=True, slots=True, eq=False)
class TablePlacement:
    """A way in which a part lies on a table: `T_table_part` (4, 4) up to turns about the vertical
    and shifts.

    Its middle is above the origin. `margin_m` is how far the centre of mass is inside the edge over
    which it would tip.
    """

    facet: str
    T_table_part: Floats
    margin_m: float


@dataclass(frozen=True, slots=True)
class Regrasps:
    """How a part gets from start to goal: the number of the first hold, then each placement and
    the hold that follows it.
    """

    first: int
    then: tuple[tuple[int, int], ...]


@dataclass(frozen=True, slots=True)
class Unplaceable:
    """No sequence of placements leads to the goal: from the start `reached` holds can be had,
    and none of `needed` is one.
    """

    reached: tuple[int, ...]
    needed: tuple[int, ...]


RegraspAnswer: TypeAlias = Regrasps | Unplaceable


@dataclass(frozen=True, slots=True, eq=False)
class HandApproach:
    """A way of the hand in the grasp plane: poses (n, 3) as y, z and the turn about the closing
    direction.
    """

    poses: Floats


@dataclass(frozen=True, slots=True, eq=False)
class NoApproach:
    """There is none, as `reason` tells; `reached` (3,) is where the search ended nearest to the
    grasp.
    """

    reason: str
    reached: Floats


ApproachAnswer: TypeAlias = HandApproach | NoApproach
