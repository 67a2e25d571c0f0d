"""Operators, deductive operators and defaults of a domain file."""

from collections.abc import Iterable
from typing import Any

from kb.diagnostics import Source, unknown_name
from kb.loader.names import Names, Typing
from kb.loader.reader import Expression, Reader
from kb.model.conditions import TRUE, And, Body, Condition, Parameter, free_variables
from kb.model.domain import Command, Consequence, DeductiveOperator, Default, Effect, Kind, Operator
from kb.terms import ANYTHING, Function, Term, Variable, variables

READABLE = (Kind.STATIC, Kind.FLUENT, Kind.DERIVED)
CHANGEABLE = (Kind.FLUENT, Kind.EVENT)


def read_operators(reader: Reader, names: Names) -> tuple[Operator, ...]:
    """Every operator that can be read; what is wrong with the others is noted."""
    found: dict[str, Operator] = {}
    for key, key_node, _ in reader.entries("operators"):
        header = reader.parse("header", key_node)
        if header is None:
            continue
        if header.value.name in found:
            names.findings.add(key_node.where, "K104", f"operator '{header.value.name}' is declared twice")
        found[header.value.name] = _OperatorReader(reader, names, key, header).read()
    return tuple(found.values())


class _OperatorReader:
    """One operator: types are inferred over all its atoms before anything is built."""

    def __init__(self, reader: Reader, names: Names, key: str, header: Expression) -> None:
        self.reader, self.names, self.header = reader, names, header
        self.path: tuple[str, ...] = ("operators", key)
        self.typing = Typing(names)
        self.fields: dict[str, Expression | None] = {}

    def read(self) -> Operator:
        for name, start in _FIELDS.items():
            self.fields[name] = self.reader.expression(start, *self.path, name)
        self._infer()
        parameters = self.typing.parameters(self.header.value.arguments, self.header)
        self._refuse_strangers(parameters)
        return Operator(
            self.header.value.name,
            parameters,
            self._condition("preconditions"),
            tuple(self._effects(parameters)),
            body=self._value("where", ()),
            resources=self._value("resources", ()),
            duration=self._value("duration", None),
            cost=self._value("cost", None),
            command=self._command(),
            where=self.header.node.where,
        )

    def _value(self, name: str, default: Any) -> Any:
        expression = self.fields[name]
        return default if expression is None else expression.value

    def _infer(self) -> None:
        narrowed(self.reader, self.names, self.typing, self.path)
        for name, kinds in _CONDITIONS.items():
            if expression := self.fields[name]:
                self.typing.condition(And(expression.value), expression, kinds)
        for name, kinds in _CHANGES.items():
            if expression := self.fields[name]:
                for atom in expression.value:
                    self.typing.atom(atom, expression, kinds)
        for name, type_ in _NUMBERS.items():
            if expression := self.fields[name]:
                self.typing.term(expression.value, type_, expression, self.header.value)

    def _refuse_strangers(self, parameters: tuple[Parameter, ...]) -> None:
        """Variables that stand outside `where:` but not in the header."""
        known = {parameter.variable for parameter in parameters} | {ANYTHING}
        for name in ("preconditions", "adds", "deletes", "resources", "duration", "cost"):
            if expression := self.fields[name]:
                for variable in dict.fromkeys(_variables_of(expression.value)):
                    if variable not in known:
                        hint = f"add it to the header {self.header.value}"
                        message = f"variable {variable} is not in the header"
                        self.names.findings.add(expression.place(variable), "K105", message, hint)
        for name in ("adds", "deletes", "resources"):
            if (expression := self.fields[name]) and ANYTHING in _variables_of(expression.value):
                self.names.findings.add(expression.place(ANYTHING), "K105", f"'_' cannot stand in {name}")

    def _condition(self, name: str) -> Condition:
        expression = self.fields[name]
        if expression is None:
            return TRUE
        return self.typing.quantified(And(expression.value), expression)

    def _effects(self, parameters: tuple[Parameter, ...]) -> Iterable[Effect]:
        for name in ("adds", "deletes"):
            yield from (Effect(atom, name == "adds") for atom in self._value(name, ()))
        for index, _ in enumerate(self.reader.items(*self.path, "effects")):
            yield from self._conditional(index, parameters)

    def _conditional(self, index: int, parameters: tuple[Parameter, ...]) -> Iterable[Effect]:
        when = self.reader.expression("conditions", *self.path, "effects", index, "when")
        if when is None:
            return
        typing = self.typing.nested()
        typing.condition(And(when.value), when, READABLE)
        changes = {
            name: self.reader.expression("atoms", *self.path, "effects", index, name)
            for name in ("adds", "deletes")
        }
        for changed in filter(None, changes.values()):
            for atom in changed.value:
                typing.atom(atom, changed, (Kind.FLUENT,))
        condition = typing.quantified(And(when.value), when)
        known = {parameter.variable for parameter in parameters}
        for name, expression in changes.items():
            for atom in expression.value if expression else ():
                used = [*free_variables(condition), *variables(atom)]
                local = dict.fromkeys(variable for variable in used if variable not in known)
                yield Effect(atom, name == "adds", typing.parameters(local, when), condition)

    def _command(self) -> Command | None:
        read = {
            name: self.reader.expression("term", *self.path, "command", name)
            for name in ("stream", "reply", "result")
        }
        stream, reply, result = read["stream"], read["reply"], read["result"]
        if stream is None:
            return None
        known = {*self.header.value.arguments, *(variables(reply.value) if reply else ())}
        for expression in filter(None, (stream, result)):
            for variable in variables(expression.value):
                if variable not in known:
                    message = f"variable {variable} is neither in the header nor in the reply"
                    self.names.findings.add(expression.place(variable), "K105", message)
        return Command(
            stream.value, reply.value if reply else Function("done"), result.value if result else None
        )


