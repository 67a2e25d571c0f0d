"""Ground conditions as alternatives of literals and numeric tests; constant parts are evaluated."""

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Set
from dataclasses import dataclass
from fractions import Fraction
from typing import NamedTuple

from cellwright.engine.model.temporal import (
    CONSTANT,
    LENGTH,
    MINUS,
    OVER,
    PLUS,
    TIMES,
    VALUE,
    NumericTest,
    NumericUpdate,
    Program,
)
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.model.condition_forms import RELATION_NEGATIONS
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
from cellwright.kb.model.durative import DURATION
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

MAX_ALTERNATIVES = 256  # of one condition of one instance
SIGNS = {"+": PLUS, "-": MINUS, "*": TIMES, "/": OVER}
Bindings = Mapping[Variable, Term]
Facts = frozenset[tuple[Atom, bool]]


class Conjunction(NamedTuple):
    """Literals and tests that hold together."""

    literals: Facts
    tests: tuple[NumericTest, ...]


TRUE_CONJUNCTION = Conjunction(frozenset(), ())
Alternatives = tuple[Conjunction, ...]  # none: false


@dataclass(frozen=True)
class Surroundings:
    """What is known of all atoms and numbers of a problem: which can be true, which can be
    false, which are constant.
    """

    possible: Callable[[Atom], bool]  # the atom is true in some state
    # the atom is false in some state, or made true although it is
    avoidable: Callable[[Atom], bool]
    untouched: Callable[[Atom], bool]  # nothing makes the atom false, not even where it is
    constants: Mapping[Function, Fraction]  # the numbers that never change
    numbers: Mapping[Function, int]  # the others
    members: Callable[[str], list[str]]
    unset: Set[int] = frozenset()  # the numbers that have no value at the start

    def alternatives(self, condition: Condition, bindings: Bindings) -> Alternatives:
        """The condition as alternatives; an empty tuple if it is never true."""
        match condition:
            case Literal(atom, positive):
                return self._literal(substitute_atom(atom, bindings), positive)
            case Comparison() if condition.exact:
                return self._numeric(condition, bindings)
            case Comparison():
                return _same(condition, bindings)
            case And(parts):
                return self._all([self.alternatives(part, bindings) for part in parts])
            case Not(part):
                return self.alternatives(negation(part), bindings)
            case Or() | Exists() | ForAll():
                return self._joined(condition, bindings)
            case _:
                raise TypeError(f"{condition} has no alternatives")

    def _joined(self, condition: Or | Exists | ForAll, bindings: Bindings) -> Alternatives:
        """One of several parts, or the same part for some or for all objects."""
        match condition:
            case Or(parts):
                return _some([self.alternatives(part, bindings) for part in parts])
            case Exists(parameters, part):
                return _some(
                    [self.alternatives(part, own) for own in self.bindings(parameters, bindings)]
                )
            case ForAll(parameters, part):
                return self._all(
                    [self.alternatives(part, own) for own in self.bindings(parameters, bindings)]
                )

    def bindings(self, parameters: tuple[Parameter, ...], outer: Bindings) -> Iterator[Bindings]:
        """All bindings of the parameters, beside the outer ones."""
        lists = [self.members(parameter.type) for parameter in parameters]
        for row in itertools.product(*lists):
            chosen = zip(parameters, row, strict=True)
            yield {**outer, **{parameter.variable: Function(name) for parameter, name in chosen}}

    def _literal(self, atom: Atom, positive: bool) -> Alternatives:
        can, always = self.possible(atom), not self.avoidable(atom)
        if not positive:
            can, always = (not always, not can and self.untouched(atom))
        if always:
            return (TRUE_CONJUNCTION,)
        return (Conjunction(frozenset([(atom, positive)]), ()),) if can else ()

    def choices_read(
        self, condition: Condition, bindings: Bindings, chosen: bool = False
    ) -> Iterator[Atom | Program]:
        """The atoms and the numbers that a condition reads as one of several alternatives."""
        match condition:
            case And(parts) | Or(parts):
                several = chosen or isinstance(condition, Or)
                for part in parts:
                    yield from self.choices_read(part, bindings, several)
            case Not(part):
                yield from self.choices_read(negation(part), bindings, chosen)
            case Exists(parameters, part) | ForAll(parameters, part):
                several = chosen or isinstance(condition, Exists)
                for own in self.bindings(parameters, bindings):
                    yield from self.choices_read(part, own, several)
            case _ if chosen:
                yield from self._read_by(condition, bindings)

    def _read_by(self, condition: Condition, bindings: Bindings) -> Iterator[Atom | Program]:
        """The atom of a literal, or both sides of a comparison of numbers."""
        if isinstance(condition, Literal):
            yield substitute_atom(condition.atom, bindings)
        elif isinstance(condition, Comparison) and condition.exact:
            sides = (self.program(side, bindings) for side in (condition.left, condition.right))
            yield from (program for program in sides if program is not None)

    def _numeric(self, condition: Comparison, bindings: Bindings) -> Alternatives:
        left, right = (self.program(side, bindings) for side in (condition.left, condition.right))
        if left is None or right is None:
            return ()
        difference = joined(MINUS, left, right)
        if (value := constant(difference)) is not None:
            return (TRUE_CONJUNCTION,) if compare(value, condition.relation) else ()
        return (Conjunction(frozenset(), (NumericTest(condition.relation, difference),)),)

    def program(self, term: Term, bindings: Bindings) -> Program | None:
        """The program of a number; None if it names a number that has no value, or divides by 0."""
        match term:
            case Number(value):
                return ((CONSTANT, Fraction(value)),)
            case Operation(sign, left, right):
                one, two = self.program(left, bindings), self.program(right, bindings)
                if one is None or two is None or (sign == "/" and constant(two) == 0):
                    return None
                return joined(SIGNS[sign], one, two)
            case Function() if term == DURATION:
                return ((LENGTH, 0),)
            case Function():
                ground = substitute_atom(term, bindings)
                if ground in self.numbers:
                    return ((VALUE, self.numbers[ground]),)
                value_ = self.constants.get(ground)
                return None if value_ is None else ((CONSTANT, value_),)
            case _:
                raise TypeError(f"{term} is no number")

    def with_values(
        self, alternatives: Alternatives, updates: Iterable[NumericUpdate]
    ) -> Alternatives:
        """The alternatives, and that each number which the updates read has a value."""
        tests = dict.fromkeys(test for update in updates for test in self.value_tests(update))
        needed = Conjunction(frozenset(), tuple(tests))
        return tuple(together(part, needed) for part in alternatives) if tests else alternatives

    def value_tests(self, update: NumericUpdate) -> Iterator[NumericTest]:
        """What must hold for a change of a number to have a value. A square is not below 0,
        unless it has no value.
        """
        programs = [update.program]
        if update.kind != "assign":
            programs.append(((VALUE, update.number),))
        for program in programs:
            if self.may_lack_value(program):
                yield NumericTest(">=", joined(TIMES, program, program))
        if update.kind == "scale-down":
            yield NumericTest("!=", update.program)

    def may_lack_value(self, program: Program) -> bool:
        """Whether a program reads what may have no value, or divides by what may be 0."""
        reads = any(sign == VALUE and value in self.unset for sign, value in program)
        pairs = itertools.pairwise(program)
        return reads or any(two[0] == OVER and one[0] != CONSTANT for one, two in pairs)

    def _all(self, parts: list[Alternatives]) -> Alternatives:
        result: Alternatives = (TRUE_CONJUNCTION,)
        for part in parts:
            result = tuple(together(one, two) for one in result for two in part)
            if len(result) > 1:
                result = tuple(dict.fromkeys(each for each in result if not contradictory(each)))
            if len(result) > MAX_ALTERNATIVES:
                hint = "write several actions"
                said = (
                    f"a condition with more than {MAX_ALTERNATIVES} alternatives is not "
                    "supported with times"
                )
                raise InvalidInput([Diagnostic(Source("condition"), "K802", said, hint)])
        return result


