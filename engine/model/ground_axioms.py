"""Quantities and derived atoms of a ground task: sums, comparisons, axioms in layers.

An atom may depend on others of its own layer, but needs only those of earlier layers to be false
(Apt, Blair & Walker 1988). A state is `closed` if exactly those derived atoms are in it that follow
from its fluents.
"""

from array import array
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import TypeAlias

from cellwright.engine.kernels.axioms import Closure, Upkeep
from cellwright.engine.kernels.bits import Bits, bitset, indices
from cellwright.engine.kernels.sums import Comparisons
from cellwright.kb.terms import Atom, Function, Number

COMPARED_WITH_ZERO: dict[str, Callable[[int], bool]] = {
    "=": lambda value: value == 0,
    "!=": lambda value: value != 0,
    "<": lambda value: value < 0,
    "<=": lambda value: value <= 0,
    ">": lambda value: value > 0,
    ">=": lambda value: value >= 0,
}


COMPARISON_SIGNS = ("=", "!=", "<", "<=", ">", ">=")  # as the kernel of comparisons numbers them
OPPOSITE_SIGNS = {"=": "!=", "!=": "=", "<": ">=", ">=": "<", ">": "<=", "<=": ">"}


def never_holds(relation: str, low: int, high: int) -> bool:
    """Whether no number from `low` to `high` compares with 0 as a relation says."""
    match relation:
        case "=":
            return low > 0 or high < 0
        case "!=":
            return low == high == 0
        case ">" | ">=":
            return high < 0 or (relation == ">" and high == 0)
        case _:
            return low > 0 or (relation == "<" and low == 0)


# for the atom of each value: the number of its quantity, and the value
Met = dict[int, tuple[int, int]]
UNBOUNDED_VALUE = 1 << 62  # more than any value


@dataclass(eq=False)
class QuantityLevel:
    """One quantity, from `low` to `high`: the one with `number` among those of its task.

    It appends the atoms of the values that are met to `names`, the atoms of the task, and notes
    them in `met`.
    """

    quantity: Function
    low: int
    high: int
    names: list[Atom]
    met: Met
    number: int
    mask: Bits = 0
    _bits: dict[int, Bits] = field(default_factory=dict)
    _values: dict[Bits, int] = field(default_factory=dict)

    def bit(self, value: int) -> Bits:
        """The bitset of the atom for a value."""
        if value not in self._bits:
            bit = self._bits[value] = 1 << len(self.names)
            self.met[len(self.names)] = (self.number, value)
            self.names.append(
                Function(self.quantity.name, (*self.quantity.arguments, Number(value)))
            )
            self._values[bit] = value
            self.mask |= bit
        return self._bits[value]

    def of(self, state: Bits) -> int:
        """The value in a state."""
        return self._values[state & self.mask]


@dataclass(frozen=True)
class Linear:
    """A sum of quantities, each with a factor, and a constant."""

    parts: tuple[tuple[QuantityLevel, int], ...]
    constant: int

    def of(self, state: Bits) -> int:
        """The value in a state."""
        return self.constant + sum(factor * level.of(state) for level, factor in self.parts)

    def without(self, level: QuantityLevel) -> "Linear":
        """What is left if a quantity is subtracted once."""
        return self.plus(Linear(((level, 1),), 0), -1)

    def plus(self, other: "Linear", factor: int) -> "Linear":
        """The sum with another one, multiplied."""
        factors = dict(self.parts)
        for level, own_factor in other.parts:
            factors[level] = factors.get(level, 0) + factor * own_factor
        parts = tuple((level, sum_factor) for level, sum_factor in factors.items() if sum_factor)
        return Linear(parts, self.constant + factor * other.constant)

    def range(self) -> tuple[int, int]:
        """The least and the greatest value within the ranges of the quantities."""
        ends = [sorted((factor * level.low, factor * level.high)) for level, factor in self.parts]
        return self.constant + sum(low for low, _ in ends), self.constant + sum(
            high for _, high in ends
        )


