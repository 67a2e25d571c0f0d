"""Moves of the parts of an assembly: whether geometry allows one, and which parts forbid it.

Parts are where they were found, on the free place, or at their goals. A move that fails is tried
anew with other parts taken away in thought; what is left over is an obstacle: a least set of parts
that forbids the move while they are where they are.
"""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.pipelines.manipulation.clearance import insertion_of, no_room
from cellwright.engine.pipelines.manipulation.place_answers import Carry, NotPlaced
from cellwright.engine.pipelines.manipulation.regrasp_paths import (
    carry_with_regrasps,
    direct_carry,
    possible_holds,
    table_rests,
)
from cellwright.engine.pipelines.manipulation.workspace import AssemblySite, PlaceTask
from cellwright.engine.stages.grasping.hole_insertion import Insertion
from cellwright.engine.stages.grasping.stable_placements import support_margin

MAX_TIP_M = 0.002


class PartSpot(StrEnum):
    """Where a part is."""

    FOUND = "found"
    ASIDE = "aside"
    GOAL = "goal"


class MoveKind(StrEnum):
    """How it is moved: with one grasp, or with several."""

    DIRECT = "direct"
    REGRASPED = "regrasped"


@dataclass(frozen=True, slots=True)
class PartMove:
    """A part goes from a spot to another one in some way."""

    part: str
    way: MoveKind
    start: PartSpot
    end: PartSpot


@dataclass(frozen=True, slots=True)
class MoveObstacle:
    """Why a move is impossible: while all of `during` are at their spots, and until one of
    `until` is at its goal.
    """

    move: PartMove
    reason: str
    during: tuple[tuple[str, PartSpot], ...] = ()
    until: tuple[str, ...] = ()


Spots = Mapping[str, PartSpot]


@dataclass(frozen=True, eq=False)
class AssemblyYard:
    """A site with the goals T_world_part of the parts that are to be moved."""

    site: AssemblySite
    goals: Mapping[str, Floats]
    asides: dict[str, Floats] = field(default_factory=dict)

    def pose(self, part: str, spot: PartSpot) -> Floats:
        """T_world_part (4, 4) of a part at a spot."""
        if spot is PartSpot.ASIDE and part not in self.asides:
            T_found = self.site.found[part]
            task = self.site.task(part, (T_found, T_found))
            self.asides[part] = max(
                (T for _, T in table_rests(task)),
                key=lambda T: float(np.trace(T_found[:3, :3].T @ T[:3, :3])),
            )
        poses = {
            PartSpot.FOUND: self.site.found,
            PartSpot.GOAL: self.goals,
            PartSpot.ASIDE: self.asides,
        }
        return poses[spot][part]

    def moved(self, move: PartMove, spots: Spots, near: Floats) -> tuple[Carry, ...] | MoveObstacle:
        """The carries of a move with the other parts at their spots, from a configuration (k,)
        on; else what forbids it.
        """
        other_spots = {name: spot for name, spot in spots.items() if name != move.part}
        falls = self._tipped(move, other_spots) or self._falling(move, other_spots)
        if falls is not None:
            return falls
        carries = self._carried(move, other_spots, near)
        if not isinstance(carries, NotPlaced):
            return carries
        motion = carries.step == "motion"

        def fails(present: Collection[str]) -> bool:
            rest = {name: other_spots[name] for name in present}
            if motion:
                return isinstance(self._carried(move, rest, near), NotPlaced)
            return not self._held(move, rest)

        culprits = least_failing_set(list(other_spots), fails)
        return MoveObstacle(
            move, carries.reason, tuple((name, other_spots[name]) for name in culprits)
        )

    def insertion(
        self, move: PartMove, spots: Spots, covariance: Floats, T_part_hand: Floats
    ) -> Insertion | None:
        """How the part goes in where it is enclosed at the end of a move, its pose there
        doubted by (6, 6), held at T_part_hand.
        """
        other_spots = {name: spot for name, spot in spots.items() if name != move.part}
        return insertion_of(self._task(move, other_spots), covariance, T_part_hand)

    def _task(self, move: PartMove, others: Spots) -> PlaceTask:
        ends = self.pose(move.part, move.start), self.pose(move.part, move.end)
        absent = [name for name in self.goals if name != move.part and name not in others]
        poses = {name: self.pose(name, spot) for name, spot in others.items()}
        return self.site.task(move.part, ends, poses, absent)

    def _carried(
        self, move: PartMove, others: Spots, near: Floats
    ) -> tuple[Carry, ...] | NotPlaced:
        task = self._task(move, others)
        at = possible_holds(task, task.T_start), possible_holds(task, task.T_goal)
        return (direct_carry if move.way is MoveKind.DIRECT else carry_with_regrasps)(
            task, at, near
        )

    def _held(self, move: PartMove, others: Spots) -> bool:
        """Whether there are holds for both ends, and one for both if there is to be one grasp."""
        task = self._task(move, others)
        if no_room(task, task.T_goal) is not None:
            return False
        at = possible_holds(task, task.T_start), possible_holds(task, task.T_goal)
        if move.way is MoveKind.DIRECT:
            return bool((at[0] & at[1]).any())
        return bool(at[0].any() and at[1].any()) and not (
            isinstance(
                regrasp := carry_with_regrasps(task, at, task.world.configuration), NotPlaced
            )
            and regrasp.step != "motion"
        )

    def _tipped(self, move: PartMove, others: Spots) -> MoveObstacle | None:
        """What would fall if the part left."""
        spots = {**others, move.part: move.start}
        for name in sorted(others):
            if self._stands(name, spots) and not self._stands(name, others, others[name]):
                return MoveObstacle(move, f"{name} stands on it", ((name, others[name]),))
        return None

    def _falling(self, move: PartMove, others: Spots) -> MoveObstacle | None:
        """Why the part would fall at its goal; what does not stand even when all is in place is
        held by something else.
        """
        missing = [
            name
            for name in self.goals
            if name != move.part and others.get(name) is not PartSpot.GOAL
        ]

        def falls(away: Collection[str]) -> bool:
            at_goal = {name: PartSpot.GOAL for name in self.goals if name not in (*away, move.part)}
            return not self._stands(move.part, at_goal, move.end)

        if move.end is not PartSpot.GOAL or falls(()) or not falls(missing):
            return None
        needed = least_failing_set(missing, falls)
        return MoveObstacle(move, "nothing would carry it there", until=tuple(needed))

    def _stands(self, part: str, others: Spots, spot: PartSpot | None = None) -> bool:
        """Whether a part stands among others at spots, and what is fixed."""
        solids = self.site.solids
        fixed = [
            (solids[name], self.site.world.pose("world", name))
            for name in self.site.world.cell.bodies
            if name in solids and name not in self.goals
        ]
        placed = [
            (solids[name], self.pose(name, at)) for name, at in others.items() if name != part
        ]
        pose = self.pose(part, spot or others[part])
        return support_margin(solids[part], pose, [*fixed, *placed]) > MAX_TIP_M


def least_failing_set(names: list[str], fails: Callable[[Collection[str]], bool]) -> list[str]:
    """A least set of names for which something still fails; it fails for all of them (deletion,
    as in Chinneck 1991).
    """
    names_left = sorted(names)
    for name in sorted(names):
        without = [other_name for other_name in names_left if other_name != name]
        if fails(without):
            names_left = without
    return names_left
