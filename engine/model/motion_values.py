"""Arm motion: path queries and answers, motions of plan steps, and space that arms share."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum, StrEnum
from typing import TypeAlias

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.geometry import Contact
from cellwright.kb.model.plan_model import StepId
from cellwright.kb.terms import Atom, Function

FINEST_M = 1e-4  # a motion so small need not be halved for a proof


class Strategy(StrEnum):
    """How a path is looked for.

    `connect` grows two trees through all joints. `visibility` goes along lines of sight with the
    hand, and then has the links follow. `reduced` plans for the first three joints, with a box
    around everything beyond them.
    """

    CONNECT = "connect"
    VISIBILITY = "visibility"
    REDUCED = "reduced"


@dataclass(frozen=True, slots=True, eq=False)
class PathQuery:
    """A motion from `start` (k,) to any of the `goals` (n, k).

    Lines are looked at every `step` (rad, m); nothing may come within `margin_m`. `seed` decides
    the samples. The work is bounded by `budget`, the configurations looked at, and by `bridges`,
    the short cuts that are tried. `moving` numbers the joints that may move; all may if none is
    given. `strategy` says how the path is looked for. If `upright_rad` is above 0, what is upright
    in hand at the start tilts by no more than that.
    """

    start: Floats
    goals: Floats
    step: float = 1 / 32
    margin_m: float = 0.0
    seed: int = 0
    budget: int = 1_000_000
    bridges: int = 60
    proved: bool = True
    moving: tuple[int, ...] = ()
    strategy: Strategy = Strategy.CONNECT
    upright_rad: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Moved:
    """A path (m, k) to goal number `goal`.

    `proved` says whether it is free everywhere, not only where it was looked at. `looked` counts
    the configurations that the search and the short cuts looked at, `stretches` those of the proof,
    of which `refined` were halved. `cleared_m` is the margin that the last search kept.
    """

    path: Floats
    goal: int
    looked: int
    proved: bool
    stretches: int = 0
    refined: int = 0
    cleared_m: float = 0.0


@dataclass(frozen=True, slots=True)
class OutsideLimits:
    """A joint of a configuration is beyond a limit; `of` is "start" or "goal 1", and so on."""

    of: str
    joint: int
    value: float
    lower: float
    upper: float


@dataclass(frozen=True, slots=True, eq=False)
class InCollision:
    """A configuration touches, or comes within the margin of, something: `contacts`, the
    deepest first.
    """

    of: str
    contacts: tuple[Contact, ...]


Reason: TypeAlias = OutsideLimits | InCollision


@dataclass(frozen=True, slots=True, eq=False)
class RefusedQuery:
    """There is nothing to plan: the start, or each goal, is not allowed."""

    reasons: tuple[Reason, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Severed:
    """A proof that there is no path: what the `joints` alone move must pass something that leaves
    no way round.

    The cells of a grid over the values of these joints that are blocked as a whole part the start
    from every goal. At the configuration `at` (k,), the one of them that lies nearest to a goal,
    `contacts` is what touches, the deepest first.
    """

    joints: tuple[int, ...]
    cells: int
    at: Floats
    contacts: tuple[Contact, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Blocked:
    """No path was found within the budget.

    The trees from start and goals came nearest at `ends` (2, k), `apart` (rad, m) from each other,
    after `looked` configurations; they had `grown` nodes each. `contacts` is what touches where the
    straight line between the ends is blocked worst, at configuration `at` (k,). `why` is a sentence
    about the strategy, if it has more to say. With `severed` it is proved that there is none.
    """

    ends: Floats
    apart: float
    looked: int
    grown: tuple[int, int]
    at: Floats
    contacts: tuple[Contact, ...]
    why: str = ""
    severed: Severed | None = None


Answer: TypeAlias = Moved | RefusedQuery | Blocked


class LegKind(Enum):
    """What a part of a step's motion is for."""

    WAY = "way"  # free, to the front of the place
    IN = "in"  # straight, into the place
    DRAG = "drag"  # with a body along its joint
    OUT = "out"  # straight, back to the front of the place
    DRIVE = "drive"  # the arm rests, and the body that carries it moves along its joint
    CARRY = "carry"  # with a body that another arm holds, too


@dataclass(frozen=True, slots=True, eq=False)
class StepLeg:
    """A part of the motion of a step: configurations (m, k) of the arm, reached at `corners_s` (m,)
    from the leg's start.

    `proved` says whether it is free everywhere. `holding` names the bodies that move with the arm,
    except for its own tools. The legs `beside` are those of other arms at the same time, with the
    same corners.
    """

    kind: LegKind
    arm: str
    path: Floats
    corners_s: Floats
    proved: bool
    holding: tuple[str, ...] = ()
    beside: tuple["StepLeg", ...] = ()

    @property
    def seconds(self) -> float:
        """How long it lasts."""
        return float(self.corners_s[-1]) if len(self.corners_s) else 0.0

    def at(self, t: float) -> Floats:
        """The configuration (k,) at a time (s) from the start of the leg: from corner to
        corner, from rest to rest.
        """
        n = min(int(np.searchsorted(self.corners_s, t, side="right")) - 1, len(self.path) - 2)
        end: Floats = self.path[-1]
        if n < 0:
            return end
        lasts = float(self.corners_s[n + 1] - self.corners_s[n])
        s = min(1.0, (t - float(self.corners_s[n])) / lasts) if lasts > 0 else 1.0
        smooth = s**3 * (10 - 15 * s + 6 * s * s)
        configuration: Floats = self.path[n] + smooth * (self.path[n + 1] - self.path[n])
        return configuration


