"""Insertion of a part into a hole with a sense of force: approach, search and push, step by step.

The controller is a table of phases with one `advance`. It reads positions and forces, and says
where the hand shall go next and how hard it shall press; it moves nothing and reads no clock. The
spiral is that of Chhatpar & Branicky (2001): its turns are so near to each other that one of them
leads over the hole, whatever its direction. A part that is tilted enters the hole with its lowest
edge wherever that is over it; it is led against the far wall, and set upright there (Inoue 1974).
"""

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from cellwright.engine.kernels.arrays import Floats

TOUCH_N = 3.0  # a force that means contact
SEARCH_SIGMAS = 3.0
MAX_LEAN_RAD = 0.2  # of a part that is tilted
TURN_RAD_S = 0.25
INSIDE_SIGMAS = 2.0  # times what is doubted, that the lowest edge is set down inside the far wall
LAG_M = 0.0006  # how far a hand that is led against a wall lags behind
TILTING_S = 3.0  # what a search by tilting takes, about
# a part that has not got so much deeper for so long is not in its hole
LOWER_M, STUCK_S = 0.0003, 0.5
DONE_DEPTH_SHARE = 0.95  # of the depth: a part this deep is in
DROPPED_M, DROPPED_ROOMS = (
    0.0005,
    4,
)  # a part that drops by more than this, and than this many rooms, does not only lean
# how fast a part that is pressed may creep between the fingers: what drops is faster
CREEP_M_S = 0.0003
TILT_ABOVE_M = 0.003  # how far over the surface a part is tilted


class HoleSearch(Enum):
    """How a hole is searched for."""

    NONE = "none"
    SPIRAL = "spiral"
    TILT = "tilt"


@dataclass(frozen=True, slots=True)
class Insertion:
    """A part goes into a hole along -z: how deep, with how much room (above 0) on each side, and
    how far off it may be, in metres.

    Heights count from where the rim is believed to be. Without a search the hand goes straight
    down. Speeds are in metres in a second, the force in newtons. For a search by tilting,
    `radius_m` is that of the part, and `length_m` how far its end is from the wrist, about which it
    tilts.
    """

    depth_m: float
    room_m: float
    doubt_m: float
    search: HoleSearch
    radius_m: float = 0.0
    length_m: float = 0.0
    press_n: float = 8.0
    down_m_s: float = 0.02
    along_m_s: float = 0.006

    @property
    def pitch_m(self) -> float:
        """How far apart the turns of the spiral are: a path within `room_m` of the middle leads
        into the hole.
        """
        return 1.5 * self.room_m

    @property
    def spiral_s(self) -> float:
        """How long the whole spiral takes."""
        return float(np.pi * self.doubt_m**2 / self.pitch_m / self.along_m_s)

    @property
    def drop_m(self) -> float:
        """How far a part drops that is over its hole, and does not only lean."""
        return max(self.room_m * DROPPED_ROOMS, DROPPED_M)

    def edge_m(self, lean_rad: float) -> float:
        """How far before the wrist, across, the lowest edge of a part is that is tilted so far."""
        return float(self.radius_m * np.cos(lean_rad) - self.length_m * np.sin(lean_rad))


def plan_insertion(
    depth_m: float, room_m: float, covariance: Floats, radius_m: float = 0.0, length_m: float = 0.0
) -> Insertion:
    """The insertion for a room on each side and the covariance (2, 2) of where the hole is: a
    search where three sigma exceed it.

    A round part is tilted if that is quicker than the spiral, and sure to set its edge down inside
    the hole.
    """
    doubt = SEARCH_SIGMAS * float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))
    plan = Insertion(depth_m, room_m, doubt, HoleSearch.NONE, radius_m, length_m)
    if doubt <= room_m:
        return plan
    fits = (INSIDE_SIGMAS + 1) * doubt < radius_m
    quicker = plan.spiral_s > TILTING_S
    return replace(plan, search=HoleSearch.TILT if fits and quicker else HoleSearch.SPIRAL)


class InsertionPhase(Enum):
    """What is done at the moment."""

    APPROACH = "approach"
    SEARCH = "search"
    LEAN = "lean"
    LEAD = "lead"
    RIGHT = "set upright"
    INSERT = "insert"
    DONE = "done"
    FAILED = "failed"