_FIELDS = {
    "where": "body", "preconditions": "conditions", "adds": "atoms", "deletes": "atoms",
    "resources": "terms", "duration": "term", "cost": "term",
}  # fmt: skip


_CONDITIONS: dict[str, tuple[Kind, ...]] = {"where": (Kind.STATIC,), "preconditions": READABLE}
_CHANGES: dict[str, tuple[Kind, ...]] = {"adds": CHANGEABLE, "deletes": (Kind.FLUENT,)}
_NUMBERS = {"duration": "time", "cost": "int"}


def _variables_of(value: Any) -> Iterable[Variable]:
    """The free variables of a tuple of atoms, terms or conditions."""
    for part in value if isinstance(value, tuple) else (value,):
        match part:
            case Function() | Variable():
                yield from variables(part)
            case _ if isinstance(part, Term):
                yield from variables(part)
            case _:
                yield from free_variables(part)


def narrowed(reader: Reader, names: Names, typing: Typing, path: tuple[str | int, ...]) -> None:
    """Apply the `types:` of an entry."""
    for variable, _, node in reader.entries(*path, "types"):
        if names.known_type(str(node.value)):
            typing.types[Variable(variable)] = str(node.value)
        else:
            names.findings.diagnostics.append(unknown_name("type", str(node.value), names.types, node.where))


def read_deductive_operators(reader: Reader, names: Names) -> tuple[DeductiveOperator, ...]:
    """Every deductive operator that can be read."""
    found = (_deductive(reader, names, index) for index, _ in enumerate(reader.items("deductive_operators")))
    return tuple(operator for operator in found if operator is not None)


def _deductive(reader: Reader, names: Names, index: int) -> DeductiveOperator | None:
    path = ("deductive_operators", index)
    when, where = reader.expression("trigger", *path, "when"), reader.expression("body", *path, "where")
    if when is None:
        return None
    typing = Typing(names)
    narrowed(reader, names, typing, path)
    typing.atom(when.value.atom, when, CHANGEABLE)
    body: Body = where.value if where else ()
    if where:
        for part in body:
            typing.condition(part, where, (Kind.STATIC,))
    consequences = [
        consequence
        for name in ("implies", "denies")
        if (expression := reader.expression("clauses", *path, name))
        for consequence in _consequences(typing, when.value.atom, body, expression, name == "implies")
    ]
    trigger_types = typing.parameters(
        dict.fromkeys(v for v in variables(when.value.atom) if v != ANYTHING), when
    )
    return DeductiveOperator(when.value, trigger_types, body, tuple(consequences), when.node.where)


def _consequences(
    outer: Typing, trigger: Function, body: Body, expression: Expression, implied: bool
) -> Iterable[Consequence]:
    for atom, guard in expression.value:
        scope = outer.nested()
        scope.atom(atom, expression, (Kind.FLUENT,))
        for part in guard:
            scope.condition(part, expression, (Kind.STATIC,))
        used = dict.fromkeys([*variables(trigger), *variables(atom), *free_variables(And((*body, *guard)))])
        wanted = [variable for variable in used if scope.type_of(variable) is not None]
        yield Consequence(atom, implied, guard, scope.parameters(wanted, expression))


def read_defaults(reader: Reader, names: Names) -> tuple[Default, ...]:
    """The defaults in their order; `atom, guard` instantiates over the guard and the types."""
    read = ((node, reader.parse("clauses", node)) for node in reader.items("defaults"))
    return tuple(
        default
        for node, expression in read
        if expression is not None
        for default in _defaults(names, expression, node.where)
    )


def _defaults(names: Names, expression: Expression, where: Source) -> Iterable[Default]:
    for atom, guard in expression.value:
        typing = Typing(names)
        typing.atom(atom, expression, (Kind.FLUENT,))
        for part in guard:
            typing.condition(part, expression, (Kind.STATIC,))
        used = dict.fromkeys(variable for variable in variables(atom) if variable != ANYTHING)
        yield Default(atom, typing.parameters(used, expression), guard, where)
