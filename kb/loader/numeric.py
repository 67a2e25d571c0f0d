"""Quantities: numbers that operators change. `volume(Bottle)` stands for the N of the fluent `volume(Bottle, N)`.

A comparison with a quantity means that the fluent has some value for which it holds. A change is a conditional effect that
ends the old value and adds the new one, so what reads domains needs to know fluents only.
"""

import dataclasses
import itertools
from collections.abc import Iterable, Iterator, Mapping

from kb.loader.counted import Counted
from kb.loader.inference import Typing
from kb.loader.names import Names
from kb.loader.reader import Expression, Reader
from kb.model.conditions import (
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
from kb.model.domain import Effect, Quantity
from kb.terms import Atom, Function, Number, Operation, Term, Variable, variables

CHANGES = ("increase", "decrease", "assign")
Fresh = Iterator[int]


def with_values(expression: Expression, names: Names) -> Expression:
    """The conditions, with fluents in the place of quantities in comparisons."""
    if not names.quantities:
        return expression
    fresh = itertools.count()
    parts = tuple(_valued(part, names.quantities, fresh) for part in expression.value)
    return dataclasses.replace(expression, value=parts)


def _valued(condition: Condition, known: Mapping[str, Quantity], fresh: Fresh) -> Condition:
    match condition:
        case Comparison(left, relation, right):
            values: dict[Function, Variable] = {}
            sides = [_replaced(side, known, values, fresh) for side in (left, right)]
            return _some(values, [Comparison(sides[0], relation, sides[1])]) if values else condition
        case And(parts) | Or(parts):
            return type(condition)(tuple(_valued(part, known, fresh) for part in parts))
        case Not(part):
            return Not(_valued(part, known, fresh))
        case ForAll(parameters, part):
            return ForAll(parameters, _valued(part, known, fresh))
        case _:
            return condition


def _replaced(
    term: Term, known: Mapping[str, Quantity], values: dict[Function, Variable], fresh: Fresh
) -> Term:
    """A term with a variable in the place of each quantity; `values` are these variables."""
    match term:
        case Operation(sign, left, right):
            return Operation(
                sign, _replaced(left, known, values, fresh), _replaced(right, known, values, fresh)
            )
        case Function(name) if name in known:
            return values.setdefault(term, Variable(f"_Value{next(fresh)}"))
        case _:
            return term


def _some(values: Mapping[Function, Variable], tests: Iterable[Comparison]) -> Condition:
    parameters = tuple(Parameter(variable, "int") for variable in values.values())
    return Exists(parameters, And((*_fluents(values), *tests)))


def _fluents(values: Mapping[Function, Variable]) -> Iterator[Literal]:
    """The fluents that give the quantities their values."""
    for term, variable in values.items():
        yield Literal(Function(term.name, (*term.arguments, variable)))


class Changes:
    """What one operator does to quantities: under `increase`, `decrease` and `assign`."""

    def __init__(self, reader: Reader, names: Names, path: tuple[str | int, ...]) -> None:
        self.names = names
        self.found: list[tuple[str, Expression, Expression]] = []
        self._fresh = itertools.count(100)
        for kind in CHANGES:
            for _, key, node in reader.entries(*path, kind):
                quantity, amount = reader.parse("term", key), reader.parse("term", node)
                if quantity is not None and amount is not None and self._is_quantity(quantity):
                    self.found.append((kind, quantity, amount))
        self._refuse_twice()

    def _is_quantity(self, expression: Expression) -> bool:
        term = expression.value
        name = term.name if isinstance(term, Function) else str(term)
        if name in self.names.quantities:
            return True
        if name not in self.names.broken:
            known = ", ".join(self.names.quantities) or "none is declared under `quantities:`"
            place = expression.node.where
            self.names.findings.add(place, "K101", f"'{name}' is no quantity", f"quantities: {known}")
        return False

    def _refuse_twice(self) -> None:
        seen: set[Term] = set()
        for _, quantity, _ in self.found:
            if quantity.value in seen:
                message = f"this operator changes {quantity.value} twice"
                hint = "add the amounts up in one change"
                self.names.findings.add(quantity.node.where, "K104", message, hint)
            seen.add(quantity.value)

    def infer(self, typing: Typing) -> None:
        """Narrow the types of variables by the arguments of quantities, and check the amounts."""
        for kind, quantity, amount in self.found:
            term = quantity.value
            typing.atom(Function(term.name, (*term.arguments, Number(0))), quantity)
            values: dict[Function, Variable] = {}
            plain = _replaced(amount.value, self.names.quantities, values, self._fresh)
            for inner in values:
                typing.atom(Function(inner.name, (*inner.arguments, Number(0))), amount)
            own = typing.nested()
            own.types.update(dict.fromkeys(values.values(), "int"))
            read = dataclasses.replace(amount, value=plain)
            Counted(self.names, own, kind, "int", read, signed=True).check()
            outer = {v: t for v, t in own.types.items() if v not in values.values()}
            typing.types.update(outer)

    @property
    def variables(self) -> list[tuple[Variable, Expression]]:
        """The variables in the changes, with where they stand."""
        return [
            (variable, expression)
            for _, quantity, amount in self.found
            for expression in (quantity, amount)
            for variable in variables(expression.value)
        ]

    def conditions(self) -> list[Condition]:
        """What must hold before the step, so that no quantity leaves its range."""
        found: list[Condition] = []
        for kind, quantity, amount in self.found:
            values, new = self._new(kind, quantity.value, amount.value)
            found.append(_some(values, self._within(new, quantity.value)))
        return found

    def _within(self, value: Term, quantity: Function) -> list[Comparison]:
        bounds = self.names.quantities[quantity.name]
        return [Comparison(value, ">=", Number(bounds.low)), Comparison(value, "<=", Number(bounds.high))]

    def apart(self) -> list[Comparison]:
        """What keeps two changes from meeting the same quantity."""
        pairs = itertools.combinations((each.value for _, each, _ in self.found), 2)
        return [
            Comparison(_together(one), "!=", _together(other))
            for one, other in pairs
            if one.name == other.name
        ]

    def effects(self) -> Iterator[Effect]:
        """The end of each old value, and the new one."""
        for kind, quantity, amount in self.found:
            values, new = self._new(kind, quantity.value, amount.value)
            old = values[quantity.value]
            held = tuple(_fluents(values))
            parameters = tuple(Parameter(variable, "int") for variable in values.values())
            yield Effect(_fluent(quantity.value, old), False, parameters, And(held))
            after = Variable(f"_Value{next(self._fresh)}")
            condition = And((*held, Comparison(after, "=", new), *self._within(after, quantity.value)))
            yield Effect(
                _fluent(quantity.value, after), True, (*parameters, Parameter(after, "int")), condition
            )

    def _new(self, kind: str, quantity: Function, amount: Term) -> tuple[dict[Function, Variable], Term]:
        """The variables for the quantities that a change reads, and the value after it."""
        values: dict[Function, Variable] = {}
        old = _replaced(quantity, self.names.quantities, values, self._fresh)
        by = _replaced(amount, self.names.quantities, values, self._fresh)
        return values, by if kind == "assign" else Operation("+" if kind == "increase" else "-", old, by)


def _fluent(quantity: Function, value: Term) -> Atom:
    return Function(quantity.name, (*quantity.arguments, value))


def _together(quantity: Function) -> Term:
    return quantity.arguments[0] if len(quantity.arguments) == 1 else Function("_of", quantity.arguments)
