"""Parts of an operator: its measurements, device commands and conditional effects."""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass

from cellwright.kb.diagnostics import nearest_hint
from cellwright.kb.loader.numeric_expressions import NumericExpression, refuse_quantity, with_values
from cellwright.kb.loader.reader import Expression, Reader
from cellwright.kb.loader.symbol_table import CHANGEABLE_KINDS, CONDITION_KINDS, SymbolTable
from cellwright.kb.loader.variable_types import (
    Typing,
    refuse_anything,
    refuse_unbound,
    scope_conditions,
)
from cellwright.kb.loader.yaml_tree import child_at
from cellwright.kb.model.condition_forms import (
    enumerable_parameters,
    free_variables,
    variables_bound_by,
)
from cellwright.kb.model.conditions import And, Condition, Parameter
from cellwright.kb.model.domain_model import Command, Effect, Kind, Look, Measure
from cellwright.kb.terms import ANYTHING, Atom, Function, Number, Term, Variable, term_variables

MEASURE_TERMS = ("of", "by", "value")
MEASURE_NUMBERS = {
    "nominal": "int", "tolerance": "int", "lower": "int", "upper": "int", "uncertainty": "int",
    "risk": "int", "worth": "time",
    "usual": "int",
}  # fmt: skip
SIGNED_NUMBERS = ("nominal", "lower", "upper", "usual")


class MeasureReader:
    """Reads what one operator measures. Its numbers are like those of durations."""

    def __init__(self, reader: Reader, names: SymbolTable, path: tuple[str, ...]) -> None:
        self.reader, self.names, self.path = reader, names, (*path, "command", "measures")
        expressions = (
            (name, reader.expression("term", *self.path, name))
            for name in (*MEASURE_TERMS, *MEASURE_NUMBERS)
        )
        self.given = {
            name: expression for name, expression in expressions if expression is not None
        }

    def infer(self, typing: Typing) -> None:
        """What its numbers say of the types of variables."""
        for name, type_ in MEASURE_NUMBERS.items():
            if expression := self.given.get(name):
                NumericExpression(
                    self.names, typing, name, type_, expression, signed=name in SIGNED_NUMBERS
                ).check()

    def read(
        self, operator: str, header: Collection[Variable], reply: Term | None
    ) -> Measure | None:
        """What is measured; None if nothing is, or if it cannot be read.

        What is wrong with it goes to the findings.
        """
        if "of" not in self.given or "value" not in self.given:
            return None
        heard = [*term_variables(reply)] if reply is not None else []
        self._refuse_strangers([*header], heard)
        self._refuse_nonsense()
        value = self.given["value"].value
        if not isinstance(value, Variable):
            return None
        terms = {
            name: expression.value for name, expression in self.given.items() if name != "value"
        }
        return Measure(
            value=value,
            unit=self.reader.text(*self.path, "unit"),
            quantity=self.reader.text(*self.path, "quantity") or operator,
            where=self.given["of"].node.where,
            **terms,
        )

    def _refuse_strangers(self, header: list[Variable], heard: list[Variable]) -> None:
        value = self.given["value"]
        if value.value not in heard:
            hint = (
                nearest_hint(str(value.value), [*map(str, heard)])
                or "let the reply bind it: `reply: value(Val)`"
            )
            message = f"the measured value {value.value} is no variable of the reply"
            self.names.findings.add(value.node.where, "K105", message, hint)
        for name, expression in self.given.items():
            for variable in term_variables(expression.value) if name != "value" else ():
                if variable not in header:
                    hint = (
                        nearest_hint(str(variable), [*map(str, header)]) or "add it to the header"
                    )
                    message = f"the variable {variable} is not in the header"
                    self.names.findings.add(expression.place(variable), "K105", message, hint)

    def _refuse_nonsense(self) -> None:
        for place, message, hint in (
            *_contradicting_limits(self.given),
            *_contradicting_uncertainty(self.given),
        ):
            self.names.findings.add(place.node.where, "K316", message, hint)


