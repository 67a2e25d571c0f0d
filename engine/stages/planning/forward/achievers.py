"""The operators that can make an atom true, and the landmarks of what they need."""

from collections.abc import Iterator, Sequence

from cellwright.engine.model.task import Bits, GroundOperator, indices


class Achievers:
    """The achievers of atoms. `landmarks` has the landmarks of each atom, itself included; None for one that cannot be reached."""

    def __init__(self, operators: Sequence[GroundOperator], landmarks: Sequence[Bits | None]) -> None:
        self.landmarks, self._operators = landmarks, operators
        self._adding: list[list[int]] = [[] for _ in landmarks]
        for number, operator in enumerate(operators):
            for atom in indices(operator.adds):
                self._adding[atom].append(number)

    def of(self, atoms: Bits) -> Iterator[GroundOperator]:
        """The operators that can make one of some atoms true."""
        for number in dict.fromkeys(number for atom in indices(atoms) for number in self._adding[atom]):
            if self.needed(self._operators[number]) is not None:
                yield self._operators[number]

    def first(self, atoms: Bits) -> Iterator[GroundOperator]:
        """Those that can do it before any of the atoms was true."""
        single = atoms & (atoms - 1) == 0
        for operator in self.of(atoms):
            before = self.needed(operator) if single else operator.preconditions
            if not atoms & (before or 0):
                yield operator

    def needed(self, operator: GroundOperator) -> Bits | None:
        """The landmarks of what an operator needs; None if it can never be applied."""
        found = 0
        for atom in indices(operator.preconditions):
            own = self.landmarks[atom]
            if own is None:
                return None
            found |= own
        return found
