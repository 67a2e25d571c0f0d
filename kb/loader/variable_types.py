"""Infers the types of variables from atoms, and reports unbound and lone variables.

Only positive atoms narrow the type of a variable: `not part_of(Place, drawer)` also holds for
places that are no depots.
"""

import dataclasses
from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from typing import Any

from cellwright.kb.diagnostics import nearest_hint, unknown_name
from cellwright.kb.loader.reader import Expression
from cellwright.kb.loader.symbol_table import SymbolTable, argument_count_message
from cellwright.kb.model.condition_forms import free_variables
from cellwright.kb.model.conditions import (
    Aggregate,
    And,
    Comparison,
    Condition,
    Exists,
    ForAll,
    Literal,
    Not,
    Or,
    Parameter,
    all_conditions,
    part_variables,
)
from cellwright.kb.model.domain_model import NUMERIC_TYPES, OBJECT_TYPE, Kind
from cellwright.kb.terms import (
    ANYTHING,
    Atom,
    Function,
    Number,
    Operation,
    Term,
    Text,
    Variable,
    term_variables,
)


class Typing:
    """The types of the variables of one operator, rule or goal. Each atom can narrow them."""

    def __init__(self, names: SymbolTable, types: dict[Variable, str] | None = None) -> None:
        self.names = names
        self.types: dict[Variable, str] = dict(types or {})
        self.weak: dict[Variable, str] = {}  # from negative atoms
        self.sound = True  # if False, a reported error explains missing types

    def nested(self) -> "Typing":
        """A scope inside this one. Types that are narrowed in it are not changed outside."""
        inner = Typing(self.names, self.types)
        inner.weak, inner.sound = dict(self.weak), self.sound
        return inner

    def type_of(self, variable: Variable) -> str | None:
        """The type found for a variable, or None if no atom gives one."""
        return self.types.get(variable, self.weak.get(variable))

    def atom(
        self,
        atom: Atom,
        expression: Expression,
        kinds: Collection[Kind] = tuple(Kind),
        positive: bool = True,
    ) -> None:
        """Check the name, arity, kind and arguments of an atom, and narrow the types of its
        variables.
        """
        predicate = self.names.predicate(atom, expression, kinds)
        if predicate is None:
            self.sound = False
            return
        if predicate.kind is not Kind.STATIC and any(map(has_arithmetic, atom.arguments)):
            hint = "bind the result in `where:`, as in M = N + 1"
            message = f"arithmetic is allowed in constraints, but not in {atom.name}(...)"
            self.names.findings.add(expression.place(atom), "K107", message, hint)
        if atom.name in self.names.types and atom.name not in self.names.predicates:
            expected: tuple[str, ...] = (atom.name,) if positive else (OBJECT_TYPE,)
        else:
            expected = predicate.arguments
        for argument, type_ in zip(atom.arguments, expected, strict=True):
            self.term(argument, type_, expression, atom, positive)

    def term(
        self, term: Term, expected: str, expression: Expression, atom: Atom, positive: bool = True
    ) -> None:
        """Check that a term can have the expected type."""
        match term:
            case Variable():
                self._narrow(term, expected, expression, atom, positive)
            case Number() | Operation():
                if expected not in NUMERIC_TYPES:
                    self._mismatch(str(term), "a number", expected, expression, atom)
            case Text():
                if expected != "text":
                    self._mismatch(str(term), "a text", expected, expression, atom)
            case Function(name, arguments) if arguments or name in self.names.functions:
                self._compound(term, expected, expression, atom, positive)
            case Function(name):
                self._constant(term, name, expected, expression, atom)

    def _constant(
        self, term: Function, name: str, expected: str, expression: Expression, atom: Atom
    ) -> None:
        if name[0] in "-0123456789":
            hint = "only whole numbers are allowed: choose a smaller unit"
            self.names.findings.add(
                expression.node.where, "K103", f"{name} is not a whole number", hint
            )
            return
        actual = self.names.objects.get(name)
        if actual is None:
            known = [
                name
                for name, type_ in self.names.objects.items()
                if self.names.is_subtype(type_, expected)
            ]
            where = expression.place(term)
            self.names.findings.note(
                unknown_name("object", name, known or self.names.objects, where)
            )
        elif not self.names.is_subtype(actual, expected):
            self._mismatch(name, actual, expected, expression, atom)

    def _compound(
        self, term: Function, expected: str, expression: Expression, atom: Atom, positive: bool
    ) -> None:
        function = self.names.functions.get(term.name)
        if function is None:
            where = expression.place(term)
            self.names.findings.note(
                unknown_name("function", term.name, self.names.functions, where)
            )
            return
        if len(term.arguments) != len(function.arguments):
            hint = f"it is {function.name}({', '.join(function.arguments)})"
            self.names.findings.add(
                expression.place(term),
                "K102",
                argument_count_message(term, len(function.arguments)),
                hint,
            )
            return
        if not self.names.is_subtype(function.result, expected):
            self._mismatch(str(term), function.result, expected, expression, atom)
        for argument, type_ in zip(term.arguments, function.arguments, strict=True):
            self.term(argument, type_, expression, atom, positive)

    def _narrow(
        self, variable: Variable, expected: str, expression: Expression, atom: Atom, positive: bool
    ) -> None:
        if variable == ANYTHING:
            return
        if not positive:
            self.weak.setdefault(variable, expected)
            return
        known = self.types.get(variable, expected)
        if self.names.is_subtype(expected, known):
            self.types[variable] = expected
        elif not self.names.is_subtype(known, expected):
            self._mismatch(str(variable), known, expected, expression, atom)

    def _mismatch(
        self, term: str, actual: str, expected: str, expression: Expression, atom: Atom
    ) -> None:
        message = f"{term} is of type {actual}, but {atom.name} takes {expected} here"
        self.names.findings.add(
            expression.place(atom), "K103", message, self.names.examples(expected)
        )

    def condition(
        self,
        condition: Condition,
        expression: Expression,
        kinds: Collection[Kind],
        positive: bool = True,
    ) -> None:
        """Check every atom of a condition, and narrow the types of variables by the positive
        atoms.
        """
        match condition:
            case Literal(atom, sign):
                self.atom(atom, expression, kinds, positive and sign)
            case And(parts) | Or(parts):
                for part in parts:
                    self.condition(part, expression, kinds, positive)
            case Not(part) | Exists(_, part):
                self.condition(part, expression, kinds, positive and isinstance(condition, Exists))
            case ForAll(parameters, part):
                self._universal(parameters, part, expression, kinds)
            case Comparison(left, _, right):
                self._compared(left, expression)
                self._compared(right, expression)
            case Aggregate():
                check_aggregate(condition, expression, self.names)

    def _universal(
        self,
        parameters: tuple[Parameter, ...],
        part: Condition,
        expression: Expression,
        kinds: Collection[Kind],
    ) -> "Typing":
        """Narrow types by a universal condition.

        Its own variables are known only in the returned scope.
        """
        inner = self.nested()
        for side in guard_and_claim(part):
            inner.condition(side, expression, kinds)
        own = {parameter.variable for parameter in parameters}
        self.types.update({v: type_ for v, type_ in inner.types.items() if v not in own})
        return inner

    def _compared(self, term: Term, expression: Expression) -> None:
        """Check the names in a comparison, because a misspelt name would never be equal to
        anything.
        """
        match term:
            case Operation(_, left, right):
                self._compared(left, expression)
                self._compared(right, expression)
            case Function(name, ()) if name not in self.names.functions:
                if name not in self.names.objects:
                    where = expression.place(term)
                    self.names.findings.note(
                        unknown_name("object", name, self.names.objects, where)
                    )
            case Function(name):
                function = self.names.functions.get(name)
                self._compound(
                    term, function.result if function else OBJECT_TYPE, expression, term, True
                )

    def parameters(
        self, wanted: Iterable[Variable], expression: Expression, code: str = "K105"
    ) -> tuple[Parameter, ...]:
        """The variables as typed parameters. A variable without a type is reported."""
        parameters = []
        for variable in wanted:
            type_ = self.type_of(variable)
            if type_ is None and self.sound:
                hint = "use it in an atom that binds it, or name its type under `types:`"
                self.names.findings.add(
                    expression.place(variable),
                    code,
                    f"nothing gives the variable {variable} a type",
                    hint,
                )
            parameters.append(Parameter(variable, type_ or OBJECT_TYPE))
        return tuple(parameters)

    def quantified(self, condition: Condition, expression: Expression) -> Condition:
        """The condition with typed quantifiers.

        Each `_` in a positive or negative literal means some value.
        """
        match condition:
            case Literal(atom, positive) if ANYTHING in term_variables(atom):
                return self._some(atom, positive)
            case And(parts):
                return And(tuple(self.quantified(part, expression) for part in parts))
            case Or(parts):
                return Or(tuple(self.quantified(part, expression) for part in parts))
            case Not(part):
                return Not(self.quantified(part, expression))
            case ForAll(parameters, part):
                inner = self._universal(parameters, part, expression, tuple(Kind))
                typed = inner.parameters(
                    [parameter.variable for parameter in parameters], expression
                )
                return ForAll(typed, inner.quantified(part, expression))
            case _:
                return condition

    def _some(self, atom: Atom, positive: bool) -> Condition:
        fresh: list[Parameter] = []
        predicate = self.names.predicates.get(atom.name)
        expected = predicate.arguments if predicate else (OBJECT_TYPE,) * len(atom.arguments)
        arguments = tuple(
            self._renamed(a, t, fresh) for a, t in zip(atom.arguments, expected, strict=False)
        )
        some = Exists(tuple(fresh), Literal(Function(atom.name, arguments)))
        return some if positive else Not(some)

    def _renamed(self, term: Term, type_: str, fresh: list[Parameter]) -> Term:
        if term == ANYTHING:
            fresh.append(Parameter(Variable(f"_Any{len(fresh) + 1}"), type_))
            return fresh[-1].variable
        if isinstance(term, Function) and term.arguments:
            function = self.names.functions.get(term.name)
            expected = function.arguments if function else (OBJECT_TYPE,) * len(term.arguments)
            inner = zip(term.arguments, expected, strict=False)
            return Function(term.name, tuple(self._renamed(a, t, fresh) for a, t in inner))
        return term


