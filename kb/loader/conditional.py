"""The conditional effects of an operator: under `effects`, what a step adds and deletes `when` a condition holds."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from cellwright.kb.loader.inference import Typing, scoped
from cellwright.kb.loader.names import CHANGEABLE, READABLE, Names
from cellwright.kb.loader.numeric import refuse_quantity, with_values
from cellwright.kb.loader.reader import Expression, Reader
from cellwright.kb.loader.safety import refuse_anything, refuse_unbound
from cellwright.kb.model.bindings import closed, extended, free_variables
from cellwright.kb.model.conditions import And, Condition, Parameter
from cellwright.kb.model.domain import Effect, Kind
from cellwright.kb.terms import ANYTHING, Atom, Variable, variables

CHANGES: dict[str, tuple[Kind, ...]] = {"adds": CHANGEABLE, "deletes": (Kind.FLUENT,)}


def infer_changed(typing: Typing, expression: Expression, name: str, names: Names) -> None:
    """Narrow the types of variables by what is changed under `name`. A quantity there is reported."""
    for atom in expression.value:
        typing.atom(atom, expression, CHANGES[name])
        refuse_quantity(atom, expression, names)


@dataclass(frozen=True)
class ConditionalEffects:
    """Reads the conditional effects of the operator at `path` with this header."""

    reader: Reader
    names: Names
    path: tuple[str, ...]
    header: Expression

    def added(self) -> Iterator[Atom]:
        """Every atom that is added under a condition."""
        for index in self._numbers():
            added = self._changed(index, "adds")
            yield from added.value if added else ()

    def infer(self, typing: Typing) -> None:
        """Narrow the types of the header's variables by the events that are added, where nothing else does."""
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
                scope = scoped(with_values(when, self.names), self.header.value.arguments)
                yield from self._effects(index, scope, typing.nested(), parameters)

    def _numbers(self) -> range:
        return range(len(self.reader.items(*self.path, "effects")))

    def _changed(self, index: int, name: str) -> Expression | None:
        return self.reader.expression("atoms", *self.path, "effects", index, name)

    def _effects(
        self, index: int, when: Expression, typing: Typing, parameters: tuple[Parameter, ...]
    ) -> Iterator[Effect]:
        typing.condition(And(when.value), when, READABLE)
        read = {name: self._changed(index, name) for name in CHANGES}
        changes = {name: changed for name, changed in read.items() if changed}
        for name, changed in changes.items():
            refuse_anything(changed, name, self.names)
            infer_changed(typing, changed, name, self.names)
        if not changes:
            hint = "say what it `adds` or `deletes`"
            self.names.findings.add(when.node.where, "K114", "this effect changes nothing", hint)
        condition = typing.quantified(And(when.value), when)
        known = {parameter.variable for parameter in parameters}
        yield from self._bound(changes, condition, when, typing, known)

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
                used = [*free_variables(condition), *variables(atom)]
                local = [v for v in dict.fromkeys(used) if v not in known and v != ANYTHING]
                own = typing.parameters(local, changed if local else when)
                bound = closed(extended(own) | known, when.value)
                refuse_unbound(local, bound, when, self.names, "use it in an atom of `when:`")
                yield Effect(atom, name == "adds", own, condition)
