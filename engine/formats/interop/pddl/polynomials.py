"""Arithmetic of PDDL as polynomials with exact coefficients, and the units in which functions are whole numbers.

A monomial is a tuple of functions; the empty one stands for the number 1. What a function is does not matter here.
"""

import math
import re
from collections.abc import Callable, Iterable, Mapping
from fractions import Fraction
from typing import Generic, NamedTuple, TypeVar

from cellwright.engine.formats.interop.pddl.expressions import Expression, Group, Word

Key = TypeVar("Key")
FINEST = 10**6  # parts into which a unit may be divided
LARGEST = 2**31 - 1
_NUMBER = re.compile(r"[+-]?(?:[0-9]{1,15}(?:\.[0-9]{0,12})?|\.[0-9]{1,12})")
ARITHMETIC = ("+", "-", "*", "/")


class Unreadable(Exception):
    """Arithmetic that cannot be read: where, and why."""

    def __init__(self, at: Expression, why: str) -> None:
        super().__init__(why)
        self.at, self.why = at, why


class Polynomial(Generic[Key]):
    """A sum of monomials, each with its coefficient; those with the coefficient 0 are left out."""

    def __init__(self, parts: Mapping[tuple[Key, ...], Fraction]) -> None:
        self.parts = {monomial: factor for monomial, factor in parts.items() if factor}

    @classmethod
    def number(cls, value: Fraction) -> "Polynomial[Key]":
        """A polynomial without functions."""
        return cls({(): value})

    @property
    def constant(self) -> Fraction | None:
        """The value, if no function occurs."""
        return self.parts.get((), Fraction(0)) if not any(self.parts) else None

    @property
    def keys(self) -> set[Key]:
        """The functions that occur."""
        return {key for monomial in self.parts for key in monomial}

    def __add__(self, other: "Polynomial[Key]") -> "Polynomial[Key]":
        found = dict(self.parts)
        for monomial, factor in other.parts.items():
            found[monomial] = found.get(monomial, Fraction(0)) + factor
        return Polynomial(found)

    def __mul__(self, other: "Polynomial[Key]") -> "Polynomial[Key]":
        found: dict[tuple[Key, ...], Fraction] = {}
        for one, first in self.parts.items():
            for two, second in other.parts.items():
                monomial = tuple(sorted((*one, *two), key=str))
                found[monomial] = found.get(monomial, Fraction(0)) + first * second
        return Polynomial(found)

    def times(self, factor: Fraction) -> "Polynomial[Key]":
        """The polynomial with each coefficient multiplied."""
        return Polynomial({monomial: factor * each for monomial, each in self.parts.items()})


def number_of(at: Expression) -> Fraction | None:
    """The number that is written here, exactly; None if this is something else."""
    return Fraction(at.text) if isinstance(at, Word) and _NUMBER.fullmatch(at.text) else None


def polynomial(at: Expression, key: Callable[[Group], Key]) -> Polynomial[Key]:
    """The polynomial that an expression is; `key` reads a function. Raises `Unreadable`."""
    if (value := number_of(at)) is not None:
        return Polynomial.number(value)
    if isinstance(at, Word):
        return Polynomial({(key(Group((at,), at.offset)),): Fraction(1)})  # a function without arguments
    if at.head not in ARITHMETIC:
        return Polynomial({(key(at),): Fraction(1)})
    parts = [polynomial(part, key) for part in at.rest]
    if not parts or (at.head == "/" and len(parts) != 2):
        raise Unreadable(at, f"'{at.head}' has a wrong number of arguments")
    return _calculated(at, parts)


def _calculated(at: Group, parts: list[Polynomial[Key]]) -> Polynomial[Key]:
    first, *others = parts
    if at.head == "-":
        return (
            sum((each.times(Fraction(-1)) for each in others), first) if others else first.times(Fraction(-1))
        )
    for each in others:
        if at.head == "+":
            first = first + each
        elif at.head == "*":
            first = first * each
        elif not (divisor := each.constant):
            raise Unreadable(at, "divisions are by numbers other than 0")
        else:
            first = first.times(1 / divisor)
    return first


class Growth(NamedTuple):
    """An effect adds or assigns `amount` to the function `name`."""

    name: str
    amount: Polynomial[str]
    at: Group


def units(values: Mapping[str, Iterable[Fraction]], growths: Iterable[Growth]) -> dict[str, int]:
    """For each function the number of parts of 1 in which it counts, so that `values` and all it becomes are whole.

    Raises `Unreadable` if no number of parts is fine enough.
    """
    found = {name: math.lcm(1, *(each.denominator for each in given)) for name, given in values.items()}
    waiting = list(growths)
    moved = True
    while moved:
        moved = False
        for each in waiting:
            finer = math.lcm(found.get(each.name, 1), *denominators(each.amount, found))
            if finer > FINEST:
                raise Unreadable(each.at, f"{each.name} would take values finer than a millionth")
            moved |= finer != found.get(each.name, 1)
            found[each.name] = finer
    return found


def denominators(amount: Polynomial[str], units: Mapping[str, int]) -> list[int]:
    """What must divide the parts of 1 in which an amount counts, if functions count in `units`."""
    return [
        (factor / math.prod(units.get(name, 1) for name in monomial)).denominator
        for monomial, factor in amount.parts.items()
    ]
