"""Reads PDDL conditions and effects as conditions and effects of the model."""

from collections.abc import Iterator, Mapping

from cellwright.engine.formats.interop.pddl.declared_names import PddlScope
from cellwright.engine.formats.interop.pddl.expressions import Document, Expression, Group, PddlWord
from cellwright.engine.formats.interop.pddl.number_reader import NumberReader
from cellwright.engine.formats.interop.pddl.numeric_functions import (
    ARITHMETIC_SIGNS,
    CHANGE_WORDS,
    TaskFunctions,
    Unreadable,
    function_of,
    written_number,
)
from cellwright.kb.diagnostics import nearest_hint
from cellwright.kb.model.condition_forms import RELATION_NEGATIONS
from cellwright.kb.model.conditions import (
    ALWAYS_TRUE,
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
from cellwright.kb.model.domain_model import OBJECT_TYPE, Effect
from cellwright.kb.terms import Atom, Function, Term, Variable

COMPARISON_WORDS = ("<", ">", "<=", ">=")
TEMPORAL_WORDS = {
    "at",
    "over",
    "preference",
    "always",
    "sometime",
    "within",
    "at-most-once",
    "sometime-after",
    "at end",
}
Types = Mapping[Variable, str]


class ConditionReader:
    """Reads the conditions and effects of one document."""

    def __init__(
        self, document: Document, scope: PddlScope, functions: TaskFunctions | None = None
    ) -> None:
        self.document, self.scope = document, scope
        self.numbers = NumberReader(document, scope.names, functions or TaskFunctions())

    def condition(self, at: Expression, types: Types) -> Condition:
        """A condition. A wrong part is reported and replaced by true."""
        if isinstance(at, PddlWord):
            self.document.add(
                at, "K801", f"'{at.text}' is not a condition", "write conditions in parentheses"
            )
            return ALWAYS_TRUE
        if not at.parts:
            return ALWAYS_TRUE
        match at.head:
            case "and" | "or":
                parts = tuple(self.condition(part, types) for part in at.rest)
                return And(parts) if at.head == "and" else Or(parts)
            case "not" if len(at.rest) == 1:
                return self._negated(self.condition(at.rest[0], types))
            case "imply" if len(at.rest) == 2:
                premise, conclusion = (self.condition(part, types) for part in at.rest)
                return Or((self._negated(premise), conclusion))
            case "exists" | "forall" if len(at.rest) == 2 and isinstance(at.rest[0], Group):
                return self.numbers.by_itself(lambda: self._quantified(at, types))
            case _:
                return self._simple(at, types)

    def _simple(self, at: Group, types: Types) -> Condition:
        """A comparison or a literal."""
        if at.head == "=":
            return self._equality(at, types)
        if at.head in COMPARISON_WORDS:
            return self.numbers.comparison(at, lambda group: self.function(group, types))
        atom = self.atom(at, types)
        return ALWAYS_TRUE if atom is None else Literal(atom)

    def _negated(self, condition: Condition) -> Condition:
        match condition:
            case Literal(atom, positive):
                return Literal(atom, not positive)
            case Comparison(left, relation, right):
                return Comparison(left, RELATION_NEGATIONS[relation], right)
            case _:
                return Not(condition)

    def _quantified(self, at: Group, types: Types) -> Condition:
        listed = at.rest[0]
        assert isinstance(listed, Group)
        parameters = self.scope.parameters(self.document, listed.parts)
        inner = self.condition(at.rest[1], {**types, **{p.variable: p.type for p in parameters}})
        return Exists(parameters, inner) if at.head == "exists" else ForAll(parameters, inner)

    def _equality(self, at: Group, types: Types) -> Condition:
        """Two numbers are equal, or two objects are the same one."""
        if any(self._is_number(part) for part in at.rest):
            return self.numbers.comparison(at, lambda group: self.function(group, types))
        if len(at.rest) != 2:
            self.document.add(at, "K102", "'=' compares two objects, or two numbers")
            return ALWAYS_TRUE
        left, right = (self.term(part, OBJECT_TYPE, types) for part in at.rest)
        return Comparison(left, "=", right)

    def _is_number(self, at: Expression) -> bool:
        if isinstance(at, PddlWord):
            return written_number(at) is not None or at.text in self.scope.functions
        return at.head in ARITHMETIC_SIGNS or at.head in self.scope.functions

    def function(self, at: Group, types: Types) -> Function:
        """A numeric function with its arguments. Raises `Unreadable`."""
        signature = self.scope.functions.get(at.head)
        if signature is None:
            near = nearest_hint(at.head, list(self.scope.functions))
            raise Unreadable(at, f"there is no function '{at.head}'{f' ({near})' if near else ''}")
        if len(at.rest) != len(signature):
            raise Unreadable(at, f"{at.head} takes {len(signature)} arguments, not {len(at.rest)}")
        arguments = (
            self.term(part, type_, types) for part, type_ in zip(at.rest, signature, strict=True)
        )
        return Function(self.scope.names.of("predicate", at.head), tuple(arguments))

    def _unsupported(self, at: Expression, what: str) -> None:
        hint = "no times, preferences, constraints and object fluents are read"
        self.document.add(at, "K802", f"{what} are not supported", hint)

    def atom(self, at: Group, types: Types) -> Atom | None:
        """An atom, checked against the declared predicates; None if it does not match them."""
        signature = self.scope.predicates.get(at.head)
        if signature is None:
            self._unknown(at)
            return None
        if len(at.rest) != len(signature):
            self.document.add(
                at, "K102", f"{at.head} takes {len(signature)} arguments, not {len(at.rest)}"
            )
            return None
        arguments = (
            self.term(part, type_, types) for part, type_ in zip(at.rest, signature, strict=True)
        )
        return Function(self.scope.names.of("predicate", at.head), tuple(arguments))

    def _unknown(self, at: Group) -> None:
        if at.head in self.scope.functions:
            self.document.add(
                at, "K103", f"'{at.head}' is a number, not a condition", "compare it: (>= (...) 1)"
            )
        elif at.head in TEMPORAL_WORDS:
            self._unsupported(at, "temporal conditions, preferences and timed literals")
        else:
            near = nearest_hint(at.head, list(self.scope.predicates))
            self.document.add(at, "K101", f"unknown predicate '{at.head}'", near)

    def term(self, at: Expression, expected: str, types: Types) -> Term:
        """A variable in scope or an object.

        A type that surely differs from the expected one is reported.
        """
        if isinstance(at, Group):
            self._unsupported(at, "object fluents")
            return Function("unreadable")
        if at.text.startswith("?"):
            variable = self.scope.names.variable(at.text)
            if variable not in types:
                self.document.add(at, "K105", f"variable {at.text} is not declared here")
            elif not self.scope.overlaps(types[variable], expected):
                self._mismatch(at, types[variable], expected)
            return variable
        if at.text not in self.scope.objects:
            self.document.add(
                at,
                "K101",
                f"unknown object '{at.text}'",
                nearest_hint(at.text, list(self.scope.objects)),
            )
        elif not self.scope.is_subtype(self.scope.objects[at.text], expected):
            self._mismatch(at, self.scope.objects[at.text], expected)
        return Function(self.scope.names.of("object", at.text))

    def _mismatch(self, at: PddlWord, actual: str, expected: str) -> None:
        original = self.scope.names.original
        said = (
            f"{at.text} is {original('type', actual)}, but {original('type', expected)} is "
            "wanted here"
        )
        self.document.add(at, "K103", said)

    def effects(
        self,
        at: Expression,
        types: Types,
        local: tuple[Parameter, ...] = (),
        when: Condition = ALWAYS_TRUE,
    ) -> Iterator[Effect]:
        """The effects of an action but those on numbers."""
        if isinstance(at, PddlWord):
            self.document.add(
                at, "K801", f"'{at.text}' is not an effect", "write effects in parentheses"
            )
            return
        match at.head:
            case "and" | "":
                for part in at.rest:
                    yield from self.effects(part, types, local, when)
            case "forall" if len(at.rest) == 2 and isinstance(at.rest[0], Group):
                parameters = self.scope.parameters(self.document, at.rest[0].parts)
                inner = {**types, **{p.variable: p.type for p in parameters}}
                yield from self.effects(at.rest[1], inner, (*local, *parameters), when)
            case "when" if len(at.rest) == 2:
                condition = self.condition(at.rest[0], types)
                yield from self.effects(at.rest[1], types, local, And((when, condition)))
            case head if head in CHANGE_WORDS:
                self._known(at)
            case _:
                yield from self._effect(at, types, local, when)

    def _effect(
        self, at: Group, types: Types, local: tuple[Parameter, ...], when: Condition
    ) -> Iterator[Effect]:
        inner = at.rest[0] if at.head == "not" and len(at.rest) == 1 else at
        atom = self.atom(inner, types) if isinstance(inner, Group) else None
        if atom is not None:
            yield Effect(atom, inner is at, local, when)

    def _known(self, at: Group) -> None:
        """Report what is no change of a number."""
        changed = function_of(at.rest[0]) if len(at.rest) == 2 else None
        if changed is None or changed.head not in self.scope.functions:
            self.document.add(
                at,
                "K801",
                f"'{at.head}' changes a function by an amount",
                "write (increase (f ?x) 1)",
            )