def _same(condition: Comparison, bindings: Bindings) -> Alternatives:
    """A comparison of two objects."""
    same = substitute_term(condition.left, bindings) == substitute_term(condition.right, bindings)
    return (TRUE_CONJUNCTION,) if same == (condition.relation == "=") else ()


def together(one: Conjunction, two: Conjunction) -> Conjunction:
    """Both conjunctions."""
    if not two.literals and not two.tests:
        return one
    return Conjunction(one.literals | two.literals, (*one.tests, *two.tests))


def contradictory(part: Conjunction) -> bool:
    """Whether an atom is to be both true and false."""
    return any((atom, not positive) in part.literals for atom, positive in part.literals)


def _some(parts: list[Alternatives]) -> Alternatives:
    result = tuple(dict.fromkeys(each for part in parts for each in part))
    return (TRUE_CONJUNCTION,) if TRUE_CONJUNCTION in result else result


def negation(condition: Condition) -> Condition:
    """A condition that holds where this one does not, with `Not` moved inwards by one level."""
    match condition:
        case Literal(atom, positive):
            return Literal(atom, not positive)
        case Comparison(left, relation, right):
            return Comparison(left, RELATION_NEGATIONS[relation], right, condition.exact)
        case And(parts):
            return Or(tuple(map(negation, parts)))
        case Or(parts):
            return And(tuple(map(negation, parts)))
        case Not(part):
            return part
        case Exists(parameters, part):
            return ForAll(parameters, negation(part))
        case ForAll(parameters, part):
            return Exists(parameters, negation(part))
        case _:
            raise TypeError(f"{condition} has no negation")


def joined(sign: int, one: Program, two: Program) -> Program:
    """Two programs with a sign between them, evaluated if both are constant."""
    first, second = constant(one), constant(two)
    if first is not None and second is not None:
        return ((CONSTANT, calculated(sign, first, second)),)
    return (*one, *two, (sign, 0))


def calculated(sign: int, one: Fraction, two: Fraction) -> Fraction:
    """The value of two numbers with a sign between them."""
    if sign == PLUS:
        return one + two
    if sign == MINUS:
        return one - two
    return one * two if sign == TIMES else one / two


def constant(program: Program) -> Fraction | None:
    """The value of a program that is one constant."""
    if len(program) != 1 or program[0][0] != CONSTANT:
        return None
    value = program[0][1]
    return value if isinstance(value, Fraction) else Fraction(value)


def compare(value: Fraction, relation: str) -> bool:
    """Whether a value stands in a relation to 0."""
    match relation:
        case "=":
            return value == 0
        case "!=":
            return value != 0
        case "<" | "<=":
            return value < 0 or (relation == "<=" and value == 0)
        case _:
            return value > 0 or (relation == ">=" and value == 0)
