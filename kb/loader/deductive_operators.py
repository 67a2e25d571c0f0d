"""The deductive operators and the defaults of a domain file."""

from collections.abc import Iterable, Sequence

from cellwright.kb.diagnostics import Source
from cellwright.kb.loader.numeric_expressions import refuse_quantity
from cellwright.kb.loader.operator_reader import narrow_types
from cellwright.kb.loader.reader import Expression, Reader
from cellwright.kb.loader.symbol_table import CHANGEABLE_KINDS, SymbolTable
from cellwright.kb.loader.variable_types import (
    Typing,
    body_variables,
    count_occurrences,
    refuse_anything,
    refuse_unbound,
    warn_singletons,
)
from cellwright.kb.model.condition_forms import enumerable_parameters, variables_bound_by
from cellwright.kb.model.conditions import Body, Literal
from cellwright.kb.model.domain_model import Consequence, DeductiveOperator, Default, Kind
from cellwright.kb.terms import ANYTHING, Function, Variable, term_variables

Clause = tuple[Function, Body]
CONSEQUENCE_FIELDS = {"implies": True, "denies": False}


def read_deductive_operators(reader: Reader, names: SymbolTable) -> tuple[DeductiveOperator, ...]:
    """All deductive operators that can be read."""
    deductive = (
        _DeductionReader(reader, names, index).read()
        for index, _ in enumerate(reader.items("deductive_operators"))
    )
    return tuple(operator for operator in deductive if operator is not None)


class _DeductionReader:
    """Reads one deductive operator.

    Its clauses share the variable types of the trigger and of `where:`.
    """

    def __init__(self, reader: Reader, names: SymbolTable, index: int) -> None:
        self.reader, self.names = reader, names
        self.path: tuple[str | int, ...] = ("deductive_operators", index)
        self.where = reader.expression("body", *self.path, "where")
        self.body: Body = self.where.value if self.where else ()
        self.clauses = {
            name: reader.expression("clauses", *self.path, name) for name in CONSEQUENCE_FIELDS
        }

    def read(self) -> DeductiveOperator | None:
        when = self.reader.expression("trigger", *self.path, "when")
        if when is None:
            return None
        trigger: Literal = when.value
        typing = self._typing(when)
        consequences = [
            consequence
            for name, expression in self.clauses.items()
            if expression
            for consequence in self._consequences(typing, trigger.atom, expression, name)
        ]
        named = dict.fromkeys(v for v in term_variables(trigger.atom) if v != ANYTHING)
        self._check(trigger, when)
        return DeductiveOperator(
            trigger, typing.parameters(named, when), self.body, tuple(consequences), when.node.where
        )

    def _typing(self, when: Expression) -> Typing:
        typing = Typing(self.names)
        known = [
            *term_variables(when.value.atom),
            *body_variables(self.body),
            *count_occurrences(self._values()),
        ]
        narrow_types(self.reader, self.names, typing, self.path, known)
        typing.atom(when.value.atom, when, CHANGEABLE_KINDS)
        refuse_quantity(when.value.atom, when, self.names)
        if self.where:
            for part in self.body:
                typing.condition(part, self.where, (Kind.STATIC,))
        return typing

    def _values(self) -> list[tuple[Clause, ...]]:
        return [expression.value for expression in self.clauses.values() if expression]

    def _check(self, trigger: Literal, when: Expression) -> None:
        predicate = self.names.predicates.get(trigger.atom.name)
        if predicate and predicate.kind is Kind.EVENT and not trigger.positive:
            hint = "trigger on the event itself, or on a fluent"
            message = (
                f"'{trigger.atom.name}' is an event, which is never denied, so this never happens"
            )
            self.names.findings.add(when.node.where, "K108", message, hint)
        if not any(self.clauses.values()):
            hint = "say what it `implies` or `denies`"
            self.names.findings.add(when.node.where, "K114", "nothing follows from this", hint)
        if self.where:
            counted = count_occurrences([trigger, self.body, *self._values()])
            warn_singletons(body_variables(self.body), counted, self.where, self.names)

    def _consequences(
        self, outer: Typing, trigger: Function, expression: Expression, name: str
    ) -> Iterable[Consequence]:
        if CONSEQUENCE_FIELDS[name]:
            for atom, _ in expression.value:
                if ANYTHING in term_variables(atom):
                    refuse_anything(expression, name, self.names)
        for atom, guard in expression.value:
            scope = outer.nested()
            scope.atom(atom, expression, (Kind.FLUENT,))
            refuse_quantity(atom, expression, self.names)
            for part in guard:
                scope.condition(part, expression, (Kind.STATIC,))
            used = dict.fromkeys(
                [
                    *term_variables(trigger),
                    *term_variables(atom),
                    *body_variables((*self.body, *guard)),
                ]
            )
            wanted = [variable for variable in used if scope.type_of(variable) is not None]
            parameters = scope.parameters([v for v in wanted if v != ANYTHING], expression)
            given = enumerable_parameters(parameters) | {
                *term_variables(trigger),
                *(() if CONSEQUENCE_FIELDS[name] else term_variables(atom)),
            }
            bound = variables_bound_by(given, (*self.body, *guard))
            refuse_unbound(
                used, bound, expression, self.names, "read it from a static, or from the trigger"
            )
            counted = count_occurrences([trigger, self.body, atom, guard])
            warn_singletons(
                [*term_variables(atom), *body_variables(guard)], counted, expression, self.names
            )
            yield Consequence(atom, CONSEQUENCE_FIELDS[name], guard, parameters)


def read_defaults(reader: Reader, names: SymbolTable) -> tuple[Default, ...]:
    """The defaults in their order.

    `atom, guard` has one instance per binding of the guard and the types.
    """
    read = ((node, reader.parse("clauses", node)) for node in reader.items("defaults"))
    defaults = [
        default
        for node, expression in read
        if expression is not None
        for default in _make_defaults(names, expression, node.where)
    ]
    _warn_of_repeated(names, defaults)
    return tuple(defaults)


def _warn_of_repeated(names: SymbolTable, defaults: Sequence[Default]) -> None:
    seen: set[tuple[Function, Body]] = set()
    for default in defaults:
        if (default.atom, default.body) in seen:
            message = f"the default {default.atom} is listed twice"
            names.findings.add(default.where, "K111", message, "leave one out", warning=True)
        seen.add((default.atom, default.body))


def _make_defaults(names: SymbolTable, expression: Expression, where: Source) -> Iterable[Default]:
    for atom, guard in expression.value:
        typing = Typing(names)
        typing.atom(atom, expression, (Kind.FLUENT,))
        refuse_quantity(atom, expression, names)
        for part in guard:
            typing.condition(part, expression, (Kind.STATIC,))
        refuse_anything(_head_expression(expression, atom), "defaults", names)
        used = dict.fromkeys(variable for variable in term_variables(atom) if variable != ANYTHING)
        parameters = typing.parameters(used, expression)
        bound = variables_bound_by(enumerable_parameters(parameters), guard)
        wanted = [*used, *body_variables(guard)]
        refuse_unbound(
            wanted, bound, expression, names, "add an atom that binds it: `at(P, D), home(P, D)`"
        )
        counted = count_occurrences([atom, guard])
        inner: list[Variable] = [
            variable for variable in body_variables(guard) if variable not in used
        ]
        warn_singletons(inner, counted, expression, names)
        yield Default(atom, parameters, guard, where)


def _head_expression(expression: Expression, atom: Function) -> Expression:
    return Expression((atom,), expression.parsed, expression.node)