@dataclass(frozen=True, slots=True, eq=False)
class InsertionState:
    """The phase, where the hand is told to go (3,), how hard it presses, where contact was (3,),
    and how far round the spiral is.

    `lowest_m` is how deep it has got while it is inserted, `stuck_s` for how long it has got no
    deeper. `lean_rad` is how far the part is told to tilt, about y of the hand, so that its edge at
    +x is lowest.
    """

    phase: InsertionPhase
    target: Floats
    press_n: float = 0.0
    contact: Floats | None = None
    turned_rad: float = 0.0
    lean_rad: float = 0.0
    lowest_m: float = np.inf
    stuck_s: float = 0.0


def begin_insertion(at: Floats, plan: Insertion | None = None) -> InsertionState:
    """Above the place where the hole is believed to be, at (3,); a part that will search by
    tilting leans first.
    """
    if plan is None or plan.search is not HoleSearch.TILT:
        return InsertionState(InsertionPhase.APPROACH, at)
    inside = plan.radius_m + plan.room_m - INSIDE_SIGMAS * plan.doubt_m
    drop = plan.length_m * (1 - np.cos(MAX_LEAN_RAD)) - plan.radius_m * np.sin(MAX_LEAN_RAD)
    return InsertionState(
        InsertionPhase.LEAN,
        at + np.array([inside - plan.edge_m(MAX_LEAN_RAD), 0.0, max(-drop, 0.0) + TILT_ABOVE_M]),
    )


def advance_insertion(
    plan: Insertion, now: InsertionState, at: Floats, force_n: float, dt_s: float
) -> InsertionState:
    """What comes next when the part is at a place (3,) and is pushed up with a force."""
    match now.phase:
        case InsertionPhase.APPROACH:
            return _approach_surface(plan, now, at, force_n, dt_s)
        case InsertionPhase.SEARCH:
            return _search_on_spiral(plan, now, at, dt_s)
        case InsertionPhase.LEAN:
            return _lean_in_air(now, dt_s)
        case InsertionPhase.LEAD:
            return _lead_to_wall(plan, now, at, dt_s)
        case InsertionPhase.RIGHT:
            return _set_upright(plan, now, at, dt_s)
        case InsertionPhase.INSERT:
            return _insert_part(plan, now, at, dt_s)
        case _:
            return now


def _approach_surface(
    plan: Insertion, now: InsertionState, at: Floats, force_n: float, dt_s: float
) -> InsertionState:
    """Down, until something is touched: the surface is there, and the hole as deep below it.

    What touches nothing goes right in.
    """
    if at[2] < -DONE_DEPTH_SHARE * plan.depth_m and not now.lean_rad:
        return replace(now, phase=InsertionPhase.DONE)
    if force_n < TOUCH_N:
        return replace(now, target=now.target - [0.0, 0.0, plan.down_m_s * dt_s])
    # it is in the hole, and rubs there
    if at[2] < -max(plan.doubt_m, plan.drop_m) and not now.lean_rad:
        return replace(
            now,
            phase=InsertionPhase.INSERT,
            press_n=plan.press_n,
            contact=np.array([at[0], at[1], 0.0]),
        )
    follows = {
        HoleSearch.NONE: InsertionPhase.INSERT,
        HoleSearch.SPIRAL: InsertionPhase.SEARCH,
        HoleSearch.TILT: InsertionPhase.LEAD,
    }
    return replace(now, phase=follows[plan.search], press_n=plan.press_n, contact=at.copy())


def _lean_in_air(now: InsertionState, dt_s: float) -> InsertionState:
    """Tilt in the air; then down."""
    lean = min(now.lean_rad + TURN_RAD_S * dt_s, MAX_LEAN_RAD)
    return replace(
        now,
        lean_rad=lean,
        phase=InsertionPhase.APPROACH if lean == MAX_LEAN_RAD else InsertionPhase.LEAN,
    )