@dataclass(frozen=True, slots=True, eq=False)
class PlaceStop:
    """One of several places in a row of a step: how many `legs` belong to it, and what it changes.

    After it the bodies `in_hand` are in the hand, each at a pose T_tool_body (4, 4), and the bodies
    `put` are where the facts after the step have them.
    """

    place: str
    legs: int
    in_hand: Mapping[str, Floats] = field(default_factory=dict)
    put: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class MovedStep:
    """The motion of one step; `takes_s` is spent at the place, beside the legs.

    A step with several places in a row has a stop for each; `takes_s` is shared by all evenly.
    """

    step: StepId
    operator: Function
    place: str
    legs: tuple[StepLeg, ...]
    takes_s: float = 0.0
    stops: tuple[PlaceStop, ...] = ()

    @property
    def seconds(self) -> float:
        """How long the step lasts."""
        return sum(leg.seconds for leg in self.legs) + self.takes_s

    @property
    def proved(self) -> bool:
        """Whether every leg is free everywhere."""
        return all(leg.proved for leg in self.legs)


@dataclass(frozen=True, slots=True)
class Unmoved:
    """A step for which no motion is found: at which place, and why. `culprits` are the bodies in
    the way.

    If it is `sure`, every configuration was looked at, and each touches something, or cannot be
    followed. It holds at least while the facts `while_true` are true, which put those bodies, and
    what the arm holds, where they are, and whatever the arguments of the operator at the places
    `regardless` are.

    `level` tells what refuses it: `sight` (a scanner does not see its patch), `reach` (no
    configuration at all), `contact` (every configuration touches something), `approach` (there is
    no straight way in or out), or `way` (no way leads there).
    """

    step: StepId
    operator: Function
    place: str
    level: str
    reason: str
    culprits: tuple[str, ...] = ()
    while_true: tuple[Atom, ...] = ()
    sure: bool = False
    regardless: frozenset[int] = frozenset()


@dataclass(frozen=True, slots=True)
class UnprovedStep:
    """A step of which something is not proved, because it has no motion: without a `place` no arm
    moves in it; else the arm goes there, and the `bodies` get to where they are after the step in
    another way. `bodies` are what the step brings somewhere without a motion.
    """

    step: StepId
    operator: Function
    bodies: tuple[str, ...] = ()
    place: str = ""


StepPair = tuple[StepId, StepId]


@dataclass(frozen=True, slots=True)
class Meetings:
    """Which steps of different arms can meet.

    `tracks` are the steps of each arm in their order; a step of several arms is on several tracks.
    `steps` are pairs that can meet on their ways. `rests` are an arm, the step after which it rests
    (None: at the start), and a step of another arm that meets it there. `orders` are pairs of which
    the first must come first, because it clears the way of the second, or because the second would
    block it. `looked` pairs of steps were compared, `near` of them by their paths.
    """

    tracks: Mapping[str, tuple[StepId, ...]]
    steps: frozenset[StepPair] = frozenset()
    rests: frozenset[tuple[str, StepId | None, StepId]] = frozenset()
    orders: frozenset[StepPair] = frozenset()
    looked: int = 0
    near: int = 0


@dataclass(frozen=True, slots=True)
class SharedZone:
    """Space that two arms share: a box (m, in the world), and the steps of each arm that go through
    it.

    One arm at a time may be in it: it is a resource that geometry has found.
    """

    name: str
    lower: tuple[float, float, float]
    upper: tuple[float, float, float]
    steps: Mapping[str, tuple[StepId, ...]]


@dataclass(frozen=True, slots=True)
class PassingOrder:
    """Who goes first: the start of each step, and pairs of steps of which the first ends before the
    second begins.

    No order of the arms in their zones is done before `lower_bound`. `proved` says that none is
    better.
    """

    starts: Mapping[StepId, int]
    makespan: int
    lower_bound: int
    orders: frozenset[StepPair] = frozenset()
    proved: bool = False


@dataclass(frozen=True, slots=True)
class Sharing:
    """How the arms of a plan share space: `zones`, how many pairs of steps never meet whatever
    their times (`apart`), and how many are kept apart by their order (`ordered`). `held` are the
    orders that were added for that.
    """

    zones: tuple[SharedZone, ...] = ()
    apart: int = 0
    ordered: int = 0
    held: frozenset[StepPair] = field(default_factory=frozenset)
    lower_bound: int = 0
    proved: bool = False