def _contradicting_limits(given: dict[str, Expression]) -> Iterator[tuple[Expression, str, str]]:
    """What contradicts itself in the limits of a measurement, where, and what to try."""
    tolerance, limits = (
        given.get("tolerance"),
        [given[key] for key in ("lower", "upper") if key in given],
    )
    if tolerance is not None and limits:
        yield (
            tolerance,
            "both a tolerance and limits are given",
            "keep the tolerance, or `lower` and `upper`",
        )
    if tolerance is not None and "nominal" not in given:
        yield (
            tolerance,
            "a tolerance without a nominal value",
            "add `nominal`, or give `lower` and `upper`",
        )
    if tolerance is not None and tolerance.value == Number(0):
        yield tolerance, "nothing passes a tolerance of 0", "give how wide the zone is"
    values = [limit.value.value for limit in limits if isinstance(limit.value, Number)]
    if len(values) == 2 and values[0] > values[1]:
        yield (
            limits[0],
            f"the lower limit {values[0]} is above the upper limit {values[1]}",
            "exchange them",
        )


def _contradicting_uncertainty(
    given: dict[str, Expression],
) -> Iterator[tuple[Expression, str, str]]:
    """What contradicts itself in what is said of the uncertainty of a measurement."""
    if "uncertainty" not in given:
        for name in ("risk", "worth"):
            if name in given:
                yield (
                    given[name],
                    f"a {name} without an uncertainty",
                    "add `uncertainty`: two standard deviations",
                )
    risk = given.get("risk")
    if risk is not None and isinstance(risk.value, Number) and not 0 < risk.value.value < 50:
        yield risk, f"a risk of {risk.value} percent", "write more than 0 and less than 50"


@dataclass(frozen=True)
class DeviceReader:
    """Reads what the operator at `path` with this header tells devices and asks of them."""

    reader: Reader
    names: SymbolTable
    path: tuple[str, ...]
    header: Expression

    def command(self, measures: MeasureReader) -> Command | None:
        """The command with what it measures; None if there is none. What is wrong with it goes
        to the findings.
        """
        stream, reply, result = (self._term(name) for name in ("stream", "reply", "result"))
        if stream is None:
            return None
        for expression in filter(None, (stream, result)):
            self._refuse_strangers(expression, reply)
        header = self.header.value
        return Command(
            stream.value,
            reply.value if reply else Function("done"),
            result.value if result else None,
            measures.read(header.name, header.arguments, reply.value if reply else None),
        )

    def _term(self, name: str) -> Expression | None:
        return self.reader.expression("term", *self.path, "command", name)

    def _refuse_strangers(self, expression: Expression, reply: Expression | None) -> None:
        """Report variables that neither the header nor the reply has."""
        known = {*self.header.value.arguments, *(term_variables(reply.value) if reply else ())}
        for variable in term_variables(expression.value):
            if variable not in known:
                message = f"the variable {variable} is neither in the header nor in the reply"
                hint = nearest_hint(
                    str(variable), [str(known_variable) for known_variable in known]
                )
                hint = hint or "let the reply bind it: `reply: value(Val)`"
                self.names.findings.add(expression.place(variable), "K105", message, hint)

    def looks(self, typing: Typing) -> Iterator[Look]:
        """What is looked at when a step is carried out: each entry is one fact that its
        arguments determine.
        """
        for index, node in enumerate(self.reader.items(*self.path, "online")):
            said = self.reader.expression("atoms", *self.path, "online", index, "fact")
            if said is None:
                continue
            strangers = [
                v for v in term_variables(said.value[0]) if v not in self.header.value.arguments
            ]
            if strangers or len(said.value) > 1:
                message = f"`online` looks at one fact about the variables of {self.header.value}"
                hint = "write an entry for each fact"
                self.names.findings.add(said.node.where, "K105", message, hint)
                continue
            typing.nested().atom(said.value[0], said, CONDITION_KINDS)
            during = child_at(node, "during")
            yield Look(said.value[0], during is not None and during.value == "true")


