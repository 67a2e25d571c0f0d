"""Quantities in a ground task: numbers that operators change.

Each value is an atom, `volume(b1, 4995)`, but only the values that are met get numbers: a state has one of them for each
quantity. Conditions on quantities are derived atoms, so searches look at numbers only where a step changes them.
"""

from array import array
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from cellwright.engine.kernels.bits import Bits, indices
from cellwright.kb.terms import Atom, Function, Number

RELATED: dict[str, Callable[[int], bool]] = {
    "=": lambda value: value == 0,
    "!=": lambda value: value != 0,
    "<": lambda value: value < 0,
    "<=": lambda value: value <= 0,
    ">": lambda value: value > 0,
    ">=": lambda value: value >= 0,
}


RELATIONS = ("=", "!=", "<", "<=", ">", ">=")  # as the kernel of comparisons numbers them
OPPOSITE = {"=": "!=", "!=": "=", "<": ">=", ">=": "<", ">": "<=", "<=": ">"}


def never(relation: str, low: int, high: int) -> bool:
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


Met = dict[int, tuple[int, int]]  # for the atom of each value: the number of its quantity, and the value
UNBOUNDED = 1 << 62  # more than any value


@dataclass(eq=False)
class Level:
    """One quantity, from `low` to `high`: the one with `number` among those of its task.

    It appends the atoms of the values that are met to `names`, the atoms of the task, and notes them in `met`.
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
            self.names.append(Function(self.quantity.name, (*self.quantity.arguments, Number(value))))
            self._values[bit] = value
            self.mask |= bit
        return self._bits[value]

    def of(self, state: Bits) -> int:
        """The value in a state."""
        return self._values[state & self.mask]


@dataclass(frozen=True)
class Linear:
    """A sum of quantities, each with a factor, and a constant."""

    parts: tuple[tuple[Level, int], ...]
    constant: int

    def of(self, state: Bits) -> int:
        """The value in a state."""
        return self.constant + sum(factor * level.of(state) for level, factor in self.parts)

    def without(self, level: Level) -> "Linear":
        """What is left if a quantity is subtracted once."""
        return self.plus(Linear(((level, 1),), 0), -1)

    def plus(self, other: "Linear", factor: int) -> "Linear":
        """The sum with another one, multiplied."""
        found = dict(self.parts)
        for level, each in other.parts:
            found[level] = found.get(level, 0) + factor * each
        parts = tuple((level, each) for level, each in found.items() if each)
        return Linear(parts, self.constant + factor * other.constant)

    def range(self) -> tuple[int, int]:
        """The least and the greatest value within the ranges of the quantities."""
        ends = [sorted((factor * level.low, factor * level.high)) for level, factor in self.parts]
        return self.constant + sum(low for low, _ in ends), self.constant + sum(high for _, high in ends)


@dataclass(frozen=True)
class Comparing:
    """The derived atom `atom` is true where the sum compares with 0 as `relation` says."""

    atom: int
    sum: Linear
    relation: str

    def holds(self, state: Bits) -> bool:
        """Whether it is true in a state."""
        return RELATED[self.relation](self.sum.of(state))

    @property
    def settled(self) -> bool | None:
        """Whether it is always true, or never, within the ranges of the quantities; None if values decide."""
        ends = self.sum.range()
        return (
            False if never(self.relation, *ends) else True if never(OPPOSITE[self.relation], *ends) else None
        )

    def read(self, state: Bits) -> Bits:
        """The values in a state on which this depends."""
        found = 0
        for level, _ in self.sum.parts:
            found |= state & level.mask
        return found

    def helped(self, change: "Assignment") -> tuple[bool, bool]:
        """Whether a change may make this true, and whether it may make it false."""
        factor = dict(self.sum.parts).get(change.level, 0)
        low, high = change.to.without(change.level).range()
        up, down = (high > 0, low < 0) if factor > 0 else (low < 0, high > 0)
        if not factor or not (up or down):
            return False, False
        rises, falls = self.relation in (">", ">="), self.relation in ("<", "<=")
        return (up if rises else down if falls else True), (down if rises else up if falls else True)


def values_of(state: Bits, met: Met, count: int) -> "array[int]":
    """The values of all quantities in a state, by their numbers."""
    found = array("q", bytes(8 * count))
    if not met:
        return found
    first = next(iter(met))
    for place in indices(state >> first):
        if (known := met.get(first + place)) is not None:
            found[known[0]] = known[1]
    return found


@dataclass(frozen=True)
class Assignment:
    """A step sets a quantity to the value of a sum in the state before."""

    level: Level
    to: Linear


def changed(state: Bits, before: Bits, changes: tuple[Assignment, ...]) -> Bits:
    """A state with the new values of quantities; `before` is the state before the step."""
    for each in changes:
        state = state & ~each.level.mask | each.level.bit(each.to.of(before))
    return state


def helps(
    changes: tuple[Assignment, ...], tests: tuple[Comparing, ...], complements: Mapping[int, int]
) -> Bits:
    """The derived atoms that changes may make true, at once or in time, with complementary atoms."""
    found = 0
    for change in changes:
        for test in tests:
            makes, breaks = test.helped(change)
            if makes:
                found |= 1 << test.atom
            if breaks and test.atom in complements:
                found |= 1 << complements[test.atom]
    return found
