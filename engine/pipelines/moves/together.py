"""Steps that two arms take together: one holds while the other works, one hands something over, or both carry one body.

The arm of `with` goes to its place first, and rests there while the other one goes to its own. If they carry a body, both then move
at once (`carrying`). At the end the arms leave their places, the one of `with` last; if it goes on holding what it held, it stays.
Each motion is planned with the other arm where it is.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cellwright.engine.model.geometry import Floats
from cellwright.engine.model.moves import Leg, LegKind, MovedStep, Unmoved
from cellwright.engine.pipelines.moves.carrying import carried
from cellwright.engine.pipelines.moves.hands import Hands, held
from cellwright.engine.pipelines.moves.rooms import Room
from cellwright.engine.pipelines.moves.steps import CAREFUL, StepMotion
from cellwright.kb.model.cell import Ends, Operation, Place
from cellwright.kb.model.plan import Step


@dataclass(eq=False)
class JointStep:
    """A step of several arms. `before` and `after` are the cell with these arms alone."""

    hands: Hands
    step: Step
    operation: Operation
    before: Room
    after: Room
    known: Sequence[Floats] = ()

    def moved(self) -> MovedStep | Unmoved:
        """The motion of the step, or why there is none; then the arms are where they were."""
        arms = tuple(self.before.world.cell.arms)
        stand = [(arm, self.hands.now(arm), self.hands.standing(arm)) for arm in arms]
        found = self._moved()
        if isinstance(found, Unmoved):
            for each in stand:
                self.hands.arrive(*each)
        return found

    def _moved(self) -> MovedStep | Unmoved:
        place = self._place(str(self.operation.at))
        if self.operation.with_place is None:
            return self._alone(place, self.operation, self.after)
        other = self._place(str(self.operation.with_place))
        first = self._alone(other, replace(self.operation, ends=Ends.INSIDE), self.before)
        if isinstance(first, Unmoved):
            return first
        if self.operation.carries is not None:
            second = self._alone(place, replace(self.operation, ends=Ends.INSIDE), self.before)
        else:
            second = self._alone(place, self.operation, self.after)
        if isinstance(second, Unmoved):
            return second
        more = self._carried(place, other) if self.operation.carries is not None else self._left(other)
        if isinstance(more, str):
            return Unmoved(self.step.id, self.step.operator, place.name, "way", more)
        legs = (*first.legs, *second.legs, *more)
        return MovedStep(self.step.id, self.step.operator, place.name, legs, self.operation.takes_s)

    def _carried(self, place: Place, other: Place) -> list[Leg] | str:
        """Both arms bring the body to where it belongs, and leave it."""
        body, rooms = str(self.operation.carries), (self._now(self.before), self._now(self.after))
        load = carried(self.hands, *rooms, place, other, body)
        if isinstance(load, str):
            return load
        for leg in (load, *load.beside):
            self.hands.arrive(leg.arm, leg.path[-1], None)
        legs = [load]
        for each in (place, other):
            out = self._out(each)
            if isinstance(out, str):
                return out
            legs.append(out)
        return legs

    def _left(self, other: Place) -> list[Leg] | str:
        """The arm of `with` leaves its place, unless it holds on to what it held."""
        before, after = (held(room.world, other.arm) for room in (self.before, self.after))
        if before == after:
            return []
        last = self._out(other)
        return last if isinstance(last, str) else [last]

    def _place(self, name: str) -> Place:
        return self.before.world.cell.places[name]

    def _now(self, room: Room) -> Room:
        """A room with the arms where they are."""
        world = room.world
        for arm in world.cell.arms:
            world = world.moved(arm, self.hands.now(arm))
        return Room(world, room.backend, room.kinematics)

    def _alone(self, place: Place, operation: Operation, after: Room) -> MovedStep | Unmoved:
        """What one of the arms does at its place, while the other one rests."""
        alone = replace(operation, with_place=None, carries=None)
        rooms = self._now(self.before), self._now(after)
        return StepMotion(self.hands, self.step, alone, place, *rooms, self.known).moved()

    def _out(self, place: Place) -> Leg | str:
        """Straight out of the place; a text if the arm cannot leave it."""
        room, q = self._now(self.after), self.hands.now(place.arm)
        path = room.straight(place, q, place.approach_m)
        if path is None or not room.is_free(place, path):
            return f"{place.arm} cannot leave {place.name} again"
        out = np.ascontiguousarray(path[::-1])
        self.hands.arrive(place.arm, out[-1], None)
        return self.hands.leg(LegKind.OUT, place.arm, out, room, factor=CAREFUL)
