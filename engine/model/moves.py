"""Values of plans that move: what an arm does in each step, leg by leg, and why a step has no motion. Metres, radians, seconds."""

from dataclasses import dataclass
from enum import Enum

import numpy as np

from cellwright.engine.model.geometry import Floats
from cellwright.kb.model.plan import StepId
from cellwright.kb.terms import Atom, Function


class LegKind(Enum):
    """What a part of a step's motion is for."""

    WAY = "way"  # free, to the front of the place
    IN = "in"  # straight, into the place
    DRAG = "drag"  # with a body along its joint
    OUT = "out"  # straight, back to the front of the place
    DRIVE = "drive"  # the arm rests, and the body that carries it moves along its joint
    CARRY = "carry"  # with a body that another arm holds, too


@dataclass(frozen=True, slots=True, eq=False)
class Leg:
    """A part of the motion of a step: configurations (m, k) of the arm, reached at `corners_s` (m,) from the leg's start.

    `proved` says whether it is free everywhere. `holding` names the bodies that move with the arm, except for its own tools.
    The legs `beside` are those of other arms at the same time, with the same corners.
    """

    kind: LegKind
    arm: str
    path: Floats
    corners_s: Floats
    proved: bool
    holding: tuple[str, ...] = ()
    beside: tuple["Leg", ...] = ()

    @property
    def seconds(self) -> float:
        """How long it lasts."""
        return float(self.corners_s[-1]) if len(self.corners_s) else 0.0

    def at(self, t: float) -> Floats:
        """The configuration (k,) at a time (s) from the start of the leg: from corner to corner, from rest to rest."""
        n = min(int(np.searchsorted(self.corners_s, t, side="right")) - 1, len(self.path) - 2)
        end: Floats = self.path[-1]
        if n < 0:
            return end
        lasts = float(self.corners_s[n + 1] - self.corners_s[n])
        s = min(1.0, (t - float(self.corners_s[n])) / lasts) if lasts > 0 else 1.0
        smooth = s**3 * (10 - 15 * s + 6 * s * s)
        found: Floats = self.path[n] + smooth * (self.path[n + 1] - self.path[n])
        return found


@dataclass(frozen=True, slots=True, eq=False)
class MovedStep:
    """The motion of one step; `takes_s` is spent at the place, beside the legs."""

    step: StepId
    operator: Function
    place: str
    legs: tuple[Leg, ...]
    takes_s: float = 0.0

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
    """A step for which no motion is found: at which place, and why. `culprits` are the bodies in the way.

    If it is `sure`, every configuration was looked at, and each touches something, or cannot be followed.
    It holds at least while the facts `while_true` are true, which put those bodies, and what the arm holds, where they are,
    and whatever the arguments of the operator at the places `regardless` are.

    `level` tells what refuses it: `sight` (a scanner does not see its patch), `reach` (no configuration at all), `contact` (every
    configuration touches something), `approach` (there is no straight way in or out), or `way` (no way leads there).
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
