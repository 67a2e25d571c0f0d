"""Numeric conditions, effects and costs of PDDL actions as comparisons and changes of quantities.

All numbers are made whole by the units of their functions; a comparison is multiplied until its
factors are whole, too.
"""

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from fractions import Fraction

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
    distinct_quantities,
    replace_quantities,
    some_values,
    value_atom,
    value_change,
)
from cellwright.kb.terms import Atom, Function, Number, Operation, Term, Variable, term_variables

Exact = Polynomial[Function]
Read = Callable[[Group], Function]


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
    _fresh: Iterator[int] = field(default_factory=itertools.count)

    def by_itself(self, read: Callable[[], Condition]) -> Condition:
        """What `read` gives, without variables of the action for values: a quantified condition
        may become a rule of its own.
        """
        bound, self.bound = self.bound, None
        condition = read()
        self.bound = bound
        return condition

    def comparison(self, at: Group, read: Read) -> Condition:
        """A comparison of two numbers. A wrong one is reported and replaced by true."""
        try:
            left, right = (polynomial_of(part, read) for part in at.rest)
            return self._compared(left + right.times(Fraction(-1)), at)
        except ValueError:
            self.document.add(at, "K102", f"'{at.head}' compares two numbers")
        except Unreadable as wrong:
            self._refuse(wrong)
        return ALWAYS_TRUE

    def _refuse(self, wrong: Unreadable) -> None:
        hint = "conditions and effects are sums of functions with fixed factors"
        self.document.add(wrong.at, "K802", f"this number is not supported: {wrong.why}", hint)

    def _compared(self, difference: Exact, at: Group) -> Condition:
        """A polynomial compared with 0: what is added stands on the left, what is subtracted on
        the right.
        """
        counted = self._counted(self._folded(difference), at)
        whole = math.lcm(1, *(factor.denominator for factor in counted.parts.values()))
        common = math.gcd(*(int(factor * whole) for factor in counted.parts.values())) or 1
        sides: tuple[list[Term], list[Term]] = ([], [])
        for monomial, factor in counted.parts.items():
            sides[factor < 0].append(
                self._product(abs(int(factor * whole)) // common, monomial, at)
            )
        left, right = (_sum_of(side) for side in sides)
        return self._bound(Comparison(left, at.head, right))

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
        return self.names.original("predicate", function.name)

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
        return {self.names.of("predicate", name) for name in self.functions.changing}

    def _fixed(self, term: Term, fixed: dict[Function, Variable]) -> Term:
        """A term with variables for functions that do not change: those of the action, or new
        ones in `fixed`.
        """
        match term:
            case Operation(sign, left, right):
                return Operation(sign, self._fixed(left, fixed), self._fixed(right, fixed))
            case Function() if self.bound is not None and self.outer.issuperset(
                term_variables(term)
            ):
                return self.bound.setdefault(term, Variable(f"Number{len(self.bound) + 1}__"))
            case Function():
                return fixed.setdefault(term, Variable(f"_Number{next(self._fresh)}"))
            case _:
                return term

    def changes(
        self, effect: Expression | None, read: Read
    ) -> tuple[list[Effect], list[Comparison]]:
        """What an action does to quantities, and what must be so that it changes none of them
        twice.
        """
        totals: dict[Function, tuple[bool, Exact, NumericEffect]] = {}
        for numeric_effect in numeric_effects(effect):
            if numeric_effect.name not in self.functions.changing:
                continue
            try:
                self._add(numeric_effect, read, totals)
            except Unreadable as wrong:
                self._refuse(wrong)
        effects: list[Effect] = []
        for quantity, (assigned, amount, numeric) in totals.items():
            try:
                effects += self._changed(quantity, assigned, amount, numeric)
            except Unreadable as wrong:
                self._refuse(wrong)
        return effects, distinct_quantities(itertools.combinations(totals, 2))

    def _add(
        self,
        effect: NumericEffect,
        read: Read,
        totals: dict[Function, tuple[bool, Exact, NumericEffect]],
    ) -> None:
        if effect.conditional:
            raise Unreadable(effect.at, "it changes only under a condition, or for several objects")
        if effect.kind in ("scale-up", "scale-down"):
            raise Unreadable(effect.at, f"{effect.kind} is not linear")
        quantity, amount = read(effect.function), polynomial_of(effect.amount, read)
        if effect.kind == "decrease":
            amount = amount.times(Fraction(-1))
        assigned = effect.kind == "assign"
        if quantity in totals:
            if assigned or totals[quantity][0]:
                raise Unreadable(effect.at, "it is assigned and changed in one action")
            amount = amount + totals[quantity][1]
        totals[quantity] = (assigned, amount, effect)

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
                    total = total + polynomial_of(numeric_effect.amount, read).times(weight)
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