def has_arithmetic(term: Term) -> bool:
    """Whether a term contains arithmetic."""
    match term:
        case Operation():
            return True
        case Function(_, arguments):
            return any(map(has_arithmetic, arguments))
        case _:
            return False


def scope_conditions(expression: Expression, outer: Collection[Variable]) -> Expression:
    """The conditions. A universal condition quantifies only those variables that occur neither
    outside nor beside it.
    """
    parts = tuple(_scope_part(part, expression.value, outer) for part in expression.value)
    return dataclasses.replace(expression, value=parts)


def _scope_part(
    part: Condition, beside: tuple[Condition, ...], outer: Collection[Variable]
) -> Condition:
    if not isinstance(part, ForAll):
        return part
    taken = {*outer, *(v for other in beside if other is not part for v in free_variables(other))}
    own = tuple(parameter for parameter in part.parameters if parameter.variable not in taken)
    return ForAll(own, part.part) if own else part.part


def guard_and_claim(part: Condition) -> tuple[Condition, ...]:
    """The guard and the claim of a universal condition.

    The guard binds variables, so it is returned as positive.
    """
    match part:
        case Or((Not(guard), claim)):
            return guard, claim
        case _:
            return (part,)


def check_aggregate(aggregate: Aggregate, expression: Expression, names: SymbolTable) -> None:
    """Check the names in an aggregate.

    It stays text for clingo, which would take an unknown name for an empty predicate.
    """
    where = expression.node.where
    for name, arity in aggregate.uses:
        predicate = names.predicates.get(name)
        if predicate is None and not (names.known_type(name) and arity == 1):
            hint = nearest_hint(name, names.predicates)
            names.findings.add(where, "K101", f"unknown predicate '{name}'", hint)
        elif predicate and predicate.kind is not Kind.STATIC:
            hint = (
                "let a rule count it: `crowded :- #count { T : at(T, rack) } > 2.`, with "
                "`crowded` under `derived:`"
            )
            names.findings.add(
                where, "K108", f"'{name}' can change, so it cannot be used in an aggregate", hint
            )


