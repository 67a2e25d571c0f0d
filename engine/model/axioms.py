"""Derived atoms that stay in a ground task: their rules in layers, and why one of them is true or false in a state.

An atom may depend on others of its own layer, but needs only those of earlier layers to be false (Apt, Blair & Walker 1988).
A state is `closed` if exactly those derived atoms are in it that follow from its fluents.
"""

from array import array
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

from cellwright.engine.kernels.axioms import Closure, Upkeep
from cellwright.engine.kernels.bits import Bits, bitset, indices
from cellwright.engine.kernels.sums import Comparisons
from cellwright.engine.model.quantities import RELATIONS, Assignment, Comparing, Met, helps, values_of

Compiled: TypeAlias = tuple[
    int, list[int], list[list[int]], list[int], list[list[tuple[int, int]]], list[int]
]  # what the kernels take


@dataclass(frozen=True)
class Axiom:
    """A ground rule: `head` is true where all atoms in `body` are."""

    head: int
    body: Bits


@dataclass(frozen=True)
class Axioms:
    """The derived atoms of a task with `size` atoms.

    `layers` has the layer of each derived atom: atoms that depend on one another have the same one. `rules` are in the order of the layers of their heads. `complements` leads
    from each atom that has a complementary atom to it; those of derived atoms are derived, too.
    """

    size: int
    rules: tuple[Axiom, ...]
    layers: Mapping[int, int]
    complements: Mapping[int, int]
    tests: tuple[Comparing, ...] = ()  # derived atoms that compare quantities

    @cached_property
    def derived(self) -> Bits:
        """The derived atoms and their complementary atoms."""
        return self._ruled | bitset([*self._tested, *self._opposed(self._tested)])

    @cached_property
    def _ruled(self) -> Bits:
        return bitset([*self.layers, *self._opposed(self.layers)])

    @cached_property
    def _tested(self) -> Mapping[int, Comparing]:
        return {each.atom: each for each in self.tests}

    def _opposed(self, atoms: Iterable[int]) -> list[int]:
        return [self.complements[atom] for atom in atoms if atom in self.complements]

    @cached_property
    def read_by_rules(self) -> Bits:
        """The atoms that are in bodies of rules."""
        found = 0
        for rule in self.rules:
            found |= rule.body
        return found

    @cached_property
    def read(self) -> Bits:
        """The fluents on which derived atoms depend."""
        return self.read_by_rules & ~self.derived

    def may_change(self, moved: Bits) -> bool:
        """Whether derived atoms depend on one of these atoms, which became true or false; values of quantities come last."""
        return bool(moved & self.read or (self.tests and moved >> self.size))

    @cached_property
    def by_head(self) -> Mapping[int, list[Axiom]]:
        """The rules of each derived atom."""
        found: dict[int, list[Axiom]] = {atom: [] for atom in self.layers}
        for rule in self.rules:
            found[rule.head].append(rule)
        return found

    @cached_property
    def opposite(self) -> Mapping[int, int]:
        """For each atom with a complementary atom the latter; and the reverse."""
        return {**self.complements, **{other: atom for atom, other in self.complements.items()}}

    @cached_property
    def _width(self) -> int:
        return (self.size + 7) // 8

    @cached_property
    def closure(self) -> Closure:
        """The rules as a compiled kernel."""
        return Closure(*self._compiled())

    def upkeep(self) -> Upkeep:
        """The rules as a compiled kernel that keeps the last state it was asked about."""
        return Upkeep(*self._compiled())

    def _compiled(self) -> Compiled:
        negated: list[list[tuple[int, int]]] = [[] for _ in range(1 + max(self.layers.values(), default=0))]
        for atom, layer in self.layers.items():
            if atom in self.complements:
                negated[layer].append((atom, self.complements[atom]))
        heads = [rule.head for rule in self.rules]
        bodies = [indices(rule.body) for rule in self.rules]
        layers = [self.layers[head] for head in heads]
        return self.size, heads, bodies, layers, negated, indices(self._ruled)

    @cached_property
    def comparisons(self) -> Comparisons:
        """The comparisons of quantities as a compiled kernel, in the order of `tests`."""
        parts = [[(level.number, factor) for level, factor in each.sum.parts] for each in self.tests]
        relations = [RELATIONS.index(each.relation) for each in self.tests]
        atoms = [each.atom for each in self.tests]
        others = [self.complements.get(atom, -1) for atom in atoms]
        constants = [each.sum.constant for each in self.tests]
        return Comparisons(parts, constants, relations, atoms, others, self._width)

    @cached_property
    def _met(self) -> Met:
        return next((level.met for each in self.tests for level, _ in each.sum.parts), {})

    @cached_property
    def _quantities(self) -> int:
        return 1 + max((number for number, _ in self._met.values()), default=-1)

    def values(self, state: Bits) -> "array[int]":
        """The values of all quantities in a state, by their numbers. There must be comparisons."""
        return values_of(state, self._met, self._quantities)

    def helps(self, changes: tuple[Assignment, ...]) -> Bits:
        """The comparisons that changes of quantities may make true, and those that they may make false."""
        return helps(changes, self.tests, self.complements) if changes else 0

    def closed(self, state: Bits) -> Bits:
        """The state with the derived atoms that follow from its fluents, and no others."""
        if not self.tests:
            return self._followed(state)
        compared = int.from_bytes(self.comparisons.true(self.values(state)), "little")
        fluents = (1 << self.size) - 1 & ~self.derived
        return self._followed(state & fluents | compared) | state >> self.size << self.size

    def _followed(self, state: Bits) -> Bits:
        return int.from_bytes(self.closure.close(state.to_bytes(self._width, "little")), "little")

    def support(self, state: Bits, conditions: Bits) -> Bits:
        """Fluents of a closed state which make its atoms `conditions` true in every state that has these fluents."""
        self.closed(state)
        by = self.closure.by
        found, seen, waiting = 0, 0, conditions
        while waiting:
            own = waiting & self.derived
            found |= waiting & ~own
            own, compared = own & self._ruled, own & ~self._ruled
            for atom in indices(compared):
                found |= self._test_of(atom).read(state)
            seen |= own
            waiting = 0
            for atom in indices(own):
                reasons = (
                    self.rules[by[atom]].body
                    if atom in self.layers
                    else self._broken(atom, state, found | seen)
                )
                waiting |= reasons & ~seen
        return found

    def _test_of(self, atom: int) -> Comparing:
        """The comparison of a derived atom, or of a complementary one."""
        return self._tested[atom if atom in self._tested else self.opposite[atom]]

    def _broken(self, complement: int, state: Bits, given: Bits) -> Bits:
        """What is true in a state and breaks every rule of the derived atom with a complementary atom.

        What is `given` anyway is preferred, then fluents.
        """
        found = 0
        for rule in self.by_head[self.opposite[complement]]:
            against = bitset([self.opposite[atom] for atom in indices(rule.body & ~state)])
            if not against & (given | found):
                choice = against & ~self.derived or against
                found |= choice & -choice
        return found


def relaxed(axioms: Axioms, first: int) -> Iterator[tuple[Bits, Bits, bool]]:
    """What derived atoms follow from if nothing ever becomes false: (conditions, what they make true, whether for certain).

    A derived atom is false where each of its rules is broken. Whether a rule is broken are new atoms from `first` on. A rule
    that needs an atom of its own layer is taken as broken: this may be wrong, so that the atom is not false for certain.
    """
    for rule in axioms.rules:
        yield rule.body, 1 << rule.head, True
    for atom, rules in axioms.by_head.items():
        if atom not in axioms.complements:
            continue
        needed, certain = 0, True
        for rule in rules:
            body = indices(rule.body)
            if any(axioms.layers.get(each) == axioms.layers[atom] for each in body):
                certain = False
                continue
            for each in body:
                yield 1 << axioms.opposite[each], 1 << first, True
            needed |= 1 << first
            first += 1
        yield needed, 1 << axioms.complements[atom], certain
