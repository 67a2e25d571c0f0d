"""Fact landmarks of the delete relaxation, and the number of landmarks that a path still has to visit.

An atom's landmarks are the atom itself and the landmarks that all its achievers have in common; an achiever
has the landmarks of all its preconditions (Zhu & Givan 2003; Keyder, Richter & Helmert 2010). They are
computed as a greatest fixpoint over bitsets. Counting follows Richter & Westphal 2010: a landmark is accepted
when it is true and all landmarks before it are accepted; reasonable orders (`orders`) count, too, and so do sets
of atoms of which one is a landmark (`disjunctive`). An accepted landmark
that is false counts again if it is a goal, or if a landmark that is not accepted needs it just before. Sets never
count again: which of their atoms is needed is decided already.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from cellwright.engine.model.task import Bits, GroundOperator, Task, indices
from cellwright.engine.stages.planning.forward.achievers import Achievers
from cellwright.engine.stages.planning.forward.disjunctive import Disjunctions, kinds_of
from cellwright.engine.stages.planning.forward.kernels import LandmarkCount, Rows
from cellwright.engine.stages.planning.forward.orders import add, ordered, reached

MAX_WORK = 3_000_000  # visits of operators that the fixpoint may take


class Hints(NamedTuple):
    """What finds landmarks and their orders beside operators: mutex groups, and a number for the predicate of each atom."""

    groups: Sequence[Bits] = ()
    kinds: Sequence[int] = ()

    @classmethod
    def of(cls, task: Task) -> "Hints":
        """Those of a task."""
        return cls(task.mutex_groups, kinds_of(task.atoms))


class Landmarks:
    """The landmarks of a conjunction of goals: `all` is the set of atoms that are landmarks, `sets` the sets of atoms of which one is.
    `before` are those that shall be reached before each, and `moments` what is known of reaching an atom. A set has a number
    behind those of all atoms.

    If it takes too much work to find them, only the goals are landmarks. No atom is `hidden`. Accepted landmarks are a row of
    bytes, as in `LandmarkCount`.
    """

    def __init__(
        self,
        operators: Sequence[GroundOperator],
        initial: Bits,
        goals: Bits,
        size: int,
        hidden: Bits = 0,
        hints: Hints = Hints(),
    ) -> None:
        self.operators, self.initial, self.goals, self.size = operators, initial, goals, size
        before = self._fixpoint()
        self.all = goals
        for goal in indices(goals):
            self.all |= before[goal] or 0
        self.all &= ~hidden
        achievers = Achievers(operators, before)
        self.moments = reached(achievers, initial, self.all)
        found = Disjunctions(achievers, self.all, initial, hints.kinds)
        self.sets = found.sets
        self.before = ordered(goals, self._must(achievers, found), self.moments, hints.groups)
        self._count = self._numbered()
        self.none = bytes((len(self.before) + 7) // 8)

    def _must(self, achievers: Achievers, found: Disjunctions) -> dict[int, Bits]:
        """For each landmark those that are reached before it on every way. What is true from the start comes before nothing, unless
        it has to be reached again."""
        kept = self.all & ~self.initial
        before = {atom: (achievers.landmarks[atom] or 0) & kept & ~(1 << atom) for atom in self.moments}
        for number, atoms in enumerate(found.sets, found.first):
            shared = kept
            for operator in achievers.first(atoms):
                shared &= achievers.needed(operator) or 0
            before[number] = shared
        for earlier, later in found.orders:
            add(before, earlier, later)
        return before

    def _numbered(self) -> LandmarkCount:
        """The compiled kernel that counts. It numbers the landmarks in the order of their atoms, then the sets."""
        number = {each: place for place, each in enumerate(self.before)}
        needed = [*(moment.needed & self.all for moment in self.moments.values()), *(0 for _ in self.sets)]

        def rows(sets: Iterable[Bits]) -> Rows:
            return Rows([[number[each] for each in indices(own)] for own in sets])

        atoms = Rows([*([atom] for atom in self.moments), *map(indices, self.sets)])
        goals = [number[goal] for goal in indices(self.goals)]
        return LandmarkCount(atoms, rows(self.before.values()), rows(needed), goals)

    def _fixpoint(self) -> list[Bits | None]:
        """For each atom its landmarks, itself included; None if the atom is unreachable.

        If the fixpoint takes too much work, each atom has only itself as a landmark.
        """
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
        """Keeps, for each atom that an operator adds, only the landmarks that all achievers so far share.

        Atoms whose landmarks change are noted in `touched`.
        """
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

    def accept(self, accepted: bytes, state: bytes) -> bytes:
        """The accepted landmarks after one more packed state."""
        return self._count.accept(accepted, state)

    def left(self, accepted: bytes, state: bytes) -> int:
        """The number of landmarks that are still to be visited, or to be visited again."""
        return self._count.left(accepted, state)
