"""Evaluates conditions and numbers in a state, and lists the atoms and numbers that they read."""

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction

from cellwright.engine.stages.instants.breaches import decimal
from cellwright.kb.model.conditions import (
    And,
    Comparison,
    Condition,
    Exists,
    ForAll,
    Literal,
    Not,
    Or,
    Parameter,
)
from cellwright.kb.model.durative import DURATION, TemporalProblem
from cellwright.kb.terms import (
    Atom,
    Function,
    Number,
    Operation,
    Term,
    Variable,
    substitute_atom,
    substitute_term,
)

Bindings = Mapping[Variable, Term]


class NoValue(Exception):
    """A number is read that has no value. The message names it."""


@dataclass(frozen=True)
class Moments:
    """A state: the true atoms, the values of numbers, and the objects of each type."""

    problem: TemporalProblem
    atoms: frozenset[Atom]
    values: Mapping[Function, Fraction]

    def amount(self, term: Term, bindings: Bindings, duration: Fraction) -> Fraction:
        """The value of a number. Raises `NoValue`."""
        match term:
            case Number(value):
                return Fraction(value)
            case Operation(sign, left, right):
                one, two = (self.amount(each, bindings, duration) for each in (left, right))
                return _calculated(sign, one, two)
            case Function() if term == DURATION:
                return duration
            case Function():
                ground = substitute_atom(term, bindings)
                if ground not in self.values:
                    raise NoValue(f"{ground} has no value")
                return self.values[ground]
            case _:
                raise NoValue(f"{term} is no number")

    def broken(
        self, condition: Condition, bindings: Bindings, duration: Fraction
    ) -> "Broken | None":
        """What of a condition does not hold; None if all of it holds."""
        match condition:
            case And(parts):
                return next(
                    filter(None, (self.broken(part, bindings, duration) for part in parts)), None
                )
            case Comparison() if condition.exact:
                return self._compared(condition, bindings, duration)
            case ForAll(parameters, part):
                every = (
                    self.broken(part, own, duration) for own in self.bindings(parameters, bindings)
                )
                return next(filter(None, every), None)
            case Literal(atom, positive):
                ground = substitute_atom(atom, bindings)
                return (
                    None
                    if (ground in self.atoms) == positive
                    else Broken(str(Literal(ground, positive)))
                )
            case _:
                return (
                    None
                    if self._holds(condition, bindings, duration)
                    else Broken(_said(condition, bindings))
                )

    def _holds(self, condition: Condition, bindings: Bindings, duration: Fraction) -> bool:
        match condition:
            case Or(parts):
                return any(self.broken(part, bindings, duration) is None for part in parts)
            case Not(part):
                return self.broken(part, bindings, duration) is not None
            case Exists(parameters, part):
                every = self.bindings(parameters, bindings)
                return any(self.broken(part, own, duration) is None for own in every)
            case Comparison(left, relation, right):
                same = substitute_term(left, bindings) == substitute_term(right, bindings)
                return same == (relation == "=")
            case _:
                raise TypeError(f"{condition} is no condition with times")

    def _compared(
        self, condition: Comparison, bindings: Bindings, duration: Fraction
    ) -> "Broken | None":
        try:
            left = self.amount(condition.left, bindings, duration)
            right = self.amount(condition.right, bindings, duration)
        except NoValue as lack:
            return Broken(str(lack))
        if _related(left - right, condition.relation):
            return None
        said = (
            f"{_said_term(condition.left, bindings)} {condition.relation} "
            f"{_said_term(condition.right, bindings)}"
        )
        return Broken(f"{said} ({decimal(left)} and {decimal(right)})", abs(left - right))

    def bindings(self, parameters: tuple[Parameter, ...], outer: Bindings) -> Iterator[Bindings]:
        """All bindings of the parameters, beside the outer ones."""
        for row in itertools.product(
            *(self.problem.members(parameter.type) for parameter in parameters)
        ):
            yield {
                **outer,
                **{p.variable: Function(name) for p, name in zip(parameters, row, strict=True)},
            }

    def read(self, condition: Condition, bindings: Bindings) -> Iterator[tuple[str, Function]]:
        """The atoms ("atom") and numbers ("number") that a condition reads."""
        match condition:
            case And(parts) | Or(parts):
                for part in parts:
                    yield from self.read(part, bindings)
            case Not(part):
                yield from self.read(part, bindings)
            case Exists(parameters, part) | ForAll(parameters, part):
                for own in self.bindings(parameters, bindings):
                    yield from self.read(part, own)
            case Literal(atom):
                yield "atom", substitute_atom(atom, bindings)
            case Comparison(left, _, right) if condition.exact:
                yield from (("number", each) for each in numbers_in(left, bindings))
                yield from (("number", each) for each in numbers_in(right, bindings))
            case _:
                return


@dataclass(frozen=True, slots=True)
class Broken:
    """What does not hold, and by how much."""

    said: str
    amount: Fraction | None = None


def numbers_in(term: Term, bindings: Bindings) -> Iterator[Function]:
    """The numbers that a term reads."""
    if isinstance(term, Operation):
        yield from numbers_in(term.left, bindings)
        yield from numbers_in(term.right, bindings)
    elif isinstance(term, Function) and term != DURATION:
        yield substitute_atom(term, bindings)


def _calculated(sign: str, one: Fraction, two: Fraction) -> Fraction:
    match sign:
        case "+":
            return one + two
        case "-":
            return one - two
        case "*":
            return one * two
        case _:
            if two == 0:
                raise NoValue("a division by 0")
            return one / two


def _related(difference: Fraction, relation: str) -> bool:
    match relation:
        case "=":
            return difference == 0
        case "!=":
            return difference != 0
        case "<":
            return difference < 0
        case "<=":
            return difference <= 0
        case ">":
            return difference > 0
        case _:
            return difference >= 0


def _said(condition: Condition, bindings: Bindings) -> str:
    """A condition in words. Variables of quantifiers stay."""
    match condition:
        case Literal(atom, positive):
            return str(Literal(substitute_atom(atom, bindings), positive))
        case And(parts):
            return ", ".join(_said(part, bindings) for part in parts)
        case Or(parts):
            return f"({' | '.join(_said(part, bindings) for part in parts)})"
        case Not(part):
            return f"not {_said(part, bindings)}"
        case Comparison(left, relation, right):
            return f"{_said_term(left, bindings)} {relation} {_said_term(right, bindings)}"
        case Exists(parameters, part):
            return f"some {', '.join(map(str, parameters))} ({_said(part, bindings)})"
        case ForAll(parameters, part):
            return f"every {', '.join(map(str, parameters))} ({_said(part, bindings)})"
        case _:
            return str(condition)


def _said_term(term: Term, bindings: Bindings) -> str:
    return "its duration" if term == DURATION else str(substitute_term(term, bindings))