def refuse_unbound(
    wanted: Iterable[Variable],
    bound: Collection[Variable],
    expression: Expression,
    names: SymbolTable,
    hint: str,
) -> None:
    """Report every wanted variable that is not bound."""
    for variable in dict.fromkeys(wanted):
        if variable != ANYTHING and variable not in bound:
            message = f"nothing binds the variable {variable}"
            near = nearest_hint(str(variable), [str(bound_variable) for bound_variable in bound])
            names.findings.add(expression.place(variable), "K105", message, near or hint)


def count_occurrences(values: Iterable[object]) -> Counter[Variable]:
    """The number of occurrences of each variable in terms, atoms, conditions and nested tuples
    of them; `_` is not counted.
    """
    counts: Counter[Variable] = Counter()
    for value in values:
        counts.update(variable for variable in _variables_in(value) if variable != ANYTHING)
    return counts


def _variables_in(value: object) -> Iterator[Variable]:
    match value:
        case tuple():
            for part in value:
                yield from _variables_in(part)
        case Variable() | Function() | Operation():
            yield from term_variables(value)
        case Literal() | Comparison():
            yield from _of_part(value)
        case Aggregate(standing=standing):
            yield from standing
        case None:
            return
        case _:
            yield from (v for part in all_conditions(value) for v in _of_part(part))  # type: ignore[arg-type]


