"""Mutex groups by invariant synthesis, after Helmert, "Concise finite-domain representations for PDDL
planning tasks" (Artificial Intelligence 173, 2009).

A candidate is a set of atom patterns. Each pattern is a predicate with at most one counted argument; its
other arguments are the parameters of the invariant. If an operator would break a candidate by adding an atom,
the candidate is refined: it gets one more pattern, which this operator consumes. Candidates are made from
predicates, but they are verified on ground operators, for one instance of the parameters at a time. So an
instance may be an invariant where the whole schema is not.
"""

import itertools
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence

from engine.model.task import Bits, ConditionalEffect, GroundOperator, indices
from kb.terms import Atom, Term

Part = tuple[str, tuple[int, ...]]  # predicate, and the argument position of each invariant parameter
Candidate = frozenset[Part]
MAX_CANDIDATES = 300


def mutex_groups(
    atoms: Sequence[Atom], operators: Sequence[GroundOperator], initial: Bits, derived: Bits = 0
) -> tuple[Bits, ...]:
    """Sets of at least two atoms of which at most one is true in every reachable state, largest first.

    No atom that is `derived` is in them: no operator adds it.
    """
    search = _Search(atoms, operators, initial, derived)
    found = search.run()
    kept: list[Bits] = []
    for group in sorted(set(found), key=lambda bits: (-bits.bit_count(), bits)):
        if group.bit_count() > 1 and not any(group & ~other == 0 for other in kept):
            kept.append(group)
    return tuple(kept)