@dataclass(frozen=True)
class Comparing:
    """The derived atom `atom` is true where the sum compares with 0 as `relation` says."""

    atom: int
    sum: Linear
    relation: str

    def holds(self, state: Bits) -> bool:
        """Whether it is true in a state."""
        return COMPARED_WITH_ZERO[self.relation](self.sum.of(state))

    @property
    def settled(self) -> bool | None:
        """Whether it is always true, or never, within the ranges of the quantities; None if
        values decide.
        """
        ends = self.sum.range()
        return (
            False
            if never_holds(self.relation, *ends)
            else True
            if never_holds(OPPOSITE_SIGNS[self.relation], *ends)
            else None
        )

    def read(self, state: Bits) -> Bits:
        """The values in a state on which this depends."""
        met_atoms = 0
        for level, _ in self.sum.parts:
            met_atoms |= state & level.mask
        return met_atoms

    def helped(self, change: "QuantityAssignment") -> tuple[bool, bool]:
        """Whether a change may make this true, and whether it may make it false."""
        factor = dict(self.sum.parts).get(change.level, 0)
        low, high = change.to.without(change.level).range()
        up, down = (high > 0, low < 0) if factor > 0 else (low < 0, high > 0)
        if not factor or not (up or down):
            return False, False
        rises, falls = self.relation in (">", ">="), self.relation in ("<", "<=")
        return (up if rises else down if falls else True), (
            down if rises else up if falls else True
        )


def values_of(state: Bits, met: Met, count: int) -> "array[int]":
    """The values of all quantities in a state, by their numbers."""
    level_values = array("q", bytes(8 * count))
    if not met:
        return level_values
    first = next(iter(met))
    for place in indices(state >> first):
        if (level_value := met.get(first + place)) is not None:
            level_values[level_value[0]] = level_value[1]
    return level_values


@dataclass(frozen=True)
class QuantityAssignment:
    """A step sets a quantity to the value of a sum in the state before."""

    level: QuantityLevel
    to: Linear


def apply_changes(state: Bits, before: Bits, changes: tuple[QuantityAssignment, ...]) -> Bits:
    """A state with the new values of quantities; `before` is the state before the step."""
    for assignment in changes:
        state = state & ~assignment.level.mask | assignment.level.bit(assignment.to.of(before))
    return state


def helped_atoms(
    changes: tuple[QuantityAssignment, ...],
    tests: tuple[Comparing, ...],
    complements: Mapping[int, int],
) -> Bits:
    """The derived atoms that changes may make true, at once or in time, with complementary
    atoms.
    """
    helped = 0
    for change in changes:
        for test in tests:
            makes, breaks = test.helped(change)
            if makes:
                helped |= 1 << test.atom
            if breaks and test.atom in complements:
                helped |= 1 << complements[test.atom]
    return helped


Compiled: TypeAlias = tuple[
    int, list[int], list[list[int]], list[int], list[list[tuple[int, int]]], list[int]
]  # what the kernels take


@dataclass(frozen=True)
class GroundAxiom:
    """A ground rule: `head` is true where all atoms in `body` are."""

    head: int
    body: Bits


