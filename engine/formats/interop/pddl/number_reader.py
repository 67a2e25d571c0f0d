"""Numeric conditions, effects and costs of PDDL actions as comparisons and changes of quantities.

All numbers are made whole by the units of their functions; a comparison is multiplied until its
factors are whole, too.
"""

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import NamedTuple

from cellwright.engine.formats.interop.pddl.coincidence import Blocks, TooManyCases, coincidences
from cellwright.engine.formats.interop.pddl.declared_names import NameMapping
from cellwright.engine.formats.interop.pddl.expressions import Document, Expression, Group
from cellwright.engine.formats.interop.pddl.numeric_functions import (
    MAX_PDDL_NUMBER,
    NumericEffect,
    Polynomial,
    TaskFunctions,
    Unreadable,
    numeric_effects,
    polynomial_of,
)
from cellwright.kb.model.conditions import (
    ALWAYS_TRUE,
    And,
    Comparison,
    Condition,
    Exists,
    Literal,
    Parameter,
)
from cellwright.kb.model.domain_model import Effect, Quantity
from cellwright.kb.model.quantity_fluents import (
    compare_arguments,
    replace_quantities,
    some_values,
    value_atom,
    value_change,
)
from cellwright.kb.terms import Atom, Function, Number, Operation, Term, Variable, term_variables

Exact = Polynomial[Function]
Read = Callable[[Group], Function]


@dataclass(frozen=True, slots=True)
class NumericChange:
    """What an action does to quantities where `body` holds.

    It needs that all it reads has a value (`defined`).
    """

    body: tuple[Comparison, ...] = ()
    effects: tuple[Effect, ...] = ()
    defined: tuple[Literal, ...] = ()


class _Total(NamedTuple):
    """What an action adds to a quantity in all, or assigns to it; the functions that this
    reads; one of the effects.
    """

    assigned: bool
    amount: Exact
    read: frozenset[Function]
    effect: NumericEffect


Totals = dict[Function, _Total]
MayBeSame = Callable[[Function, Function], bool]


