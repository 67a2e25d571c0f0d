# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False
"""Expansion of a node of backward search: the predecessors of a set of open conditions.

Plain Python, compiled with the types in `expansion.pxd`.
"""

from typing import Any

from cellwright.engine.kernels.bits import Bits, indices
from cellwright.engine.stages.planning.relaxed_plans import RelaxedPlans

UNKNOWN: Any = object()
Successor = tuple[int, int, int, Bits]
"""Lightness, estimate, operator and open conditions of a node that is not made yet. The lightness
is that of the condition which the operator achieves: the heavier, the lower."""


class Operators:
    """Operators by number, indexed by what they achieve and by the conditions that they conflict
    with.

    `excluded` has for each atom those that cannot be true together with it, `lightness` its
    lightness. The index is the same for every initial state.
    """

    def __init__(self, excluded: list[Bits], lightness: list[int]) -> None:
        self.excluded, self.lightness = excluded, lightness
        self.achievers: list[list[int]] = [[] for _ in excluded]
        self.adds: list[Bits] = []
        self.preconditions: list[Bits] = []
        self.conflicts: list[Bits] = []
        self.charges: list[int] = []

    def copy(self) -> "Operators":
        """An index of its own with the same operators."""
        made = Operators(self.excluded, self.lightness)
        made.achievers = [list(each) for each in self.achievers]
        made.adds, made.preconditions = list(self.adds), list(self.preconditions)
        made.conflicts, made.charges = list(self.conflicts), list(self.charges)
        return made

    def add(self, preconditions: Bits, adds: Bits, deletes: Bits, charge: int) -> None:
        """Index one operator more. One whose conditions exclude each other achieves nothing."""
        number = len(self.charges)
        self.adds.append(adds)
        self.preconditions.append(preconditions)
        self.charges.append(charge)
        self.conflicts.append(self._conflicting(preconditions, adds, deletes))
        if self.consistent(preconditions):
            for atom in indices(adds & ~preconditions):
                self.achievers[atom].append(number)

    def consistent(self, conditions: Bits) -> bool:
        """Whether no two of the conditions exclude each other."""
        for atom in indices(conditions):  # noqa: SIM110 - a compiled loop
            if self.excluded[atom] & conditions:
                return False
        return True

    def _conflicting(self, preconditions: Bits, adds: Bits, deletes: Bits) -> Bits:
        """The conditions that cannot be open directly after an operator.

        These are the atoms that it deletes, the atoms that exclude one that it adds, and the atoms
        that exclude one of its preconditions and that it does not add itself.
        """
        forbidden = deletes
        for atom in indices(preconditions):
            forbidden |= self.excluded[atom]
        forbidden &= ~adds
        for atom in indices(adds):
            forbidden |= self.excluded[atom]
        return forbidden


class Expansion:
    """The successors of open conditions, for one initial state and its relaxed plans."""

    def __init__(self, operators: Operators, relaxed: RelaxedPlans) -> None:
        self._operators, self._relaxed, self._initial = operators, relaxed, relaxed.initial
        self._needs: list[Any] = [UNKNOWN] * len(operators.charges)

    def successors(self, open_: Bits, room: int) -> list[Successor]:
        """The successors whose operator and estimate together cost less than `room`.

        An operator counts for the heaviest unsatisfied condition that it achieves. An operator that
        achieves only conditions that hold initially comes last.
        """
        lightness = self._operators.lightness
        unsatisfied = sorted(indices(open_ & ~self._initial), key=lightness.__getitem__)
        plans = [self._relaxed.to(atom) or 0 for atom in unsatisfied]
        after = [0] * (len(plans) + 1)  # the union of the plans from each place on
        for place in range(len(plans) - 1, -1, -1):
            after[place] = after[place + 1] | plans[place]
        found: list[Successor] = []
        several: set[int] = set()
        before = 0
        for place in range(len(plans)):
            atom = unsatisfied[place]
            self._achieve(
                found, open_, atom, lightness[atom], before | after[place + 1], room, several
            )
            before |= plans[place]
        for atom in indices(open_ & self._initial):
            self._achieve(found, open_, atom, 1, before, room, several)
        return found

    def _achieve(
        self,
        found: list[Successor],
        open_: Bits,
        atom: int,
        lightness: int,
        others: Bits,
        room: int,
        several: set[int],
    ) -> None:
        """Add the successors by operators that achieve one condition; `others` is the relaxed
        plan of all other conditions.
        """
        operators = self._operators
        achievers = operators.achievers[atom]
        for number in achievers:
            if operators.conflicts[number] & open_:
                continue
            plan = self._needs[number]
            if plan is UNKNOWN:
                plan = self._needs[number] = self._relaxed.plan(operators.preconditions[number])
            if plan is None:
                continue
            achieved, rest = open_ & operators.adds[number], others
            if achieved & (achieved - 1):
                if number in several:
                    continue
                several.add(number)
                rest = self._relaxed.plan(open_ & ~achieved) or 0
            estimate, charge = (plan | rest).bit_count(), operators.charges[number]
            if charge + estimate < room:
                conditions = open_ & ~achieved | operators.preconditions[number]
                found.append((lightness, estimate, number, conditions))