class _Search:
    def __init__(
        self, atoms: Sequence[Atom], operators: Sequence[GroundOperator], initial: Bits, derived: Bits
    ) -> None:
        self.atoms, self.operators, self.initial = atoms, operators, initial
        self.adders: dict[int, list[int]] = defaultdict(list)
        alike: dict[tuple[Bits, Bits, tuple[ConditionalEffect, ...]], int] = {}
        self.members: list[list[int]] = []  # per kind its operators; they differ only in preconditions
        self.sets: list[tuple[Bits, Bits]] = []  # per kind what it always adds and deletes
        for number, operator in enumerate(operators):
            kind = alike.setdefault((operator.adds, operator.deletes, operator.conditional), len(alike))
            if kind == len(self.members):
                self.members.append([])
                self.sets.append((0, 0) if operator.conditional else (operator.adds, operator.deletes))
                for atom in indices(_all_adds(operator)):
                    self.adders[atom].append(kind)
            self.members[kind].append(number)
        self.by_predicate: dict[tuple[str, int], list[int]] = defaultdict(list)
        for number, each in enumerate(atoms):
            if not derived >> number & 1:
                self.by_predicate[(each.name, len(each.arguments))].append(number)

    def run(self) -> Iterator[Bits]:
        queue = [frozenset([part]) for signature in self.by_predicate for part in _parts(*signature)]
        seen = set(queue)
        position = 0
        while position < len(queue) and position < MAX_CANDIDATES:
            candidate = queue[position]
            position += 1
            refinements: set[Candidate] = set()
            for group in self._instances(candidate):
                blame = self._broken_by(group)
                if blame is None:
                    yield group
                    blame = self._adding_without_taking(group)
                if blame >= 0:
                    refinements |= set(self._refined(candidate, group, self.operators[blame]))
            for refined in sorted(refinements - seen, key=sorted):
                seen.add(refined)
                queue.append(refined)

    def _instances(self, candidate: Candidate) -> list[Bits]:
        """The candidate's groups of atoms, one group for each value of its parameters."""
        groups: dict[tuple[Term, ...], Bits] = defaultdict(int)
        for name, positions in sorted(candidate):
            for (predicate, _), numbers in self.by_predicate.items():
                if predicate == name:
                    for number in numbers:
                        arguments = self.atoms[number].arguments
                        groups[tuple(arguments[position] for position in positions)] |= 1 << number
        return list(groups.values())

    def _broken_by(self, group: Bits) -> int | None:
        """An operator that breaks the group, -1 for the initial state; None if the group is an invariant."""
        if group & (group - 1) == 0:
            return None
        if (group & self.initial).bit_count() > 1:
            return -1
        return self._first(lambda operator: not keeps(group, operator), self._doubtful(group))

    def _adding(self, group: Bits) -> list[int]:
        """The kinds of operators that add an atom of the group, in the order of their first operators."""
        return sorted(set[int]().union(*(self.adders.get(atom, ()) for atom in indices(group))))

    def _doubtful(self, group: Bits) -> list[int]:
        """The kinds of operators that add an atom of the group and may leave several of its atoms true.

        A kind is safe if it adds exactly one atom of the group and deletes all others.
        """
        sets = self.sets
        return [
            kind
            for kind in self._adding(group)
            if (added := sets[kind][0] & group) & (added - 1) or group & ~(added | sets[kind][1])
        ]

    def _first(self, wanted: Callable[[GroundOperator], bool], kinds: Iterable[int]) -> int | None:
        """The lowest number of an operator of these kinds that is wanted; None if there is none."""
        best: int | None = None
        for kind in kinds:
            members = self.members[kind]
            if best is not None and members[0] > best:
                break
            for number in members:
                if wanted(self.operators[number]):
                    best = number if best is None else min(best, number)
                    break
        return best

    def _adding_without_taking(self, group: Bits) -> int:
        """An operator that adds an atom of the group and needs none of it; -1 if there is none.

        What such an operator consumes may belong to the group, too, so it is used to refine the candidate.
        """
        found = self._first(lambda operator: not operator.preconditions & group, self._adding(group))
        return -1 if found is None else found

    def _refined(self, candidate: Candidate, group: Bits, operator: GroundOperator) -> Iterator[Candidate]:
        """The candidate with one more pattern, for each pattern that fits what the operator consumes."""
        if (operator.adds & group).bit_count() > 1:
            return
        present = {name for name, _ in candidate}
        arity = len(next(iter(candidate))[1])
        parameters = self._parameters(candidate, operator.adds & group)
        for number in indices(operator.preconditions & operator.deletes & ~group):
            atom = self.atoms[number]
            if atom.name in present or parameters is None:
                continue
            for part in _parts(atom.name, len(atom.arguments), arity):
                if tuple(atom.arguments[position] for position in part[1]) == parameters:
                    yield candidate | {part}

    def _parameters(self, candidate: Candidate, added: Bits) -> tuple[Term, ...] | None:
        for number in indices(added):
            for name, positions in candidate:
                if self.atoms[number].name == name:
                    return tuple(self.atoms[number].arguments[position] for position in positions)
        return None


def keeps(group: Bits, operator: GroundOperator) -> bool:
    """Whether at most one atom of `group` is true after the operator if at most one was true before."""
    added = _all_adds(operator) & group
    if not added:
        return True
    if added.bit_count() > 1 and not operator.conditional:
        return (operator.preconditions & group).bit_count() > 1  # never applicable
    if added.bit_count() > 1:
        return False
    required = operator.preconditions & group
    if required & (operator.deletes | added) or required & (required - 1):
        return True
    return group & ~added & ~operator.deletes == 0


def _all_adds(operator: GroundOperator) -> Bits:
    adds = operator.adds
    for effect in operator.conditional:
        adds |= effect.adds
    return adds


def _parts(name: str, arity: int, parameters: int | None = None) -> Iterator[Part]:
    """The patterns of a predicate with at most one counted argument.

    If `parameters` is given, only the patterns with that many parameters.
    """
    positions = range(arity)
    for counted in [None, *positions]:
        fixed = [position for position in positions if position != counted]
        if parameters is None:
            yield (name, tuple(fixed))
        elif len(fixed) == parameters:
            yield from ((name, order) for order in itertools.permutations(fixed))