EFFECT_CHANGES: dict[str, tuple[Kind, ...]] = {"adds": CHANGEABLE_KINDS, "deletes": (Kind.FLUENT,)}


def infer_changed(typing: Typing, expression: Expression, name: str, names: SymbolTable) -> None:
    """Narrow the types of variables by what is changed under `name`.

    A quantity there is reported.
    """
    for atom in expression.value:
        typing.atom(atom, expression, EFFECT_CHANGES[name])
        refuse_quantity(atom, expression, names)


@dataclass(frozen=True)
class ConditionalEffects:
    """Reads the conditional effects of the operator at `path` with this header."""

    reader: Reader
    names: SymbolTable
    path: tuple[str, ...]
    header: Expression

    def added(self) -> Iterator[Atom]:
        """Every atom that is added under a condition."""
        for index in self._numbers():
            added = self._changed(index, "adds")
            yield from added.value if added else ()

    def infer(self, typing: Typing) -> None:
        """Narrow the types of the header's variables by the events that are added, where
        nothing else does.
        """
        for atom in self.added():
            predicate = self.names.predicates.get(atom.name)
            if predicate is not None and predicate.kind is Kind.EVENT:
                for argument, type_ in zip(atom.arguments, predicate.arguments, strict=False):
                    if isinstance(argument, Variable) and argument in self.header.value.arguments:
                        typing.weak.setdefault(argument, type_)

    def read(self, typing: Typing, parameters: tuple[Parameter, ...]) -> Iterator[Effect]:
        """Every effect, with the variables of its own. What is wrong goes to the findings."""
        for index in self._numbers():
            when = self.reader.expression("conditions", *self.path, "effects", index, "when")
            if when is not None:
                scope = scope_conditions(with_values(when, self.names), self.header.value.arguments)
                yield from self._effects(index, scope, typing.nested(), parameters)

    def _numbers(self) -> range:
        return range(len(self.reader.items(*self.path, "effects")))

    def _changed(self, index: int, name: str) -> Expression | None:
        return self.reader.expression("atoms", *self.path, "effects", index, name)

    def _effects(
        self, index: int, when: Expression, typing: Typing, parameters: tuple[Parameter, ...]
    ) -> Iterator[Effect]:
        typing.condition(And(when.value), when, CONDITION_KINDS)
        read = {name: self._changed(index, name) for name in EFFECT_CHANGES}
        changes = {name: changed for name, changed in read.items() if changed}
        for name, changed in changes.items():
            refuse_anything(changed, name, self.names)
            infer_changed(typing, changed, name, self.names)
        if not changes:
            hint = "say what it `adds` or `deletes`"
            self.names.findings.add(when.node.where, "K114", "this effect changes nothing", hint)
        condition = typing.quantified(And(when.value), when)
        parameter_variables = {parameter.variable for parameter in parameters}
        yield from self._bound(changes, condition, when, typing, parameter_variables)

    def _bound(
        self,
        changes: Mapping[str, Expression],
        condition: Condition,
        when: Expression,
        typing: Typing,
        known: set[Variable],
    ) -> Iterator[Effect]:
        """The effects on each atom. A variable of its own that nothing binds is reported."""
        for name, changed in changes.items():
            for atom in changed.value:
                used = [*free_variables(condition), *term_variables(atom)]
                local = [v for v in dict.fromkeys(used) if v not in known and v != ANYTHING]
                own = typing.parameters(local, changed if local else when)
                bound = variables_bound_by(enumerable_parameters(own) | known, when.value)
                refuse_unbound(local, bound, when, self.names, "use it in an atom of `when:`")
                yield Effect(atom, name == "adds", own, condition)
