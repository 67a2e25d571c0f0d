"""Numbers in operators: durations, costs, and quantities such as `volume(Bottle)`."""

import dataclasses
import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from cellwright.kb.loader.reader import Expression, Reader
from cellwright.kb.loader.symbol_table import SymbolTable
from cellwright.kb.loader.variable_types import Typing
from cellwright.kb.model.conditions import And, Comparison, Condition, ForAll, Not, Or, literals_in
from cellwright.kb.model.domain_model import (
    DISTANCE_TERM,
    NUMERIC_TYPES,
    OBJECT_TYPE,
    Effect,
    Quantity,
)
from cellwright.kb.model.name_conventions import CONVENTION_BY_NAME
from cellwright.kb.model.operator_amounts import asks_number
from cellwright.kb.model.quantity_fluents import (
    Fresh,
    compare_quantities,
    distinct_quantities,
    range_comparisons,
    replace_quantities,
    some_values,
    value_change,
)
from cellwright.kb.terms import Atom, Function, Number, Operation, Term, Variable, term_variables

UNDECLARED = (
    CONVENTION_BY_NAME["travel"].role,
    DISTANCE_TERM,
)  # what a duration may ask for once a domain declares how an arm moves


@dataclass(frozen=True, slots=True)
class NumericExpression:
    """A duration or cost of an operator: what is wrong with it goes to the findings, what it
    says of types to the typing.
    """

    names: SymbolTable
    typing: Typing
    name: str
    type_: str
    expression: Expression
    signed: bool = False  # whether it may be negative

    def check(self) -> None:
        """Read the expression through."""
        value = self.expression.value
        if isinstance(value, Number) and value.value < 0 and not self.signed:
            hint, said = f"a {self.name} must be 0 or more", f"the {self.name} {value} is negative"
            self.names.findings.add(self.expression.node.where, "K113", said, hint)
        self._term(value)

    def _term(self, term: Term) -> None:
        match term:
            case Variable():
                self._numeric(term)
            case Operation(_, left, right):
                self._term(left)
                self._term(right)
            case Function(known, arguments) if asks_number(
                self.names.predicates, self.names.travel, known, len(arguments)
            ):
                declared = self.names.predicates.get(known)
                types = declared.arguments if declared else (OBJECT_TYPE, OBJECT_TYPE)
                for argument, expected in zip(arguments, types, strict=False):
                    self.typing.term(argument, expected, self.expression, term)
            case Function(known, (_, _)) if (
                known in UNDECLARED and known not in self.names.functions
            ):
                hint = "declare `motion:` with a speed, or the static travel(place, place, time)"
                message = f"no motion is declared, so '{known}' is not known"
                self.names.findings.add(self.expression.place(term), "K101", message, hint)
                self.typing.sound = False
            case _:
                self.typing.term(term, self.type_, self.expression, Function(self.name))

    def _numeric(self, variable: Variable) -> None:
        if (known := self.typing.type_of(variable)) is None:
            self.typing.types[variable] = self.type_
        elif known not in NUMERIC_TYPES:
            message = f"{variable} is of type {known}, but a {self.name} is a number"
            hint = "bind a number by a static: `takes(Item, Time)` in `where:`"
            self.names.findings.add(self.expression.place(variable), "K103", message, hint)


QUANTITY_CHANGES = ("increase", "decrease", "assign")


def with_values(expression: Expression, names: SymbolTable) -> Expression:
    """The conditions, with fluents in the place of quantities in comparisons."""
    if not names.quantities:
        return expression
    for literal in literals_in(And(expression.value)):
        refuse_quantity(literal.atom, expression, names)
    fresh = itertools.count()
    parts = tuple(_with_quantity_values(part, names.quantities, fresh) for part in expression.value)
    return dataclasses.replace(expression, value=parts)


def refuse_quantity(atom: Atom, expression: Expression, names: SymbolTable) -> None:
    """Report a quantity that stands as a fact with its value."""
    if atom.name in names.quantities:
        said = (
            f"{atom.name}({', '.join(map(str, atom.arguments[:-1]))})"
            if atom.arguments[1:]
            else atom.name
        )
        message = (
            f"'{atom.name}' is a quantity: its value is compared, and changed by increase, "
            "decrease and assign"
        )
        names.findings.add(
            expression.place(atom), "K108", message, f"write a comparison: {said} >= 1"
        )


def _with_quantity_values(
    condition: Condition, known: Mapping[str, Quantity], fresh: Fresh
) -> Condition:
    match condition:
        case Comparison():
            return compare_quantities(condition, known, fresh)
        case And(parts) | Or(parts):
            return type(condition)(
                tuple(_with_quantity_values(part, known, fresh) for part in parts)
            )
        case Not(part):
            return Not(_with_quantity_values(part, known, fresh))
        case ForAll(parameters, part):
            return ForAll(parameters, _with_quantity_values(part, known, fresh))
        case _:
            return condition


class QuantityChanges:
    """What one operator does to quantities: under `increase`, `decrease` and `assign`."""

    def __init__(self, reader: Reader, names: SymbolTable, path: tuple[str | int, ...]) -> None:
        self.names = names
        self.found: list[tuple[str, Expression, Expression]] = []
        self._fresh = itertools.count(100)
        for kind in QUANTITY_CHANGES:
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
            self.names.findings.add(
                place, "K101", f"'{name}' is no quantity", f"quantities: {known}"
            )
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
            plain = replace_quantities(amount.value, self.names.quantities, values, self._fresh)
            for inner in values:
                typing.atom(Function(inner.name, (*inner.arguments, Number(0))), amount)
            own = typing.nested()
            own.types.update(dict.fromkeys(values.values(), "int"))
            read = dataclasses.replace(amount, value=plain)
            NumericExpression(self.names, own, kind, "int", read, signed=True).check()
            outer = {v: t for v, t in own.types.items() if v not in values.values()}
            typing.types.update(outer)

    @property
    def variables(self) -> list[tuple[Variable, Expression]]:
        """The variables in the changes, with where they stand."""
        return [
            (variable, expression)
            for _, quantity, amount in self.found
            for expression in (quantity, amount)
            for variable in term_variables(expression.value)
        ]

    def conditions(self) -> list[Condition]:
        """What must hold before the step, so that no quantity leaves its range."""
        conditions: list[Condition] = []
        for kind, quantity, amount in self.found:
            values, new = self._new(kind, quantity.value, amount.value)
            if tests := range_comparisons(new, self._bounds(quantity.value)):
                conditions.append(some_values(values, tests))
        return conditions

    def _bounds(self, quantity: Function) -> Quantity:
        return self.names.quantities[quantity.name]

    def apart(self) -> list[Comparison]:
        """What keeps two changes from meeting the same quantity."""
        return distinct_quantities(
            itertools.combinations((expression.value for _, expression, _ in self.found), 2)
        )

    def effects(self) -> Iterator[Effect]:
        """The end of each old value, and the new one."""
        for kind, quantity, amount in self.found:
            values, new = self._new(kind, quantity.value, amount.value)
            yield from value_change(
                quantity.value, new, values, self._bounds(quantity.value), self._fresh
            )

    def _new(
        self, kind: str, quantity: Function, amount: Term
    ) -> tuple[dict[Function, Variable], Term]:
        """The variables for the quantities that a change reads, and the value after it."""
        values: dict[Function, Variable] = {}
        old = replace_quantities(quantity, self.names.quantities, values, self._fresh)
        by = replace_quantities(amount, self.names.quantities, values, self._fresh)
        return values, by if kind == "assign" else Operation(
            "+" if kind == "increase" else "-", old, by
        )
