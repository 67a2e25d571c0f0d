"""Fact landmarks of the delete relaxation, and how many of them a path still has to visit.

Every landmark of an atom is one of all its achievers' preconditions, taken together (Zhu & Givan 2003; Keyder,
Richter & Helmert 2010): a greatest fixpoint over bitsets. Counting follows Richter & Westphal 2010: a landmark is
accepted when it is true and all that come before it are accepted; an accepted one that is false again counts if it is
a goal or if a landmark still to come needs it just before.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

from engine.model.task import Bits, GroundOperator, indices

MAX_WORK = 3_000_000  # operators that the fixpoint may look at


@dataclass
class Landmarks:
    """The landmarks of a conjunction of goals, as a set of atoms; empty if they cost too much to find."""

    operators: Sequence[GroundOperator]
    initial: Bits
    goals: Bits
    size: int
    all: Bits = field(init=False)

    def __post_init__(self) -> None:
        self._before = self._fixpoint()
        self.all = self.goals
        for goal in indices(self.goals):
            self.all |= self._before[goal] or 0
        self._just_before = dict.fromkeys(indices(self.all), -1)
        for operator in self.operators:
            for atom in indices(operator.adds & self.all):
                self._just_before[atom] &= operator.preconditions
        for atom, needed in self._just_before.items():
            self._just_before[atom] = 0 if needed < 0 else needed & self.all

    def _fixpoint(self) -> list[Bits | None]:
        """For each atom its landmarks, itself included; None if it is unreachable or was not looked at in time."""
        found: list[Bits | None] = [
            1 << atom if self.initial >> atom & 1 else None for atom in range(self.size)
        ]
        users: list[list[int]] = [[] for _ in range(self.size)]
        for number, operator in enumerate(self.operators):
            for atom in indices(operator.preconditions):
                users[atom].append(number)
        waiting = list(range(len(self.operators)))
        work = 0
        while waiting and work < MAX_WORK:
            touched: dict[int, None] = {}
            for number in waiting:
                self._look(self.operators[number], found, touched)
            work += len(waiting)
            waiting = list(dict.fromkeys(number for atom in touched for number in users[atom]))
        return found if not waiting else [1 << atom for atom in range(self.size)]

    def _look(self, operator: GroundOperator, found: list[Bits | None], touched: dict[int, None]) -> None:
        """What all achievers share shrinks with every achiever."""
        needed = 0
        for atom in indices(operator.preconditions):
            landmarks = found[atom]
            if landmarks is None:
                return
            needed |= landmarks
        for atom in indices(operator.adds):
            known = found[atom]
            shared = needed | 1 << atom if known is None else known & (needed | 1 << atom)
            if shared != known:
                found[atom] = shared
                touched[atom] = None

    def accept(self, accepted: Bits, state: Bits) -> Bits:
        """The accepted landmarks after one more state."""
        for atom in indices(state & self.all & ~accepted):
            before = (self._before[atom] or 0) & self.all & ~(1 << atom)
            if before & ~accepted == 0:
                accepted |= 1 << atom
        return accepted

    def left(self, accepted: Bits, state: Bits) -> int:
        """How many landmarks are still to be visited, or again."""
        open_ = self.all & ~accepted
        again = self.goals
        for atom in indices(open_):
            again |= self._just_before[atom]
        return open_.bit_count() + (again & accepted & ~state).bit_count()
