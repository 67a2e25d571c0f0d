"""The operators of a domain file."""

from collections.abc import Iterable
from typing import Any

from kb.diagnostics import nearest, unknown_name
from kb.loader.counted import Counted
from kb.loader.inference import Typing, scoped
from kb.loader.measures import MeasureReader
from kb.loader.names import Names
from kb.loader.numeric import Changes, refuse_quantity, with_values
from kb.loader.quantities import child
from kb.loader.reader import Expression, Reader
from kb.loader.safety import occurrences, refuse_unbound, warn_singletons
from kb.model.bindings import closed, extended, free_variables
from kb.model.conditions import And, Condition, Parameter, goal_parts
from kb.model.domain import Command, Effect, Kind, Look, Operator
from kb.terms import ANYTHING, Atom, Function, Term, Variable, variables

READABLE = (Kind.STATIC, Kind.FLUENT, Kind.DERIVED)
CHANGEABLE = (Kind.FLUENT, Kind.EVENT)


def read_operators(reader: Reader, names: Names) -> tuple[Operator, ...]:
    """All operators that can be read. Errors in the others are added to the findings."""
    found: dict[str, Operator] = {}
    for key, key_node, _ in reader.entries("operators"):
        header = reader.parse("header", key_node)
        if header is None:
            continue
        if header.value.name in found:
            message = f"the operator '{header.value.name}' is declared twice"
            names.findings.add(key_node.where, "K104", message, "choose another name")
        found[header.value.name] = _OperatorReader(reader, names, key, header).read()
    _warn_of_lone_resources(names, found.values())
    return tuple(found.values())


def _warn_of_lone_resources(names: Names, operators: Iterable[Operator]) -> None:
    """Warn of a resource that is not an object and that only one operator holds: it may be misspelt."""
    holders: dict[str, list[Operator]] = {}
    for operator in operators:
        for name in {r.name for r in operator.resources if isinstance(r, Function) and not r.arguments}:
            holders.setdefault(name, []).append(operator)
    for name, held_by in holders.items():
        hint = nearest(name, [*names.objects, *(other for other in holders if other != name)])
        if name not in names.objects and len(held_by) == 1 and hint:
            message = f"only {held_by[0].name} holds '{name}', which is not an object"
            names.findings.add(held_by[0].where, "K101", message, hint, warning=True)


