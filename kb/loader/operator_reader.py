"""Reads the operators of a domain file, with the types of their variables."""

from collections.abc import Iterable
from typing import Any

from cellwright.kb.diagnostics import nearest_hint, unknown_name
from cellwright.kb.loader.numeric_expressions import NumericExpression, QuantityChanges, with_values
from cellwright.kb.loader.operator_parts import (
    EFFECT_CHANGES,
    ConditionalEffects,
    DeviceReader,
    MeasureReader,
    infer_changed,
)
from cellwright.kb.loader.reader import Expression, Reader
from cellwright.kb.loader.symbol_table import CONDITION_KINDS, SymbolTable
from cellwright.kb.loader.variable_types import (
    Typing,
    count_occurrences,
    free_in,
    refuse_anything,
    refuse_unbound,
    scope_conditions,
    warn_singletons,
)
from cellwright.kb.loader.varying_durations import DurationReader
from cellwright.kb.model.condition_forms import (
    enumerable_parameters,
    free_variables,
    variables_bound_by,
)
from cellwright.kb.model.conditions import And, Condition, Parameter, goal_parts
from cellwright.kb.model.domain_model import Effect, Kind, Operator
from cellwright.kb.terms import ANYTHING, Function, Term, Variable, term_variables


def read_operators(reader: Reader, names: SymbolTable) -> tuple[Operator, ...]:
    """All operators that can be read. Errors in the others are added to the findings."""
    operators: dict[str, Operator] = {}
    for key, key_node, _ in reader.entries("operators"):
        header = reader.parse("header", key_node)
        if header is None:
            continue
        if header.value.name in operators:
            message = f"the operator '{header.value.name}' is declared twice"
            names.findings.add(key_node.where, "K104", message, "choose another name")
        operators[header.value.name] = _OperatorReader(reader, names, key, header).read()
    _warn_of_lone_resources(names, operators.values())
    return tuple(operators.values())


def _warn_of_lone_resources(names: SymbolTable, operators: Iterable[Operator]) -> None:
    """Warn of a resource that is not an object and that only one operator holds: it may be
    misspelt.
    """
    holders: dict[str, list[Operator]] = {}
    for operator in operators:
        for name in {
            r.name for r in operator.resources if isinstance(r, Function) and not r.arguments
        }:
            holders.setdefault(name, []).append(operator)
    for name, held_by in holders.items():
        hint = nearest_hint(
            name, [*names.objects, *(holder for holder in holders if holder != name)]
        )
        if name not in names.objects and len(held_by) == 1 and hint:
            message = f"only {held_by[0].name} holds '{name}', which is not an object"
            names.findings.add(held_by[0].where, "K101", message, hint, warning=True)