@dataclass
class NumberReader:
    """Reads what compares and changes functions in one document."""

    document: Document
    names: NameMapping
    functions: TaskFunctions
    # values of functions that do not change
    known: dict[Function, Fraction] = field(default_factory=dict)
    bound: dict[Function, Variable] | None = (
        None  # the functions that an action reads, with variables for their values
    )
    outer: frozenset[Variable] = frozenset()  # the variables of that action
    needed: bool = False  # whether the action cannot do without the values that are read now
    _fresh: Iterator[int] = field(default_factory=itertools.count)

    def by_itself(self, read: Callable[[], Condition]) -> Condition:
        """What `read` gives, without variables of the action for values: a quantified condition
        may become a rule of its own.
        """
        bound, self.bound = self.bound, None
        condition = read()
        self.bound = bound
        return condition

    def comparison(self, at: Group, relation: str, read: Read) -> Condition:
        """A comparison of two numbers that have values.

        A wrong one is reported and replaced by true.
        """
        named: dict[Function, None] = {}
        try:
            left, right = (polynomial_of(part, _noting(read, named)) for part in at.rest)
            difference = self._folded(left + right.times(Fraction(-1)))
            compared = self._compared(difference, relation, at)
            gone = [
                each for each in named if each not in difference.keys and each not in self.known
            ]
            given = (
                *self.defined(named),
                *(self._given(each) for each in gone if not self._changes(each)),
            )
            return And((*given, compared)) if given else compared
        except ValueError:
            self.document.add(at, "K102", f"'{at.head}' compares two numbers")
        except Unreadable as wrong:
            self._refuse(wrong)
        return ALWAYS_TRUE

    def defined(self, functions: Iterable[Function]) -> tuple[Literal, ...]:
        """That functions which need not have a value at the start have one now."""
        return tuple(
            Literal(self.has_value(each))
            for each in functions
            if self._original(each) in self.functions.partial and self._changes(each)
        )

    def has_value(self, function: Function) -> Atom:
        """The fluent that a function has a value."""
        name = self.names.of("predicate", f"{self._original(function)} has a value")
        return Function(name, function.arguments)

    def _given(self, function: Function) -> Condition:
        """That a function which does not change has a value."""
        variable = Variable(f"_Number{next(self._fresh)}")
        return Exists((Parameter(variable, "int"),), Literal(value_atom(function, variable)))

    def _refuse(self, wrong: Unreadable) -> None:
        hint = "conditions and effects are sums of functions with fixed factors"
        self.document.add(wrong.at, "K802", f"this number is not supported: {wrong.why}", hint)

    def _compared(self, difference: Exact, relation: str, at: Group) -> Condition:
        """A polynomial compared with 0: what is added stands on the left, what is subtracted on
        the right.
        """
        counted = self._counted(difference, at)
        whole = math.lcm(1, *(factor.denominator for factor in counted.parts.values()))
        common = math.gcd(*(int(factor * whole) for factor in counted.parts.values())) or 1
        sides: tuple[list[Term], list[Term]] = ([], [])
        for monomial, factor in counted.parts.items():
            sides[factor < 0].append(
                self._product(abs(int(factor * whole)) // common, monomial, at)
            )
        left, right = (_sum_of(side) for side in sides)
        return self._bound(Comparison(left, relation, right))

    def _folded(self, given: Exact) -> Exact:
        """The polynomial with the values of functions that are known."""
        folded = Polynomial[Function]({})
        for monomial, factor in given.parts.items():
            rest = tuple(function for function in monomial if function not in self.known)
            value = math.prod(
                (self.known[function] for function in monomial if function in self.known),
                start=factor,
            )
            folded = folded + Polynomial({rest: value})
        return folded

    def _counted(self, given: Exact, at: Group) -> Exact:
        """The polynomial over what functions count, instead of over their values.

        Raises `Unreadable` if it is not linear.
        """
        for monomial in given.parts:
            if sum(self._changes(function) for function in monomial) > 1:
                raise Unreadable(at, "a product of functions that change is not linear")
        return Polynomial(
            {m: factor / math.prod(map(self._unit, m)) for m, factor in given.parts.items()}
        )

    def _unit(self, function: Function) -> int:
        return self.functions.unit(self._original(function))

    def _changes(self, function: Function) -> bool:
        return self._original(function) in self.functions.changing

    def _original(self, function: Function) -> str:
        return self.names.original("function", function.name)

    def _product(self, factor: int, monomial: Iterable[Function], at: Group) -> Term:
        if factor > MAX_PDDL_NUMBER:
            raise Unreadable(at, "as a whole number it is too large")
        product: Term = Number(factor)
        for function in monomial:
            product = function if product == Number(1) else Operation("*", product, function)
        return product

    def _bound(self, comparison: Comparison) -> Condition:
        """The comparison with variables for values: those of quantities hold now, those of
        other functions always.
        """
        values: dict[Function, Variable] = {}
        fixed: dict[Function, Variable] = {}
        left, right = (
            self._fixed(replace_quantities(side, self._quantities, values, self._fresh), fixed)
            for side in (comparison.left, comparison.right)
        )
        test = Comparison(left, comparison.relation, right, exact=True)
        condition: Condition = some_values(values, [test]) if values else test
        if fixed:
            facts = (
                Literal(value_atom(function, variable)) for function, variable in fixed.items()
            )
            condition = Exists(
                tuple(Parameter(v, "int") for v in fixed.values()), And((*facts, condition))
            )
        return condition

    @property
    def _quantities(self) -> set[str]:
        return {self.names.of("function", name) for name in self.functions.changing}

    def _fixed(self, term: Term, fixed: dict[Function, Variable]) -> Term:
        """A term with variables for functions that do not change: those of the action, or new
        ones in `fixed`.
        """
        match term:
            case Operation(sign, left, right):
                return Operation(sign, self._fixed(left, fixed), self._fixed(right, fixed))
            case Function() if self.bound is not None and self._binds(term):
                return self.bound.setdefault(term, Variable(f"Number{len(self.bound) + 1}__"))
            case Function():
                return fixed.setdefault(term, Variable(f"_Number{next(self._fresh)}"))
            case _:
                return term

    def _binds(self, function: Function) -> bool:
        """Whether an action needs the value of a function, so that its value can be a parameter
        of the action.
        """
        total = self.needed or self._original(function) not in self.functions.partial
        return total and self.outer.issuperset(term_variables(function))

    def changes(
        self, effect: Expression | None, read: Read, may_be_same: MayBeSame
    ) -> list[NumericChange]:
        """What an action does to quantities, for each way in which these may be the same.

        There is always one way.
        """
        totals: Totals = {}
        for numeric_effect in numeric_effects(effect):
            if numeric_effect.name not in self.functions.changing:
                continue
            try:
                self._add(numeric_effect, read, totals)
            except Unreadable as wrong:
                self._refuse(wrong)
        try:
            ways = coincidences(tuple(totals), may_be_same)
            merged = (self._merged(blocks, totals, may_be_same) for blocks in ways)
            return [numeric for numeric in merged if numeric is not None]
        except TooManyCases:
            at = next(iter(totals.values())).effect.at
            self._refuse(Unreadable(at, "the changed functions may coincide in too many ways"))
        except Unreadable as wrong:
            self._refuse(wrong)
        return [NumericChange()]

    def _merged(
        self, blocks: Blocks, totals: "Totals", may_be_same: "MayBeSame"
    ) -> NumericChange | None:
        """What happens if exactly the quantities in each block are the same; None if that
        cannot happen at once.
        """
        if any(len(block) > 1 and any(totals[each].assigned for each in block) for block in blocks):
            return None
        same = [compare_arguments(block[0], "=", other) for block in blocks for other in block[1:]]
        differ = [
            compare_arguments(one, "!=", other)
            for one, other in itertools.combinations([block[0] for block in blocks], 2)
            if one.name == other.name and may_be_same(one, other)
        ]
        effects: list[Effect] = []
        read: dict[Function, None] = {}
        for block in blocks:
            first = totals[block[0]]
            amount = sum((totals[each].amount for each in block[1:]), first.amount)
            effects += self._changed(block[0], first.assigned, amount, first.effect)
            read |= dict.fromkeys(key for each in block for key in totals[each].read)
            if self._original(block[0]) in self.functions.partial and first.assigned:
                effects.append(Effect(self.has_value(block[0])))
        return NumericChange((*same, *differ), tuple(effects), self.defined(read))

    def _add(self, effect: NumericEffect, read: Read, totals: "Totals") -> None:
        if effect.conditional:
            raise Unreadable(effect.at, "it changes only under a condition, or for several objects")
        if effect.kind in ("scale-up", "scale-down"):
            raise Unreadable(effect.at, f"{effect.kind} is not linear")
        named: dict[Function, None] = {}
        quantity, amount = read(effect.function), polynomial_of(effect.amount, _noting(read, named))
        self._need(named)
        if effect.kind == "decrease":
            amount = amount.times(Fraction(-1))
        assigned = effect.kind == "assign"
        needs = {*named} if assigned else {quantity, *named}
        if quantity in totals:
            if assigned or totals[quantity].assigned:
                raise Unreadable(effect.at, "it is assigned and changed in one action")
            amount, needs = amount + totals[quantity].amount, needs | totals[quantity].read
        totals[quantity] = _Total(assigned, amount, frozenset(needs), effect)

    def _need(self, functions: Iterable[Function]) -> None:
        """Note that the action needs the values of functions that do not change, also where
        they cancel out.
        """
        for each in functions:
            if (
                self.bound is not None
                and not self._changes(each)
                and self._original(each) in self.functions.partial
            ):
                self._fixed(each, {})

    def _changed(
        self, quantity: Function, assigned: bool, amount: Exact, effect: NumericEffect
    ) -> Iterable[Effect]:
        new = self._folded(amount if assigned else amount + Polynomial({(quantity,): Fraction(1)}))
        term = self._whole(new.times(Fraction(self._unit(quantity))), effect.at)
        values: dict[Function, Variable] = {}
        replace_quantities(quantity, self._quantities, values, self._fresh)
        fixed: dict[Function, Variable] = {}
        held = self._fixed(replace_quantities(term, self._quantities, values, self._fresh), fixed)
        return value_change(
            quantity, held, values, Quantity(quantity.name, None, None), self._fresh
        )

    def _whole(self, given: Exact, at: Group) -> Term:
        """A polynomial in what functions count; its factors are whole by the choice of units."""
        counted = self._counted(given, at)
        plus = [self._product(int(f), m, at) for m, f in counted.parts.items() if f > 0]
        minus = [self._product(int(-f), m, at) for m, f in counted.parts.items() if f < 0]
        return Operation("-", _sum_of(plus), _sum_of(minus)) if minus else _sum_of(plus)

    def cost(self, effect: Expression | None, read: Read) -> Term | None:
        """What an action adds to the metric; None if there is none to follow."""
        if self.functions.metric is None:
            return None
        total: Exact = Polynomial({})
        try:
            for numeric_effect in numeric_effects(effect):
                if weight := self.functions.metric.get(numeric_effect.name):
                    named: dict[Function, None] = {}
                    total = total + polynomial_of(
                        numeric_effect.amount, _noting(read, named)
                    ).times(weight)
                    self._need(named)
            term = self._whole(
                self._folded(total).times(Fraction(self.functions.unit_of_cost)),
                _effect_group(effect),
            )
        except Unreadable as wrong:
            self._refuse(wrong)
            return None
        return self._fixed(term, {})

    def value(self, function: Function, value: Fraction) -> Atom:
        """The fact that a function has a value."""
        return value_atom(function, Number(int(value * self._unit(function))))


def _noting(read: Read, named: dict[Function, None]) -> Read:
    """`read`, which also notes in `named` all that it reads."""

    def noted(group: Group) -> Function:
        function = read(group)
        named[function] = None
        return function

    return noted


def _effect_group(at: Expression | None) -> Group:
    """An effect as a place for messages."""
    return at if isinstance(at, Group) else Group((), 0)


def function_bindings(
    bound: Mapping[Function, Variable],
) -> tuple[tuple[Literal, ...], tuple[Parameter, ...]]:
    """The facts that give functions their values, and the variables of these values as
    parameters.
    """
    facts = tuple(Literal(value_atom(function, variable)) for function, variable in bound.items())
    return facts, tuple(Parameter(variable, "int") for variable in bound.values())


def _sum_of(terms: list[Term]) -> Term:
    total: Term = terms[0] if terms else Number(0)
    for term in terms[1:]:
        total = Operation("+", total, term)
    return total
