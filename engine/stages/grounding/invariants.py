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
from collections.abc import Iterator, Sequence

from cellwright.engine.model.task import Bits, GroundOperator, indices
from cellwright.engine.stages.grounding.conserving import Conserving
from cellwright.kb.terms import Atom, Term

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
        self.atoms, self.operators = atoms, operators
        self.conserving = Conserving(
            [each.preconditions for each in operators],
            [each.adds for each in operators],
            [each.deletes for each in operators],
            [tuple(effect.adds for effect in each.conditional) for each in operators],
            [each.conditional for each in operators],
            initial,
        )
        self._known: dict[Part, dict[tuple[Term, ...], Bits]] = {}
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
        """The atoms that match a pattern, for each value of its parameters. Many candidates share a pattern."""
        found = self._known.get(part)
        if found is None:
            name, positions = part
            found = self._known[part] = defaultdict(int)
            for (predicate, _), numbers in self.by_predicate.items():
                for number in numbers if predicate == name else ():
                    arguments = self.atoms[number].arguments
                    found[tuple([arguments[position] for position in positions])] |= 1 << number
        return found

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
