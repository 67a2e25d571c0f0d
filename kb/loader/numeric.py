"""Quantities in domains: `volume(Bottle)` stands for the N of the fluent `volume(Bottle, N)`."""

import dataclasses
import itertools
from collections.abc import Iterator, Mapping

from cellwright.kb.loader.counted import Counted
from cellwright.kb.loader.inference import Typing
from cellwright.kb.loader.names import Names
from cellwright.kb.loader.reader import Expression, Reader
from cellwright.kb.model.conditions import And, Comparison, Condition, ForAll, Not, Or, literals
from cellwright.kb.model.domain import Effect, Quantity
from cellwright.kb.model.quantities import Fresh, apart, change, compared, replaced, some, within
from cellwright.kb.terms import Atom, Function, Number, Operation, Term, Variable, variables

CHANGES = ("increase", "decrease", "assign")


def with_values(expression: Expression, names: Names) -> Expression:
    """The conditions, with fluents in the place of quantities in comparisons."""
    if not names.quantities:
        return expression
    for literal in literals(And(expression.value)):
        refuse_quantity(literal.atom, expression, names)
    fresh = itertools.count()
    parts = tuple(_valued(part, names.quantities, fresh) for part in expression.value)
    return dataclasses.replace(expression, value=parts)


def refuse_quantity(atom: Atom, expression: Expression, names: Names) -> None:
    """Report a quantity that stands as a fact with its value."""
    if atom.name in names.quantities:
        said = f"{atom.name}({', '.join(map(str, atom.arguments[:-1]))})" if atom.arguments[1:] else atom.name
        message = f"'{atom.name}' is a quantity: its value is compared, and changed by increase, decrease and assign"
        names.findings.add(expression.place(atom), "K108", message, f"write a comparison: {said} >= 1")


def _valued(condition: Condition, known: Mapping[str, Quantity], fresh: Fresh) -> Condition:
    match condition:
        case Comparison():
            return compared(condition, known, fresh)
        case And(parts) | Or(parts):
            return type(condition)(tuple(_valued(part, known, fresh) for part in parts))
        case Not(part):
            return Not(_valued(part, known, fresh))
        case ForAll(parameters, part):
            return ForAll(parameters, _valued(part, known, fresh))
        case _:
            return condition


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
            plain = replaced(amount.value, self.names.quantities, values, self._fresh)
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
            if tests := within(new, self._bounds(quantity.value)):
                found.append(some(values, tests))
        return found

    def _bounds(self, quantity: Function) -> Quantity:
        return self.names.quantities[quantity.name]

    def apart(self) -> list[Comparison]:
        """What keeps two changes from meeting the same quantity."""
        return apart(itertools.combinations((each.value for _, each, _ in self.found), 2))

    def effects(self) -> Iterator[Effect]:
        """The end of each old value, and the new one."""
        for kind, quantity, amount in self.found:
            values, new = self._new(kind, quantity.value, amount.value)
            yield from change(quantity.value, new, values, self._bounds(quantity.value), self._fresh)

    def _new(self, kind: str, quantity: Function, amount: Term) -> tuple[dict[Function, Variable], Term]:
        """The variables for the quantities that a change reads, and the value after it."""
        values: dict[Function, Variable] = {}
        old = replaced(quantity, self.names.quantities, values, self._fresh)
        by = replaced(amount, self.names.quantities, values, self._fresh)
        return values, by if kind == "assign" else Operation("+" if kind == "increase" else "-", old, by)
