"""Values of motion planning: what is asked, and what is answered. Radians, metres; configurations are (k,)."""

from dataclasses import dataclass
from enum import StrEnum
from typing import TypeAlias

from cellwright.engine.model.geometry import Contact, Floats

FINEST_M = 1e-4  # a motion so small need not be halved for a proof


class Strategy(StrEnum):
    """How a path is looked for.

    `connect` grows two trees through all joints. `visibility` goes along lines of sight with the hand, and then has the links
    follow. `reduced` plans for the first three joints, with a box around everything beyond them.
    """

    CONNECT = "connect"
    VISIBILITY = "visibility"
    REDUCED = "reduced"


@dataclass(frozen=True, slots=True, eq=False)
class Query:
    """A motion from `start` (k,) to any of the `goals` (n, k).

    Lines are looked at every `step` (rad, m); nothing may come within `margin_m`. `seed` decides the samples. The work is
    bounded by `budget`, the configurations looked at, and by `bridges`, the short cuts that are tried. `moving` numbers the
    joints that may move; all may if none is given. `strategy` says how the path is looked for. If `upright_rad`
    is above 0, what is upright in hand at the start tilts by no more than that.
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

    `proved` says whether it is free everywhere, not only where it was looked at. `looked` counts the configurations that the
    search and the short cuts looked at, `stretches` those of the proof, of which `refined` were halved. `cleared_m` is the
    margin that the last search kept.
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
    """A configuration touches, or comes within the margin of, something: `contacts`, the deepest first."""

    of: str
    contacts: tuple[Contact, ...]


Reason: TypeAlias = OutsideLimits | InCollision


@dataclass(frozen=True, slots=True, eq=False)
class Refused:
    """There is nothing to plan: the start, or each goal, is not allowed."""

    reasons: tuple[Reason, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Severed:
    """A proof that there is no path: what the `joints` alone move must pass something that leaves no way round.

    The cells of a grid over the values of these joints that are blocked as a whole part the start from every goal. At the
    configuration `at` (k,), the one of them that lies nearest to a goal, `contacts` is what touches, the deepest first.
    """

    joints: tuple[int, ...]
    cells: int
    at: Floats
    contacts: tuple[Contact, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Blocked:
    """No path was found within the budget.

    The trees from start and goals came nearest at `ends` (2, k), `apart` (rad, m) from each other, after `looked`
    configurations; they had `grown` nodes each. `contacts` is what touches where the straight line between the ends is
    blocked worst, at configuration `at` (k,). `why` is a sentence about the strategy, if it has more to say. With
    `severed` it is proved that there is none.
    """

    ends: Floats
    apart: float
    looked: int
    grown: tuple[int, int]
    at: Floats
    contacts: tuple[Contact, ...]
    why: str = ""
    severed: Severed | None = None


Answer: TypeAlias = Moved | Refused | Blocked
