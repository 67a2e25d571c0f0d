"""Fact landmarks of the delete relaxation, and the number of landmarks that a path still has to visit.

An atom's landmarks are the atom itself and the landmarks that all its achievers have in common; an achiever
has the landmarks of all its preconditions (Zhu & Givan 2003; Keyder, Richter & Helmert 2010). They are
computed as a greatest fixpoint over bitsets. Counting follows Richter & Westphal 2010: a landmark is accepted
when it is true and all landmarks before it are accepted; reasonable orders (`orders`) count, too. An accepted landmark
that is false counts again if it is a goal, or if a landmark that is not accepted needs it just before.
"""

from collections.abc import Iterable, Sequence

from engine.model.task import Bits, GroundOperator, indices
from engine.stages.planning.forward.kernels import LandmarkCount, Rows
from engine.stages.planning.forward.orders import ordered, reached

MAX_WORK = 3_000_000  # visits of operators that the fixpoint may take


class Landmarks:
    """The landmarks of a conjunction of goals: `all` is their set of atoms, `before` those that shall be reached before each,
    `moments` what is known of reaching each. No atom is `hidden`.

    With mutex `groups` there are reasonable orders, too. If it takes too much work to find them, only the goals are
    landmarks. Accepted landmarks are a row of bytes, as in `LandmarkCount`.
    """

    def __init__(
        self,
        operators: Sequence[GroundOperator],
        initial: Bits,
        goals: Bits,
        size: int,
        hidden: Bits = 0,
        groups: Sequence[Bits] = (),
    ) -> None:
        self.operators, self.initial, self.goals, self.size = operators, initial, goals, size
        self._before = self._fixpoint()
        self.all = goals
        for goal in indices(goals):
            self.all |= self._before[goal] or 0
        self.all &= ~hidden
        self.moments = reached(operators, initial, self.all, self._before)
        kept = self.all & ~initial  # what is true from the start comes first, unless it is reached again
        must = {atom: (self._before[atom] or 0) & kept & ~(1 << atom) for atom in self.moments}
        self.before = ordered(goals, must, self.moments, groups)
        self._count = self._numbered()
        self.none = bytes((self.all.bit_count() + 7) // 8)

    def _numbered(self) -> LandmarkCount:
        """The compiled kernel that counts. It numbers the landmarks in the order of their atoms."""
        number = {atom: place for place, atom in enumerate(self.moments)}

        def rows(sets: Iterable[Bits]) -> Rows:
            return Rows([[number[atom] for atom in indices(each)] for each in sets])

        just_before = (moment.needed & self.all for moment in self.moments.values())
        goals = [number[goal] for goal in indices(self.goals)]
        return LandmarkCount(list(number), rows(self.before.values()), rows(just_before), goals)

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
