"""Moves of the parts of an assembly: whether geometry allows one, and which other parts forbid it if not.

Parts are where they were found, on the free place, or at their goals. A move that fails is tried anew with other parts taken
away in thought; what is left over is an obstacle: a least set of parts that forbids the move while they are where they are.
"""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from cellwright.engine.model.geometry import Floats
from cellwright.engine.pipelines.placing.answers import Carry, NotPlaced
from cellwright.engine.pipelines.placing.fit import insertion_of
from cellwright.engine.pipelines.placing.room import no_room
from cellwright.engine.pipelines.placing.site import Site
from cellwright.engine.pipelines.placing.task import Task
from cellwright.engine.pipelines.placing.ways import direct, possible, regrasped, rests
from cellwright.engine.stages.grasping.insertion import Insertion
from cellwright.engine.stages.grasping.support import carried_by

STEADY_M = 0.002


class Spot(StrEnum):
    """Where a part is."""

    FOUND = "found"
    ASIDE = "aside"
    GOAL = "goal"


class Way(StrEnum):
    """How it is moved: with one grasp, or with several."""

    DIRECT = "direct"
    REGRASPED = "regrasped"


@dataclass(frozen=True, slots=True)
class Move:
    """A part goes from a spot to another one in some way."""

    part: str
    way: Way
    start: Spot
    end: Spot


@dataclass(frozen=True, slots=True)
class Obstacle:
    """Why a move is impossible: while all of `during` are at their spots, and until one of `until` is at its goal."""

    move: Move
    reason: str
    during: tuple[tuple[str, Spot], ...] = ()
    until: tuple[str, ...] = ()


Spots = Mapping[str, Spot]


@dataclass(frozen=True, eq=False)
class Yard:
    """A site with the goals T_world_part of the parts that are to be moved."""

    site: Site
    goals: Mapping[str, Floats]
    asides: dict[str, Floats] = field(default_factory=dict)

    def pose(self, part: str, spot: Spot) -> Floats:
        """T_world_part (4, 4) of a part at a spot."""
        if spot is Spot.ASIDE and part not in self.asides:
            found = self.site.found[part]
            task = self.site.task(part, (found, found))
            self.asides[part] = max(
                (T for _, T in rests(task)), key=lambda T: float(np.trace(found[:3, :3].T @ T[:3, :3]))
            )
        known = {Spot.FOUND: self.site.found, Spot.GOAL: self.goals, Spot.ASIDE: self.asides}
        return known[spot][part]

    def moved(self, move: Move, spots: Spots, near: Floats) -> tuple[Carry, ...] | Obstacle:
        """The carries of a move with the other parts at their spots, from a configuration (k,) on; else what forbids it."""
        others = {name: spot for name, spot in spots.items() if name != move.part}
        falls = self._tipped(move, others) or self._falling(move, others)
        if falls is not None:
            return falls
        found = self._carried(move, others, near)
        if not isinstance(found, NotPlaced):
            return found
        motion = found.step == "motion"

        def fails(present: Collection[str]) -> bool:
            left = {name: others[name] for name in present}
            if motion:
                return isinstance(self._carried(move, left, near), NotPlaced)
            return not self._held(move, left)

        culprits = least(list(others), fails)
        return Obstacle(move, found.reason, tuple((name, others[name]) for name in culprits))

    def insertion(
        self, move: Move, spots: Spots, covariance: Floats, T_part_hand: Floats
    ) -> Insertion | None:
        """How the part goes in where it is enclosed at the end of a move, its pose there doubted by (6, 6), held at T_part_hand."""
        others = {name: spot for name, spot in spots.items() if name != move.part}
        return insertion_of(self._task(move, others), covariance, T_part_hand)

    def _task(self, move: Move, others: Spots) -> Task:
        ends = self.pose(move.part, move.start), self.pose(move.part, move.end)
        absent = [name for name in self.goals if name != move.part and name not in others]
        poses = {name: self.pose(name, spot) for name, spot in others.items()}
        return self.site.task(move.part, ends, poses, absent)

    def _carried(self, move: Move, others: Spots, near: Floats) -> tuple[Carry, ...] | NotPlaced:
        task = self._task(move, others)
        at = possible(task, task.T_start), possible(task, task.T_goal)
        return (direct if move.way is Way.DIRECT else regrasped)(task, at, near)

    def _held(self, move: Move, others: Spots) -> bool:
        """Whether there are holds for both ends, and one for both if there is to be one grasp."""
        task = self._task(move, others)
        if no_room(task, task.T_goal) is not None:
            return False
        at = possible(task, task.T_start), possible(task, task.T_goal)
        if move.way is Way.DIRECT:
            return bool((at[0] & at[1]).any())
        return bool(at[0].any() and at[1].any()) and not (
            isinstance(found := regrasped(task, at, task.world.configuration), NotPlaced)
            and found.step != "motion"
        )

    def _tipped(self, move: Move, others: Spots) -> Obstacle | None:
        """What would fall if the part left."""
        here = {**others, move.part: move.start}
        for name in sorted(others):
            if self._stands(name, here) and not self._stands(name, others, others[name]):
                return Obstacle(move, f"{name} stands on it", ((name, others[name]),))
        return None

    def _falling(self, move: Move, others: Spots) -> Obstacle | None:
        """Why the part would fall at its goal; what does not stand even when all is in place is held by something else."""
        missing = [name for name in self.goals if name != move.part and others.get(name) is not Spot.GOAL]

        def falls(away: Collection[str]) -> bool:
            there = {name: Spot.GOAL for name in self.goals if name not in (*away, move.part)}
            return not self._stands(move.part, there, move.end)

        if move.end is not Spot.GOAL or falls(()) or not falls(missing):
            return None
        wanted = least(missing, falls)
        return Obstacle(move, "nothing would carry it there", until=tuple(wanted))

    def _stands(self, part: str, others: Spots, spot: Spot | None = None) -> bool:
        """Whether a part stands among others at spots, and what is fixed."""
        solids = self.site.solids
        fixed = [
            (solids[name], self.site.world.pose("world", name))
            for name in self.site.world.cell.bodies
            if name in solids and name not in self.goals
        ]
        placed = [(solids[name], self.pose(name, at)) for name, at in others.items() if name != part]
        pose = self.pose(part, spot or others[part])
        return carried_by(solids[part], pose, [*fixed, *placed]) > STEADY_M


def least(names: list[str], fails: Callable[[Collection[str]], bool]) -> list[str]:
    """A least set of names for which something still fails; it fails for all of them (deletion, as in Chinneck 1991)."""
    kept = sorted(names)
    for name in sorted(names):
        without = [each for each in kept if each != name]
        if fails(without):
            kept = without
    return kept