@dataclass(frozen=True)
class Axioms:
    """The derived atoms of a task with `size` atoms.

    `layers` has the layer of each derived atom: atoms that depend on one another have the same one.
    `rules` are in the order of the layers of their heads. `complements` leads from each atom that
    has a complementary atom to it; those of derived atoms are derived, too.
    """

    size: int
    rules: tuple[GroundAxiom, ...]
    layers: Mapping[int, int]
    complements: Mapping[int, int]
    tests: tuple[Comparing, ...] = ()  # derived atoms that compare quantities

    def __getstate__(self) -> dict[str, object]:
        """What another process needs; it computes the rest anew."""
        return {each.name: getattr(self, each.name) for each in fields(self)}

    @cached_property
    def derived(self) -> Bits:
        """The derived atoms and their complementary atoms."""
        return self._ruled | bitset([*self._tested, *self._opposed(self._tested)])

    @cached_property
    def _ruled(self) -> Bits:
        return bitset([*self.layers, *self._opposed(self.layers)])

    @cached_property
    def _tested(self) -> Mapping[int, Comparing]:
        return {test.atom: test for test in self.tests}

    def _opposed(self, atoms: Iterable[int]) -> list[int]:
        return [self.complements[atom] for atom in atoms if atom in self.complements]

    @cached_property
    def read_by_rules(self) -> Bits:
        """The atoms that are in bodies of rules."""
        true_atoms = 0
        for rule in self.rules:
            true_atoms |= rule.body
        return true_atoms

    @cached_property
    def read(self) -> Bits:
        """The fluents on which derived atoms depend."""
        return self.read_by_rules & ~self.derived

    def may_change(self, moved: Bits) -> bool:
        """Whether derived atoms depend on one of these atoms, which became true or false;
        values of quantities come last.
        """
        return bool(moved & self.read or (self.tests and moved >> self.size))

    @cached_property
    def by_head(self) -> Mapping[int, list[GroundAxiom]]:
        """The rules of each derived atom."""
        rules_by_head: dict[int, list[GroundAxiom]] = {atom: [] for atom in self.layers}
        for rule in self.rules:
            rules_by_head[rule.head].append(rule)
        return rules_by_head

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
        negated: list[list[tuple[int, int]]] = [
            [] for _ in range(1 + max(self.layers.values(), default=0))
        ]
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
        parts = [
            [(level.number, factor) for level, factor in test.sum.parts] for test in self.tests
        ]
        relations = [COMPARISON_SIGNS.index(test.relation) for test in self.tests]
        atoms = [test.atom for test in self.tests]
        others = [self.complements.get(atom, -1) for atom in atoms]
        constants = [test.sum.constant for test in self.tests]
        return Comparisons(parts, constants, relations, atoms, others, self._width)

    @cached_property
    def _met(self) -> Met:
        return next((level.met for test in self.tests for level, _ in test.sum.parts), {})

    @cached_property
    def _quantities(self) -> int:
        return 1 + max((number for number, _ in self._met.values()), default=-1)

    def values(self, state: Bits) -> "array[int]":
        """The values of all quantities in a state, by their numbers. There must be comparisons."""
        return values_of(state, self._met, self._quantities)

    def helps(self, changes: tuple[QuantityAssignment, ...]) -> Bits:
        """The comparisons that changes of quantities may make true, and those that they may
        make false.
        """
        return helped_atoms(changes, self.tests, self.complements) if changes else 0

    def closed(self, state: Bits) -> Bits:
        """The state with the derived atoms that follow from its fluents, and no others."""
        compared = (
            int.from_bytes(self.comparisons.true(self.values(state)), "little") if self.tests else 0
        )
        fluents = (1 << self.size) - 1 & ~self.derived
        return self._followed(state & fluents | compared) | state >> self.size << self.size

    def _followed(self, state: Bits) -> Bits:
        return int.from_bytes(self.closure.close(state.to_bytes(self._width, "little")), "little")

    def support(self, state: Bits, conditions: Bits) -> Bits:
        """Fluents of a closed state which make its atoms `conditions` true in every state that
        has these fluents.
        """
        self.closed(state)
        by = self.closure.by
        support, seen, waiting = 0, 0, conditions
        while waiting:
            own = waiting & self.derived
            support |= waiting & ~own
            own, compared = own & self._ruled, own & ~self._ruled
            for atom in indices(compared):
                support |= self._test_of(atom).read(state)
            seen |= own
            waiting = 0
            for atom in indices(own):
                reasons = (
                    self.rules[by[atom]].body
                    if atom in self.layers
                    else self._broken(atom, state, support | seen)
                )
                waiting |= reasons & ~seen
        return support

    def _test_of(self, atom: int) -> Comparing:
        """The comparison of a derived atom, or of a complementary one."""
        return self._tested[atom if atom in self._tested else self.opposite[atom]]

    def _broken(self, complement: int, state: Bits, given: Bits) -> Bits:
        """What is true in a state and breaks every rule of the derived atom with a complementary
        atom.

        What is `given` anyway is preferred, then fluents.
        """
        broken = 0
        for rule in self.by_head[self.opposite[complement]]:
            against = bitset([self.opposite[atom] for atom in indices(rule.body & ~state)])
            if not against & (given | broken):
                choice = against & ~self.derived or against
                broken |= choice & -choice
        return broken


def relax_axioms(axioms: Axioms, first: int) -> Iterator[tuple[Bits, Bits, bool]]:
    """What derived atoms follow from if nothing ever becomes false: (conditions, what they make
    true, whether for certain).

    A derived atom is false where each of its rules is broken. Whether a rule is broken are new
    atoms from `first` on. A rule that needs an atom of its own layer is taken as broken: this may
    be wrong, so that the atom is not false for certain.
    """
    for rule in axioms.rules:
        yield rule.body, 1 << rule.head, True
    for atom, rules in axioms.by_head.items():
        if atom not in axioms.complements:
            continue
        needed, certain = 0, True
        for rule in rules:
            body = indices(rule.body)
            if any(axioms.layers.get(rule_atom) == axioms.layers[atom] for rule_atom in body):
                certain = False
                continue
            for body_atom in body:
                yield 1 << axioms.opposite[body_atom], 1 << first, True
            needed |= 1 << first
            first += 1
        yield needed, 1 << axioms.complements[atom], certain