class _OperatorReader:
    """Reads one operator. Types are inferred from all its atoms before it is built."""

    def __init__(self, reader: Reader, names: SymbolTable, key: str, header: Expression) -> None:
        self.reader, self.names, self.header = reader, names, header
        self.path: tuple[str, ...] = ("operators", key)
        self.typing = Typing(names)
        self.fields: dict[str, Expression | None] = {}
        self.measures = MeasureReader(reader, names, self.path)
        self.changes = QuantityChanges(reader, names, self.path)
        self.conditional = ConditionalEffects(reader, names, self.path, header)
        self.device = DeviceReader(reader, names, self.path, header)
        self.duration = DurationReader(reader, names, self.path)

    def read(self) -> Operator:
        for name, start in _OPERATOR_FIELDS.items():
            self.fields[name] = self.reader.expression(start, *self.path, name)
            if self.fields[name] is None and self.reader.text(*self.path, name):
                self.typing.sound = False
        if expression := self.fields["preconditions"]:
            scope = scope_conditions(
                with_values(expression, self.names), self.header.value.arguments
            )
            self.fields["preconditions"] = scope
        self._infer()
        self._refuse_strangers()
        self._refuse_strange_changes()
        parameters = self.typing.parameters(dict.fromkeys(self.header.value.arguments), self.header)
        self._refuse_unbound(parameters)
        operator = Operator(
            self.header.value.name,
            parameters,
            self._condition("preconditions"),
            tuple(self._effects(parameters)),
            body=(*self._value("where", ()), *self.changes.apart()),
            resources=self._resources(),
            duration=self.duration.usual(self._value("duration", None)),
            cost=self._value("cost", None),
            command=self.device.command(self.measures),
            online=tuple(self.device.looks(self.typing)),
            varies=self.duration.varies(),
            where=self.header.node.where,
        )
        self._warn(operator)
        return operator

    def _resources(self) -> tuple[Term, ...]:
        """Each resource once, with a warning for every repetition."""
        resources: tuple[Term, ...] = self._value("resources", ())
        if (expression := self.fields["resources"]) and len(set(resources)) < len(resources):
            twice = next(resource for resource in resources if resources.count(resource) > 1)
            place = expression.place(twice if isinstance(twice, Function | Variable) else None)
            self.names.findings.add(
                place, "K111", f"'{twice}' is listed twice", "leave one out", warning=True
            )
        return tuple(dict.fromkeys(resources))

    def _warn(self, operator: Operator) -> None:
        """Warn of variables that occur only once, and of operators that change nothing."""
        if not self.typing.sound:
            return
        standing = [
            getattr(operator, name) for name in ("precondition", "body", "resources", "amounts")
        ]
        effects = [part for effect in operator.effects for part in (effect.atom, effect.condition)]
        command = operator.command
        said = [command.stream, command.reply, command.result] if command else []
        said += [expression.value for expression in self.measures.given.values()]
        said += [look.fact for look in operator.online]
        counted = count_occurrences([self.header.value, *standing, *effects, *said])
        if where := self.fields["where"]:
            inner = [
                v
                for part in where.value
                for v in free_variables(part)
                if v not in operator.variables
            ]
            warn_singletons(inner, counted, where, self.names)
        advice = "leave it out, or call it '_{}' if it is meant"
        warn_singletons(operator.variables, counted, self.header, self.names, advice)
        if not operator.effects and self.typing.sound:
            message, hint = f"{operator.header} changes nothing", "say what it `adds`"
            self.names.findings.add(operator.where, "K114", message, hint, warning=True)

    def _value(self, name: str, default: Any) -> Any:
        expression = self.fields[name]
        return default if expression is None else expression.value

    def _infer(self) -> None:
        known = [*self.header.value.arguments, *free_in(self._value("where", ()))]
        narrow_types(self.reader, self.names, self.typing, self.path, known)
        for name, kinds in _CONDITIONS.items():
            if expression := self.fields[name]:
                self.typing.condition(And(expression.value), expression, kinds)
        for name in EFFECT_CHANGES:
            if expression := self.fields[name]:
                infer_changed(self.typing, expression, name, self.names)
        for name, type_ in _NUMBERS.items():
            if expression := self.fields[name]:
                NumericExpression(self.names, self.typing, name, type_, expression).check()
        self.measures.infer(self.typing)
        self.changes.infer(self.typing)
        self.duration.infer(self.typing)
        self.conditional.infer(self.typing)
        self._check_header()

    def _check_header(self) -> None:
        header = self.header.value.arguments
        for variable in header:
            if header.count(variable) > 1 or variable == ANYTHING:
                message = (
                    f"the variable {variable} cannot be used "
                    f"{'twice' if variable != ANYTHING else ''}"
                ).rstrip()
                hint = "each variable of a header needs a different name"
                self.names.findings.add(
                    self.header.place(variable), "K104", f"{message} in a header", hint
                )

    def _refuse_strangers(self) -> None:
        """Report variables that occur outside `where:` but not in the header."""
        known = {*self.header.value.arguments, ANYTHING}
        outside = [self.fields[name] for name in _OUTSIDE_WHERE]
        for expression in (*outside, *self.duration.given.values()):
            if expression:
                for variable in dict.fromkeys(free_in(expression.value)):
                    if variable not in known:
                        hint = nearest_hint(
                            str(variable), [str(known_variable) for known_variable in known]
                        )
                        hint = hint or f"add it to the header {self.header.value}"
                        message = f"the variable {variable} is not in the header"
                        self.names.findings.add(expression.place(variable), "K105", message, hint)
                        self.typing.sound = False
        for name in _OUTSIDE_WHERE[1:]:
            if expression := self.fields[name]:
                refuse_anything(expression, name, self.names)

    def _refuse_strange_changes(self) -> None:
        """Report variables in changes of quantities that are not in the header."""
        known = self.header.value.arguments
        for variable, expression in self.changes.variables:
            if variable not in known:
                message = f"the variable {variable} is not in the header"
                hint = f"add it to the header {self.header.value}"
                self.names.findings.add(expression.place(variable), "K105", message, hint)
                self.typing.sound = False

    def _refuse_unbound(self, parameters: tuple[Parameter, ...]) -> None:
        """Report numbers, times and texts without a value, and unbound variables that only
        occur in `where:`.
        """
        body, precondition = self._value("where", ()), self._value("preconditions", ())
        events = [
            atom
            for atom in (*self._value("adds", ()), *self.conditional.added())
            if (predicate := self.names.predicates.get(atom.name)) and predicate.kind is Kind.EVENT
        ]
        given = enumerable_parameters(parameters) | {
            v for atom in events for v in term_variables(atom)
        }
        bound = variables_bound_by(given, (*body, *precondition))
        typed = [v for v in self.header.value.arguments if self.typing.type_of(v) is not None]
        refuse_unbound(typed, bound, self.header, self.names, _UNBOUND_HINT)
        if where := self.fields["where"]:
            inner = [v for part in body for v in free_variables(part)]
            wanted = [v for v in inner if v not in self.header.value.arguments]
            refuse_unbound(wanted, bound, where, self.names, "use it in an atom of `where:`")

    def _condition(self, name: str) -> Condition:
        expression = self.fields[name]
        more = self.changes.conditions()
        if expression is None:
            return And(tuple(more))
        condition = self.typing.quantified(And(expression.value), expression)
        return And((*goal_parts(condition), *more)) if more else condition

    def _effects(self, parameters: tuple[Parameter, ...]) -> Iterable[Effect]:
        for name in EFFECT_CHANGES:
            yield from (Effect(atom, name == "adds") for atom in self._value(name, ()))
        yield from self.conditional.read(self.typing, parameters)
        yield from self.changes.effects()


_OPERATOR_FIELDS = {
    "where": "body", "preconditions": "conditions", "adds": "atoms", "deletes": "atoms",
    "resources": "terms", "duration": "term", "cost": "term",
}  # fmt: skip


_OUTSIDE_WHERE = ("preconditions", "adds", "deletes", "resources", "duration", "cost")
_UNBOUND_HINT = "read it from a static in `where:`, or add an event whose workflow stage names it"
_CONDITIONS: dict[str, tuple[Kind, ...]] = {
    "where": (Kind.STATIC,),
    "preconditions": CONDITION_KINDS,
}
_NUMBERS = {"duration": "time", "cost": "int"}


def narrow_types(
    reader: Reader,
    names: SymbolTable,
    typing: Typing,
    path: tuple[str | int, ...],
    known: Iterable[Variable],
) -> None:
    """Apply the `types:` of an entry. Its variables are `known`."""
    variables_ = [str(variable) for variable in known]
    for variable, key, node in reader.entries(*path, "types"):
        if variable not in variables_:
            names.findings.note(unknown_name("variable", variable, variables_, key.where))
        elif names.known_type(str(node.value)):
            typing.types[Variable(variable)] = str(node.value)
        else:
            names.miss_type(str(node.value), names.types, node.where)
