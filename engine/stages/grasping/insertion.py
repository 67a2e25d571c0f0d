"""Insertion with a sense of force: a guarded approach, and a spiral that searches for the hole while the part is pressed down.

The controller is a table of phases with one `advance`. It reads positions and forces, and says where the hand shall go next and
how hard it shall press; it moves nothing and reads no clock. The spiral is that of Chhatpar & Branicky (2001): its turns are so
near to each other that one of them leads over the hole, whatever its direction.
"""

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from engine.model.geometry import Floats

TOUCH_N = 3.0  # a force that means contact
SIGMAS = 3.0


@dataclass(frozen=True, slots=True)
class Insertion:
    """A part goes into a hole along -z: how deep, with how much room on each side, and how far off it may be, in metres.
    Heights count from where its rim is believed to be.

    Without `searches` the hand goes straight down. Speeds are in metres in a second, the force in newtons.
    """

    depth_m: float
    room_m: float
    doubt_m: float
    searches: bool
    press_n: float = 8.0
    down_m_s: float = 0.02
    along_m_s: float = 0.006

    @property
    def pitch_m(self) -> float:
        """How far apart the turns of the spiral are: a path within `room_m` of the middle leads into the hole."""
        return 1.5 * self.room_m


def planned(depth_m: float, room_m: float, covariance: Floats) -> Insertion:
    """The insertion for a room on each side and the covariance (2, 2) of where the hole is: a search where three sigma exceed it."""
    doubt = SIGMAS * float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))
    return Insertion(depth_m, room_m, doubt, doubt > room_m)


class Phase(Enum):
    """What is done at the moment."""

    APPROACH = "approach"
    SEARCH = "search"
    INSERT = "insert"
    DONE = "done"
    FAILED = "failed"


@dataclass(frozen=True, slots=True, eq=False)
class Inserting:
    """The phase, where the hand is told to go (3,), how hard it presses, where contact was (3,), and how far round the spiral is."""

    phase: Phase
    target: Floats
    press_n: float = 0.0
    contact: Floats | None = None
    turned_rad: float = 0.0


def begun(at: Floats) -> Inserting:
    """Above the place where the hole is believed to be, at (3,)."""
    return Inserting(Phase.APPROACH, at)


def advance(plan: Insertion, now: Inserting, at: Floats, force_n: float, dt_s: float) -> Inserting:
    """What comes next when the part is at a place (3,) and is pushed up with a force."""
    match now.phase:
        case Phase.APPROACH:
            return _approached(plan, now, at, force_n, dt_s)
        case Phase.SEARCH:
            return _searched(plan, now, at, dt_s)
        case Phase.INSERT:
            return _inserted(plan, now, at)
        case _:
            return now


def _approached(plan: Insertion, now: Inserting, at: Floats, force_n: float, dt_s: float) -> Inserting:
    """Down, until something is touched: the surface is there, and the hole as deep below it. What touches nothing goes right in."""
    if at[2] < -0.95 * plan.depth_m:
        return replace(now, phase=Phase.DONE)
    if force_n < TOUCH_N:
        return replace(now, target=now.target - [0.0, 0.0, plan.down_m_s * dt_s])
    phase = Phase.SEARCH if plan.searches else Phase.INSERT
    return Inserting(phase, now.target, plan.press_n, at.copy())


def _searched(plan: Insertion, now: Inserting, at: Floats, dt_s: float) -> Inserting:
    """Round the spiral while it presses, until the part drops by more than it can by leaning."""
    assert now.contact is not None
    if at[2] < now.contact[2] - max(plan.room_m * 4, 0.0005):
        return replace(now, phase=Phase.INSERT, target=np.array([at[0], at[1], now.target[2]]))
    a = plan.pitch_m / (2 * np.pi)
    radius = a * now.turned_rad
    if radius > plan.doubt_m + plan.pitch_m:
        return replace(now, phase=Phase.FAILED)
    turned = now.turned_rad + plan.along_m_s * dt_s / max(radius, 2 * a)
    offset = a * turned * np.array([np.cos(turned), np.sin(turned)])
    return replace(now, turned_rad=turned, target=np.array([*(now.contact[:2] + offset), now.target[2]]))


def _inserted(plan: Insertion, now: Inserting, at: Floats) -> Inserting:
    """The hand presses, and gives way to the sides; the part is in when it is as deep as it should be."""
    assert now.contact is not None
    deep = at[2] < min(now.contact[2], 0.0) - 0.95 * plan.depth_m
    sideways = at[:2] if plan.searches else now.target[:2]
    return replace(now, phase=Phase.DONE if deep else now.phase, target=np.array([*sideways, now.target[2]]))