class _OperatorReader:
    """Reads one operator. Types are inferred from all its atoms before it is built."""

    def __init__(self, reader: Reader, names: Names, key: str, header: Expression) -> None:
        self.reader, self.names, self.header = reader, names, header
        self.path: tuple[str, ...] = ("operators", key)
        self.typing = Typing(names)
        self.fields: dict[str, Expression | None] = {}
        self.measures = MeasureReader(reader, names, self.path)
        self.changes = Changes(reader, names, self.path)

    def read(self) -> Operator:
        for name, start in _FIELDS.items():
            self.fields[name] = self.reader.expression(start, *self.path, name)
            if self.fields[name] is None and self.reader.text(*self.path, name):
                self.typing.sound = False
        if expression := self.fields["preconditions"]:
            scope = scoped(with_values(expression, self.names), self.header.value.arguments)
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
            duration=self._value("duration", None),
            cost=self._value("cost", None),
            command=self._command(),
            online=tuple(self._online()),
            where=self.header.node.where,
        )
        self._warn(operator)
        return operator

    def _resources(self) -> tuple[Term, ...]:
        """Each resource once, with a warning for every repetition."""
        resources: tuple[Term, ...] = self._value("resources", ())
        if (expression := self.fields["resources"]) and len(set(resources)) < len(resources):
            twice = next(each for each in resources if resources.count(each) > 1)
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
            getattr(operator, name) for name in ("precondition", "body", "resources", "duration", "cost")
        ]
        effects = [part for each in operator.effects for part in (each.atom, each.condition)]
        command = operator.command
        said = [command.stream, command.reply, command.result] if command else []
        said += [each.value for each in self.measures.given.values()]
        said += [each.fact for each in operator.online]
        counted = occurrences([self.header.value, *standing, *effects, *said])
        if where := self.fields["where"]:
            inner = [v for part in where.value for v in free_variables(part) if v not in operator.variables]
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
        known = [*self.header.value.arguments, *_variables_of(self._value("where", ()))]
        narrowed(self.reader, self.names, self.typing, self.path, known)
        for name, kinds in _CONDITIONS.items():
            if expression := self.fields[name]:
                self.typing.condition(And(expression.value), expression, kinds)
        for name, kinds in _CHANGES.items():
            if expression := self.fields[name]:
                for atom in expression.value:
                    self.typing.atom(atom, expression, kinds)
                    refuse_quantity(atom, expression, self.names)
        for name, type_ in _NUMBERS.items():
            if expression := self.fields[name]:
                Counted(self.names, self.typing, name, type_, expression).check()
        self.measures.infer(self.typing)
        self.changes.infer(self.typing)
        self._infer_from_events()
        self._check_header()

    def _infer_from_events(self) -> None:
        """Narrow the types of the header's variables by the events in conditional effects, where nothing else does."""
        for atom in self._added_under_conditions():
            predicate = self.names.predicates.get(atom.name)
            if predicate is not None and predicate.kind is Kind.EVENT:
                for argument, type_ in zip(atom.arguments, predicate.arguments, strict=False):
                    if isinstance(argument, Variable) and argument in self.header.value.arguments:
                        self.typing.weak.setdefault(argument, type_)

    def _check_header(self) -> None:
        header = self.header.value.arguments
        for variable in header:
            if header.count(variable) > 1 or variable == ANYTHING:
                message = f"the variable {variable} cannot be used {'twice' if variable != ANYTHING else ''}".rstrip()
                hint = "each variable of a header needs a different name"
                self.names.findings.add(self.header.place(variable), "K104", f"{message} in a header", hint)

    def _refuse_strangers(self) -> None:
        """Report variables that occur outside `where:` but not in the header."""
        known = {*self.header.value.arguments, ANYTHING}
        for name in _OUTSIDE_WHERE:
            if expression := self.fields[name]:
                for variable in dict.fromkeys(_variables_of(expression.value)):
                    if variable not in known:
                        hint = nearest(str(variable), [str(each) for each in known])
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
        """Report numbers, times and texts without a value, and unbound variables that only occur in `where:`."""
        body, precondition = self._value("where", ()), self._value("preconditions", ())
        events = [
            atom
            for atom in (*self._value("adds", ()), *self._added_under_conditions())
            if (predicate := self.names.predicates.get(atom.name)) and predicate.kind is Kind.EVENT
        ]
        given = extended(parameters) | {v for atom in events for v in variables(atom)}
        bound = closed(given, (*body, *precondition))
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
        found = self.typing.quantified(And(expression.value), expression)
        return And((*goal_parts(found), *more)) if more else found

    def _effects(self, parameters: tuple[Parameter, ...]) -> Iterable[Effect]:
        for name in ("adds", "deletes"):
            yield from (Effect(atom, name == "adds") for atom in self._value(name, ()))
        for index, _ in enumerate(self.reader.items(*self.path, "effects")):
            yield from self._conditional(index, parameters)
        yield from self.changes.effects()

    def _conditional(self, index: int, parameters: tuple[Parameter, ...]) -> Iterable[Effect]:
        when = self.reader.expression("conditions", *self.path, "effects", index, "when")
        if when is None:
            return
        when = scoped(with_values(when, self.names), self.header.value.arguments)
        typing = self.typing.nested()
        typing.condition(And(when.value), when, READABLE)
        changes = {
            name: self.reader.expression("atoms", *self.path, "effects", index, name)
            for name in ("adds", "deletes")
        }
        for name, changed in changes.items():
            if changed:
                refuse_anything(changed, name, self.names)
                for atom in changed.value:
                    typing.atom(atom, changed, _CHANGES[name])
                    refuse_quantity(atom, changed, self.names)
        if not any(changes.values()):
            hint = "say what it `adds` or `deletes`"
            self.names.findings.add(when.node.where, "K114", "this effect changes nothing", hint)
        condition = typing.quantified(And(when.value), when)
        known = {parameter.variable for parameter in parameters}
        for name, changed in changes.items():
            for atom in changed.value if changed else ():
                used = [*free_variables(condition), *variables(atom)]
                local = [v for v in dict.fromkeys(used) if v not in known and v != ANYTHING]
                own = typing.parameters(local, changed if changed and local else when)
                bound = closed(extended(own) | known, when.value)
                refuse_unbound(local, bound, when, self.names, "use it in an atom of `when:`")
                yield Effect(atom, name == "adds", own, condition)

    def _online(self) -> Iterable[Look]:
        """What is looked at when a step is carried out: one fact that its arguments determine."""
        for index, node in enumerate(self.reader.items(*self.path, "online")):
            said = self.reader.expression("atoms", *self.path, "online", index, "fact")
            if said is None:
                continue
            strangers = [v for v in variables(said.value[0]) if v not in self.header.value.arguments]
            if strangers or len(said.value) > 1:
                message = f"`online` looks at one fact about the variables of {self.header.value}"
                hint = "write an entry for each fact"
                self.names.findings.add(said.node.where, "K105", message, hint)
                continue
            self.typing.nested().atom(said.value[0], said, READABLE)
            during = child(node, "during")
            yield Look(said.value[0], during is not None and during.value == "true")

    def _added_under_conditions(self) -> Iterable[Atom]:
        for index, _ in enumerate(self.reader.items(*self.path, "effects")):
            added = self.reader.expression("atoms", *self.path, "effects", index, "adds")
            yield from added.value if added else ()

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
                    message = f"the variable {variable} is neither in the header nor in the reply"
                    hint = nearest(str(variable), [str(each) for each in known])
                    hint = hint or "let the reply bind it: `reply: value(Val)`"
                    self.names.findings.add(expression.place(variable), "K105", message, hint)
        measures = self.measures.read(
            self.header.value.name, self.header.value.arguments, reply.value if reply else None
        )
        return Command(
            stream.value,
            reply.value if reply else Function("done"),
            result.value if result else None,
            measures,
        )


_FIELDS = {
    "where": "body", "preconditions": "conditions", "adds": "atoms", "deletes": "atoms",
    "resources": "terms", "duration": "term", "cost": "term",
}  # fmt: skip


_OUTSIDE_WHERE = ("preconditions", "adds", "deletes", "resources", "duration", "cost")
_UNBOUND_HINT = "read it from a static in `where:`, or add an event whose workflow stage names it"
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


def refuse_anything(expression: Expression, name: str, names: Names) -> None:
    """Report `_` where it cannot be used, because it has no value."""
    if ANYTHING in _variables_of(expression.value):
        hint = "name a variable that something binds"
        names.findings.add(expression.place(ANYTHING), "K105", f"'_' cannot be used in `{name}`", hint)


def narrowed(
    reader: Reader, names: Names, typing: Typing, path: tuple[str | int, ...], known: Iterable[Variable]
) -> None:
    """Apply the `types:` of an entry. Its variables are `known`."""
    variables_ = [str(each) for each in known]
    for variable, key, node in reader.entries(*path, "types"):
        if variable not in variables_:
            names.findings.note(unknown_name("variable", variable, variables_, key.where))
        elif names.known_type(str(node.value)):
            typing.types[Variable(variable)] = str(node.value)
        else:
            names.miss_type(str(node.value), names.types, node.where)
