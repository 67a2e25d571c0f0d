"""Values of grasping: grippers, grasps, placements, regrasps and approaches. Metres, radians, newtons.

A hand's frame lies between its finger tips: x is the direction in which the jaws close, z points from the hand to the part.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from cellwright.engine.model.geometry import Floats, Truths


@dataclass(frozen=True, slots=True)
class _Fingers:
    """What hands have in common: fingers, and behind them a cross-piece and a force sensor.

    The tips are square pads of side `pad_m`; fingers are `finger_m` long, and as thick as `thick_m` in the closing direction.
    `cross_m` and `sensor_m` are extents along x, y and z. `friction` and `force_n` are those of each pad.
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
        """Middles (4, 3) and half extents (4, 3) of the fingers, cross-piece and sensor, opened for a width and a clearance."""
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
    """A hand with a palm and three round fingers of diameter `thick_m` that close one by one, as Barrett's.

    One finger comes from -x. The others stand `thick_m` to both sides of the x axis and come from +x, each turned outwards by the
    spread: at 0 they are parallel, at 60 degrees all three come from evenly around. Otherwise it is as `ParallelJaws`.
    """

    spreads_rad: tuple[float, ...] = tuple(math.radians(each) for each in (0, 15, 30, 45, 60))

    def ways(self, spread_rad: float) -> tuple[Floats, Floats]:
        """Where the fingers' ways begin (3, 2), and the outward directions (3, 2) in which they open, in the plane of x and y."""
        c, s = math.cos(spread_rad), math.sin(spread_rad)
        begins = np.array([(0.0, 0.0), (0.0, self.thick_m), (0.0, -self.thick_m)])
        return begins, np.array([(-1.0, 0.0), (c, s), (c, -s)])

    def blocks(self, opening: Sequence[float]) -> tuple[Floats, Floats]:
        """Middles (5, 3) and half extents (5, 3) of blocks around fingers, palm and sensor.

        `opening` is the width, the way of each finger (m) and the spread (rad).
        """
        begins, outwards = self.ways(opening[4])
        tips = begins + outwards * (np.array(opening[1:4]) + self.clearance_m + self.thick_m / 2)[:, None]
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
    """Two parallel facets held at opposite points, about whose line the hand may turn; or three facets, held by three fingers.

    `T_part_hand` (n, 4, 4) are the hand's poses at the turns that were looked at, evenly spread over a whole turn, and `free`
    (n,) says at which the hand touches nothing but the two facets. `torque_margin` is the torque that the pads hold over that
    of the weight, at its worst; of three fingers, how many times the weight they hold, whichever way it pulls.
    """

    facets: tuple[str, ...]
    width_m: float
    T_part_hand: Floats
    free: Truths
    torque_margin: float
    fingers: tuple[float, ...] = ()

    @property
    def opening(self) -> tuple[float, ...]:
        """How the hand is opened: the width, and what three fingers have beside it (`ThreeFingers.blocks`)."""
        return (self.width_m, *self.fingers)


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """A way in which a part lies on a table: `T_table_part` (4, 4) up to turns about the vertical and shifts.

    Its middle is above the origin. `margin_m` is how far the centre of mass is inside the edge over which it would tip.
    """

    facet: str
    T_table_part: Floats
    margin_m: float


@dataclass(frozen=True, slots=True)
class Regrasps:
    """How a part gets from start to goal: the number of the first hold, then each placement and the hold that follows it."""

    first: int
    then: tuple[tuple[int, int], ...]


@dataclass(frozen=True, slots=True)
class Unplaceable:
    """No sequence of placements leads to the goal: from the start `reached` holds can be had, and none of `needed` is one."""

    reached: tuple[int, ...]
    needed: tuple[int, ...]


RegraspAnswer: TypeAlias = Regrasps | Unplaceable


@dataclass(frozen=True, slots=True, eq=False)
class Approach:
    """A way of the hand in the grasp plane: poses (n, 3) as y, z and the turn about the closing direction."""

    poses: Floats


@dataclass(frozen=True, slots=True, eq=False)
class NoApproach:
    """There is none, as `reason` tells; `reached` (3,) is where the search ended nearest to the grasp."""

    reason: str
    reached: Floats


ApproachAnswer: TypeAlias = Approach | NoApproach
