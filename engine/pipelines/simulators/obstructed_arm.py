"""Arm of a simulated cell that stops where it would touch an unmodelled body, and goes back.

Each step gets the motion that planning gives it in the cell as it is known. Whether that touches
what nobody knows of is looked up along the way in the cell as it is. Everything else about a step
is decided by the facts alone.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.motion_values import LegKind, MovedStep, StepLeg
from cellwright.engine.pipelines.motion.cell_state import BodyRide, CellState
from cellwright.engine.pipelines.motion.places_in_a_row import step_parts
from cellwright.engine.pipelines.motion.plan_walk import PlanWalk, operation_of
from cellwright.engine.pipelines.motion.step_motion import guide_value
from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.pipelines.simulators.unmodelled import UnmodelledThings
from cellwright.engine.plugins import geometry_backend
from cellwright.engine.stages.geometry.collision.planning_scene import PlanningScene
from cellwright.kb.model.cell_model import Operation
from cellwright.kb.model.plan_model import Step, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function

LOOK_STEP = 0.01  # rad or m between two looks

Facts = Collection[Atom]


@dataclass
class ObstructedArm:
    """The arm of such a cell."""

    problem: Problem
    unknown: UnmodelledThings
    seed: int = 0
    _told: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._walk, self._real = self._walks()

    def _walks(self) -> tuple[PlanWalk, PlanWalk]:
        """The arm in the cell as it is known, and in the cell as it is."""
        semantics, backend = PlanGate().semantics(self.problem), geometry_backend()
        cells = self.unknown.known, self.unknown.whole
        believed, true = (PlanWalk(semantics, cell, backend, self.seed) for cell in cells)
        return believed, true

    def carries_out(self, step: Function, before: Facts, after: Facts) -> bool:
        """Take a step; False if the arm was stopped by something, and is where it was."""
        self._told = {}
        operation = operation_of(self._walk.cell, step)
        if operation is None:
            return True
        where, believed = self._walk.hands.where(), self.unknown.believed
        moved = self._walk.step(Step(StepId(1), step), operation, believed(before), believed(after))
        if isinstance(moved, MovedStep):
            met = next(self._met(moved, operation, frozenset(before), frozenset(after)), None)
        else:  # around what it has met there is no way either
            met = min(self.unknown.met, default=None)
        if met is None:
            return True
        self._told = self.unknown.meets(met, self._real.room(frozenset(before)).world)
        self._walk, self._real = self._walks()
        self._walk.hands.put(where)
        return False

    def _met(
        self, moved: MovedStep, operation: Operation, before: Facts, after: Facts
    ) -> Iterator[str]:
        """What the arms meet on their way of what nobody knows of, in this order."""
        if moved.stops:
            yield from self._met_in_a_row(moved, operation, before, after)
            return
        for leg in moved.legs:
            state = frozenset(after if leg.kind is LegKind.OUT else before)
            for leg_beside in (leg, *leg.beside):
                room = self._real.room(state, (leg_beside.arm,))
                if leg.kind is LegKind.DRIVE:
                    last = self._real.room(frozenset(after), (leg_beside.arm,))
                    yield from self._on_ride(room, last, operation.drives, leg_beside)
                else:
                    yield from self._on_leg(_room_holding(room, leg_beside, operation), leg_beside)

    def _met_in_a_row(
        self, moved: MovedStep, operation: Operation, before: Facts, after: Facts
    ) -> Iterator[str]:
        """The same for a step with several places in a row."""
        arm = moved.legs[0].arm
        rooms = (self._real.room(frozenset(facts), (arm,)) for facts in (before, after))
        ends = (room.world for room in rooms)
        for part, old, new in step_parts(moved, *ends):
            for leg in part.legs:
                world = new if leg.kind is LegKind.OUT else old
                room = CellState(world, self._real.backend, {})
                yield from self._on_leg(_room_holding(room, leg, operation), leg)

    def _on_leg(self, room: CellState, leg: StepLeg) -> Iterator[str]:
        ground, hidden = room.free(leg.arm), self.unknown.names
        pieces, pairs = ground.scene.pieces, ground.scene.pairs.reshape(-1, 2)
        rows = [n for n, (i, j) in enumerate(pairs) if {pieces[i].body, pieces[j].body} & hidden]
        if rows:
            yield from self._touched(
                ground.only(rows), room.whole(leg.arm, subdivide_path(leg.path))
            )

    def _on_ride(self, room: CellState, last: CellState, body: str, leg: StepLeg) -> Iterator[str]:
        ride = BodyRide.of(room, body, guide_value(room.world, body), guide_value(last.world, body))
        whole: Floats = room.whole(leg.arm, leg.path[:1])[0]
        yield from (name for name in ride.touched(whole) if name in self.unknown.names)

    def _touched(self, ground: PlanningScene, whole: Floats) -> Iterator[str]:
        hits = np.nonzero(ground.collides(whole))[0]
        if len(hits):
            contacts = ground.contacts(whole[hits[0]])
            yield from (
                n
                for contact in contacts
                for n in (contact.first, contact.second)
                if n in self.unknown.names
            )

    def met(self) -> dict[str, Any]:
        """What the last step has run into, as a reply tells it; empty if it has run into
        nothing.
        """
        return self._told

    def misfit(self, facts: Facts, before: Facts, after: Facts) -> int:  # noqa: ARG002 - bodies are where facts put them
        """Nothing is where the facts do not put it."""
        return 0

    def reading(self, sensor: str) -> str:  # noqa: ARG002 - it has no sensors
        """Sensors are answered from the facts."""
        return ""

    def tells(self, sensor: str, shown: str) -> str:  # noqa: ARG002 - it has no sensors
        """A reading tells itself."""
        return shown

    def failed(self, facts: Facts) -> None:
        """The arm is where it was."""

    def repaired(self, before: Facts, after: Facts) -> None:
        """Repairs change facts alone."""


def _room_holding(room: CellState, leg: StepLeg, operation: Operation) -> CellState:
    """The room in which what a leg takes along moves with the arm."""
    along = {LegKind.DRAG: operation.drags, LegKind.CARRY: str(operation.carries)}.get(leg.kind, "")
    if not along:
        return room
    world = room.world.moved(leg.arm, leg.path[0]).affix(along, f"{leg.arm}.tool")
    return CellState(world, room.backend, room.kinematics)


def subdivide_path(path: Floats) -> Floats:
    """Configurations of a path (m, k) that are at most `LOOK` apart in every joint."""
    parts = [path[:1]]
    for first, last in pairwise(path):
        count = max(1, int(np.ceil(np.abs(last - first).max() / LOOK_STEP)))
        parts.append(first + (np.arange(1, count + 1) / count)[:, None] * (last - first))
    return np.concatenate(parts)