def _of_part(part: Condition) -> Iterator[Variable]:
    match part:
        case Literal() | Comparison():
            yield from part_variables(part)
        case Aggregate():
            yield from _variables_in(part)
        case _:
            return


def warn_singletons(
    suspects: Iterable[Variable],
    counted: Counter[Variable],
    expression: Expression,
    names: SymbolTable,
    advice: str = "write '_' or '_{}' if anything will do",
) -> None:
    """Warn of the suspects that occur only once.

    A name that begins with `_` shows that this is intended.
    """
    for variable in dict.fromkeys(suspects):
        if counted[variable] == 1 and not variable.name.startswith("_"):
            other_names = [candidate.name for candidate in counted if candidate != variable]
            hint = nearest_hint(variable.name, other_names) or advice.format(variable)
            message = f"the variable {variable} occurs only once"
            names.findings.add(expression.place(variable), "K110", message, hint, warning=True)


def body_variables(body: Iterable[Condition]) -> tuple[Variable, ...]:
    """The free variables of a body, each once."""
    return tuple(dict.fromkeys(variable for part in body for variable in free_variables(part)))


def free_in(value: Any) -> Iterable[Variable]:
    """The free variables of a tuple of atoms, terms or conditions."""
    for part in value if isinstance(value, tuple) else (value,):
        yield from term_variables(part) if isinstance(part, Term) else free_variables(part)


def refuse_anything(expression: Expression, name: str, names: SymbolTable) -> None:
    """Report `_` where it cannot be used, because it has no value."""
    if ANYTHING in free_in(expression.value):
        hint = "name a variable that something binds"
        names.findings.add(
            expression.place(ANYTHING), "K105", f"'_' cannot be used in `{name}`", hint
        )