def _lead_to_wall(plan: Insertion, now: InsertionState, at: Floats, dt_s: float) -> InsertionState:
    """The lowest edge is led along the bottom of what it has entered, until the far wall stops
    it; the hand then lags behind.
    """
    assert now.contact is not None
    if now.target[0] - at[0] > LAG_M:
        return replace(now, phase=InsertionPhase.RIGHT, contact=at.copy())
    if at[0] - now.contact[0] > 2 * INSIDE_SIGMAS * plan.doubt_m + plan.radius_m:
        return replace(now, phase=InsertionPhase.FAILED)
    ahead = now.target[0] + plan.along_m_s * dt_s
    return replace(now, target=np.array([ahead, at[1], now.target[2]]))


def _set_upright(plan: Insertion, now: InsertionState, at: Floats, dt_s: float) -> InsertionState:
    """Upright about the edge that the wall holds: the wrist goes along, and keeps the part
    against the wall.
    """
    assert now.contact is not None
    lean = max(now.lean_rad - TURN_RAD_S * dt_s, 0.0)
    x = now.contact[0] + plan.edge_m(MAX_LEAN_RAD) - plan.edge_m(lean) + LAG_M
    if lean == 0.0:
        upright, rim = np.array([at[0], at[1], now.target[2]]), np.array([at[0], at[1], 0.0])
        return replace(now, lean_rad=lean, phase=InsertionPhase.INSERT, target=upright, contact=rim)
    return replace(now, lean_rad=lean, target=np.array([x, at[1], now.target[2]]))


def _search_on_spiral(
    plan: Insertion, now: InsertionState, at: Floats, dt_s: float
) -> InsertionState:
    """Round the spiral while it presses, until the part drops by more than it can by leaning.

    One that was set upright beside its hole, because it rubbed, may stand farther from it than was
    doubted.
    """
    assert now.contact is not None
    contact = _lower_contact(now.contact, float(at[2]), dt_s)
    now = replace(now, contact=contact)
    if at[2] < contact[2] - plan.drop_m:
        return replace(
            now, phase=InsertionPhase.INSERT, target=np.array([at[0], at[1], now.target[2]])
        )
    a = plan.pitch_m / (2 * np.pi)
    radius = a * now.turned_rad
    if (
        radius
        > plan.doubt_m * (INSIDE_SIGMAS if plan.search is HoleSearch.TILT else 1.0) + plan.pitch_m
    ):
        return replace(now, phase=InsertionPhase.FAILED)
    turned = now.turned_rad + plan.along_m_s * dt_s / max(radius, 2 * a)
    offset = a * turned * np.array([np.cos(turned), np.sin(turned)])
    return replace(
        now, turned_rad=turned, target=np.array([*(contact[:2] + offset), now.target[2]])
    )


def _lower_contact(contact: Floats, height_m: float, dt_s: float) -> Floats:
    """Where contact was (3,), with its height brought down as slowly as a part creeps, at most
    to a height.
    """
    lower = max(float(contact[2]) - CREEP_M_S * dt_s, height_m)
    return np.array([*contact[:2], min(float(contact[2]), lower)])


def _insert_part(plan: Insertion, now: InsertionState, at: Floats, dt_s: float) -> InsertionState:
    """The hand presses, and gives way to the sides; the part is in when it is as deep as it should
    be.

    One that gets no deeper has only leant on the rim, or stands beside its hole: it is led round
    the spiral, until it drops from there.
    """
    contact = now.contact
    assert contact is not None
    deep = at[2] < min(contact[2], 0.0) - DONE_DEPTH_SHARE * plan.depth_m
    deeper = at[2] < now.lowest_m - LOWER_M
    now = replace(
        now,
        lowest_m=at[2] if deeper else now.lowest_m,
        stuck_s=0.0 if deeper else now.stuck_s + dt_s,
    )
    if now.stuck_s > STUCK_S and plan.search is not HoleSearch.NONE and not deep:
        leant = np.array([*contact[:2], at[2]])
        return replace(
            now, phase=InsertionPhase.SEARCH, contact=leant, lowest_m=np.inf, stuck_s=0.0
        )
    sideways = at[:2] if plan.search is not HoleSearch.NONE else now.target[:2]
    return replace(
        now,
        phase=InsertionPhase.DONE if deep else now.phase,
        target=np.array([*sideways, now.target[2]]),
    )
