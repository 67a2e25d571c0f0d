"""What quantities are in a ground task: levels, changes of levels, and derived atoms that compare them."""

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from cellwright.engine.kernels.bits import Bits, bitset
from cellwright.engine.model.axioms import Axioms
from cellwright.engine.model.quantities import UNBOUNDED, Assignment, Comparing, Level, Linear, Met
from cellwright.engine.model.task import GroundOperator
from cellwright.engine.stages.grounding.numbering import Numbering
from cellwright.engine.stages.grounding.numeric import Quantities
from cellwright.engine.stages.grounding.universe import Universe
from cellwright.kb.arithmetic import evaluate_atom
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.model.domain import Domain
from cellwright.kb.terms import (
    Atom,
    Function,
    Number,
    Operation,
    Substitution,
    Term,
    Variable,
    match,
    substitute,
    substitute_atom,
)


@dataclass
class Numbers:
    """The quantities of a ground task whose atoms are `names`."""

    taken: Quantities
    domain: Domain
    names: list[Atom]
    levels: dict[Function, Level] = field(default_factory=dict)
    _met: Met = field(default_factory=dict)
    _changes: dict[Function, tuple[Assignment, ...]] = field(default_factory=dict)

    @property
    def start(self) -> int:
        """The atoms of the values at the start."""
        found = 0
        for quantity, value in self.taken.initial.items():
            found |= self._level(quantity).bit(value)
        return found

    def comparing(self, universe: Universe, numbering: Numbering) -> Iterator[Comparing]:
        """The derived atoms that compare quantities and have numbers. Raises `InvalidInput`."""
        tests = {each.head.name: each for each in self.taken.tests}
        for atom, signed in universe.index.items():
            if (test := tests.get(atom.name)) is None:
                continue
            if signed not in numbering.added and ~signed not in numbering.added:
                continue
            bindings = match(test.head, atom, {}) or {}
            difference = Operation("-", test.comparison.left, test.comparison.right)
            found = self._linear(difference, test.values, bindings, test.where)
            yield Comparing(numbering.number(signed), found, test.comparison.relation)

    def changing(self, operator: GroundOperator) -> GroundOperator:
        """The operator with what it does to quantities."""
        settings = self.taken.settings.get(operator.instance.name)
        if not settings:
            return operator
        if operator.instance not in self._changes:
            schema = next(each for each in self.domain.operators if each.name == operator.instance.name)
            bindings = dict(zip(schema.variables, operator.instance.arguments, strict=True))
            self._changes[operator.instance] = tuple(
                Assignment(
                    self._level(substitute_atom(each.quantity, bindings)),
                    self._linear(each.value, each.values, bindings, schema.where),
                )
                for each in settings
            )
        return dataclasses.replace(operator, changes=self._changes[operator.instance])

    def _level(self, quantity: Function) -> Level:
        known = evaluate_atom(quantity) or quantity
        if known not in self.taken.initial:
            message = f"nothing says what {known} is at the start"
            hint = f"add {Function(known.name, (*known.arguments, Number(0)))}, or its true value, under `initial:`"
            raise InvalidInput([Diagnostic(self.taken.problem.where, "K115", message, hint)])
        if known not in self.levels:
            bounds = self.domain.quantities[known.name]
            low = -UNBOUNDED if bounds.low is None else bounds.low
            high = UNBOUNDED if bounds.high is None else bounds.high
            self.levels[known] = Level(known, low, high, self.names, self._met, len(self.levels))
        return self.levels[known]

    def _linear(
        self, term: Term, values: Mapping[Variable, Function], bindings: Substitution, where: Source
    ) -> Linear:
        factors: dict[Level, int] = {}

        def read(part: Term) -> tuple[dict[Level, int], int]:
            match part:
                case Number(value):
                    return {}, value
                case Variable() if part in values:
                    return {self._level(substitute_atom(values[part], bindings)): 1}, 0
                case Operation(sign, left, right):
                    return _calculated(sign, read(left), read(right), part, where)
                case _:
                    message, hint = f"{part} is no number", "compare quantities with numbers"
                    raise InvalidInput([Diagnostic(where, "K103", message, hint)])

        factors, constant = read(substitute(term, bindings))
        return Linear(tuple((level, factor) for level, factor in factors.items() if factor), constant)


Sum = tuple[dict[Level, int], int]


def _calculated(sign: str, left: Sum, right: Sum, term: Term, where: Source) -> Sum:
    """Two sums put together. Raises `InvalidInput` if the result is no sum."""
    (one, first), (other, second) = left, right
    if sign in ("+", "-"):
        factor = 1 if sign == "+" else -1
        keys = dict.fromkeys((*one, *other))
        return {k: one.get(k, 0) + factor * other.get(k, 0) for k in keys}, first + factor * second
    if sign == "*" and not (one and other):
        if not one:
            one, first, second = other, second, first
        return {k: factor * second for k, factor in one.items()}, first * second
    if not one and not other:
        value = evaluate_atom(Function("", (Operation(sign, Number(first), Number(second)),)))
        if value is not None and isinstance(value.arguments[0], Number):
            return {}, value.arguments[0].value
    message = f"{term} is not linear: quantities can be added, and multiplied by numbers"
    raise InvalidInput([Diagnostic(where, "K107", message, "write it as a sum")])


def unmeetable(tests: tuple[Comparing, ...], numbering: Numbering) -> Bits:
    """The atoms of comparisons that never hold, whatever the values are within their ranges."""
    never = [each.atom for each in tests if each.settled is False]
    always = {each.atom for each in tests if each.settled is True}
    return bitset([*never, *(c for a, c in numbering.complements.items() if a in always)])


def with_tests(
    axioms: Axioms | None, tests: tuple[Comparing, ...], numbering: Numbering, size: int
) -> Axioms | None:
    """The axioms together with the comparisons of quantities."""
    if not tests:
        return axioms
    if axioms is None:
        atoms = bitset([each.atom for each in tests])
        own = {a: c for a, c in _complements(numbering).items() if atoms >> a & 1}
        return Axioms(size, (), {}, own, tests)
    return dataclasses.replace(axioms, tests=tests)


def _complements(numbering: Numbering) -> dict[int, int]:
    return {
        numbering.number(~signed): number for signed, number in list(numbering.added.items()) if signed < 0
    }
