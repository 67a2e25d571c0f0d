"""Answers of PLACE: the whole path of the part, or the first thing that stands in its way."""

from dataclasses import dataclass
from typing import TypeAlias

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.manipulation_values import Assembled, Grasp, RelationContradiction
from cellwright.engine.model.vision import LocatedPart, NotLocated
from cellwright.engine.stages.grasping.hole_insertion import Insertion


@dataclass(frozen=True, slots=True, eq=False)
class PathLeg:
    """A stretch of motion: configurations (m, k) of all joints; `proved` if it is free everywhere,
    not only where looked at.

    `what` says what happens, `carries` whether the part is in the hand.
    """

    what: str
    path: Floats
    carries: bool
    proved: bool


@dataclass(frozen=True, slots=True, eq=False)
class Carry:
    """One taking and letting go: the grasp, the hand on the part T_part_hand, the part's poses in
    the world, and the legs.

    `insertion` says how the part goes in where it is enclosed at its goal.
    """

    grasp: Grasp
    T_part_hand: Floats
    T_world_from: Floats
    T_world_to: Floats
    rest: str
    legs: tuple[PathLeg, ...]
    insertion: Insertion | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """The way from the part as it was found to its goal: `carries`, of which all but the last end
    in a placement to regrasp.

    `possible` are the hand's poses T_part_hand with which the part can be taken where it lies, each
    with the width it closes to.
    """

    goal: Assembled
    sighting: LocatedPart
    T_world_part: Floats
    T_world_goal: Floats
    # all, those possible where the part lies, those possible at the goal
    holds: tuple[int, int, int]
    carries: tuple[Carry, ...]
    possible: tuple[tuple[Floats, float], ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class NotPlaced:
    """Why the part is not placed: what stopped it (`relations`, `sight`, `grasp`, `regrasp` or
    `motion`), and what to try.
    """

    step: str
    reason: str
    hint: str
    cause: RelationContradiction | NotLocated | None = None


PlaceAnswer: TypeAlias = Placed | NotPlaced
