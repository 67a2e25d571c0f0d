"""Mutex groups by invariant synthesis (Helmert 2009), and conditional effects that they rule out.

A candidate is a set of atom patterns. Each pattern is a predicate with at most one counted
argument; its other arguments are the parameters of the invariant. If an operator would break a
candidate by adding an atom, the candidate is refined: it gets one more pattern, which this operator
consumes. Candidates are made from predicates, but they are verified on ground operators, for one
instance of the parameters at a time. So an instance may be an invariant where the whole schema is
not.
"""

import itertools
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from cellwright.engine.kernels.bits import Bits, indices
from cellwright.engine.model.ground_task import GroundOperator
from cellwright.engine.stages.grounding.invariant_loops import Conserving
from cellwright.kb.terms import Atom, Term

# predicate, and the argument position of each invariant parameter
Part = tuple[str, tuple[int, ...]]
Candidate = frozenset[Part]
MAX_CANDIDATES = 300


def mutex_groups(
    atoms: Sequence[Atom], operators: Sequence[GroundOperator], initial: Bits, derived: Bits = 0
) -> tuple[Bits, ...]:
    """Sets of at least two atoms of which at most one is true in every reachable state, largest
    first.

    No atom that is `derived` is in them: no operator adds it.
    """
    search = _InvariantSearch(atoms, operators, initial, derived)
    groups = search.run()
    maximal_groups: list[Bits] = []
    for group in sorted(set(groups), key=lambda bits: (-bits.bit_count(), bits)):
        if group.bit_count() > 1 and not any(
            group & ~larger_group == 0 for larger_group in maximal_groups
        ):
            maximal_groups.append(group)
    return tuple(maximal_groups)


class _InvariantSearch:
    def __init__(
        self,
        atoms: Sequence[Atom],
        operators: Sequence[GroundOperator],
        initial: Bits,
        derived: Bits,
    ) -> None:
        self.atoms, self.operators = atoms, operators
        self.conserving = Conserving(
            [operator.preconditions for operator in operators],
            [operator.adds for operator in operators],
            [operator.deletes for operator in operators],
            [tuple(effect.adds for effect in operator.conditional) for operator in operators],
            [operator.conditional for operator in operators],
            initial,
        )
        self._known: dict[Part, dict[tuple[Term, ...], Bits]] = {}
        self.by_predicate: dict[tuple[str, int], list[int]] = defaultdict(list)
        for number, atom in enumerate(atoms):
            if not derived >> number & 1:
                self.by_predicate[(atom.name, len(atom.arguments))].append(number)

    def run(self) -> Iterator[Bits]:
        queue = [
            frozenset([part])
            for signature in self.by_predicate
            for part in _predicate_parts(*signature)
        ]
        seen = set(queue)
        position = 0
        while position < len(queue) and position < MAX_CANDIDATES:
            candidate = queue[position]
            position += 1
            refinements: set[Candidate] = set()
            for group in self._instances(candidate):
                blame = self.conserving.broken_by(group)
                if blame is None:
                    yield group
                    blame = self.conserving.adding_without_taking(group)
                if blame >= 0:
                    refinements |= set(self._refined(candidate, group, self.operators[blame]))
            for refined in sorted(refinements - seen, key=sorted):
                seen.add(refined)
                queue.append(refined)

    def _instances(self, candidate: Candidate) -> list[Bits]:
        """The candidate's groups of atoms, one group for each value of its parameters."""
        groups: dict[tuple[Term, ...], Bits] = defaultdict(int)
        for part in sorted(candidate):
            for parameters, atoms in self._grouped(part).items():
                groups[parameters] |= atoms
        return list(groups.values())

    def _grouped(self, part: Part) -> dict[tuple[Term, ...], Bits]:
        """The atoms that match a pattern, for each value of its parameters.

        Many candidates share a pattern.
        """
        groups = self._known.get(part)
        if groups is None:
            name, positions = part
            groups = self._known[part] = defaultdict(int)
            for (predicate, _), numbers in self.by_predicate.items():
                for number in numbers if predicate == name else ():
                    arguments = self.atoms[number].arguments
                    groups[tuple([arguments[position] for position in positions])] |= 1 << number
        return groups

    def _refined(
        self, candidate: Candidate, group: Bits, operator: GroundOperator
    ) -> Iterator[Candidate]:
        """The candidate with one more pattern, for each pattern that fits what the operator
        consumes.
        """
        if (operator.adds & group).bit_count() > 1:
            return
        present = {name for name, _ in candidate}
        arity = len(next(iter(candidate))[1])
        parameters = self._parameters(candidate, operator.adds & group)
        for number in indices(operator.preconditions & operator.deletes & ~group):
            atom = self.atoms[number]
            if atom.name in present or parameters is None:
                continue
            for part in _predicate_parts(atom.name, len(atom.arguments), arity):
                if tuple(atom.arguments[position] for position in part[1]) == parameters:
                    yield candidate | {part}

    def _parameters(self, candidate: Candidate, added: Bits) -> tuple[Term, ...] | None:
        for number in indices(added):
            for name, positions in candidate:
                if self.atoms[number].name == name:
                    return tuple(self.atoms[number].arguments[position] for position in positions)
        return None


def _predicate_parts(name: str, arity: int, parameters: int | None = None) -> Iterator[Part]:
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


def drop_impossible_effects(
    operators: Iterable[GroundOperator], groups: Iterable[Bits]
) -> Iterator[GroundOperator]:
    """The operators with those conditional effects that may happen, by mutex groups.

    The groups may overlap.
    """
    excluded: dict[int, Bits] = {}
    for group in groups:
        for atom in indices(group):
            excluded[atom] = excluded.get(atom, 0) | group & ~(1 << atom)
    for operator in operators:
        yield _without_impossible_effects(operator, excluded) if operator.conditional else operator


def _without_impossible_effects(
    operator: GroundOperator, excluded: dict[int, Bits]
) -> GroundOperator:
    against = _excluded_atoms(operator.preconditions, excluded)
    possible_effects = [
        effect
        for effect in operator.conditional
        if not effect.condition & (against | _excluded_atoms(effect.condition, excluded))
    ]
    return (
        operator
        if len(possible_effects) == len(operator.conditional)
        else replace(operator, conditional=tuple(possible_effects))
    )


def _excluded_atoms(atoms: Bits, excluded: dict[int, Bits]) -> Bits:
    """What is never true together with all of these atoms."""
    never_true = 0
    for atom in indices(atoms):
        never_true |= excluded.get(atom, 0)
    return never_true
