"""Reads PDDL conditions and effects as conditions and effects of the model."""

import itertools
from collections.abc import Iterator, Sequence

from cellwright.engine.formats.interop.pddl.declared_names import PddlScope, Variables
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
    Or,
    Parameter,
)
from cellwright.kb.model.domain_model import OBJECT_TYPE, Effect
from cellwright.kb.terms import Atom, Function, Term

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
# of PPDDL and of contingent tasks
UNCERTAIN_WORDS = {"oneof", "unknown", "probabilistic"}
FALSE = Or(())


class ConditionReader:
    """Reads the conditions and effects of one document."""

    def __init__(
        self, document: Document, scope: PddlScope, functions: TaskFunctions | None = None
    ) -> None:
        self.document, self.scope = document, scope
        self.numbers = NumberReader(document, scope.names, functions or TaskFunctions())

    def condition(self, at: Expression, known: Variables, positive: bool = True) -> Condition:
        """A condition, or the opposite of it. A wrong part is reported and replaced by true.

        Only literals and comparisons are negated: a comparison with a function that has no value is
        not satisfied, and neither is its opposite (Fox & Long 2003, definition 6).
        """
        if isinstance(at, PddlWord):
            self.document.add(
                at, "K801", f"'{at.text}' is not a condition", "write conditions in parentheses"
            )
            return ALWAYS_TRUE
        if not at.parts:
            return ALWAYS_TRUE if positive else FALSE
        match at.head:
            case "and" | "or":
                joins = And if (at.head == "and") == positive else Or
                return self._joined(joins, [(part, positive) for part in at.rest], known)
            case "not" if len(at.rest) == 1:
                return self.condition(at.rest[0], known, not positive)
            case "imply" if len(at.rest) == 2:
                pair = [(at.rest[0], not positive), (at.rest[1], positive)]
                return self._joined(Or if positive else And, pair, known)
            case "exists" | "forall" if len(at.rest) == 2 and isinstance(at.rest[0], Group):
                return self.numbers.by_itself(lambda: self._quantified(at, known, positive))
            case _:
                return self._simple(at, known, positive)

    def _joined(
        self, joins: type[And | Or], parts: Sequence[tuple[Expression, bool]], known: Variables
    ) -> Condition:
        """The conditions, or the opposites of those with `False`, joined; of the parts of `or`
        none is needed by itself.
        """
        needed = self.numbers.needed
        self.numbers.needed = needed and joins is And
        read = joins(tuple(self.condition(part, known, positive) for part, positive in parts))
        self.numbers.needed = needed
        return read

    def _simple(self, at: Group, known: Variables, positive: bool) -> Condition:
        """A comparison or a literal."""
        if at.head == "=":
            return self._equality(at, known, positive)
        if at.head in COMPARISON_WORDS:
            return self._compared(at, known, positive)
        atom = self.atom(at, known)
        return ALWAYS_TRUE if atom is None else Literal(atom, positive)

    def _compared(self, at: Group, known: Variables, positive: bool) -> Condition:
        relation = at.head if positive else RELATION_NEGATIONS[at.head]
        return self.numbers.comparison(at, relation, lambda group: self.function(group, known))

    def _quantified(self, at: Group, known: Variables, positive: bool) -> Condition:
        listed = at.rest[0]
        assert isinstance(listed, Group)
        own = self.scope.parameters(self.document, listed.parts, known)
        inner = self.condition(at.rest[1], {**known, **own}, positive)
        if not own:
            return inner
        return (Exists if (at.head == "exists") == positive else ForAll)(tuple(own.values()), inner)

    def _equality(self, at: Group, known: Variables, positive: bool) -> Condition:
        """Two numbers are equal, or two objects are the same one."""
        if any(self._is_number(part) for part in at.rest):
            return self._compared(at, known, positive)
        if len(at.rest) != 2:
            self.document.add(at, "K102", "'=' compares two objects, or two numbers")
            return ALWAYS_TRUE
        left, right = (self.term(part, OBJECT_TYPE, known) for part in at.rest)
        return Comparison(left, "=" if positive else "!=", right)

    def _is_number(self, at: Expression) -> bool:
        if isinstance(at, PddlWord):
            return written_number(at) is not None or at.text in self.scope.functions
        return at.head in ARITHMETIC_SIGNS or at.head in self.scope.functions

    def function(self, at: Group, known: Variables) -> Function:
        """A numeric function with its arguments. Raises `Unreadable`."""
        signature = self.scope.functions.get(at.head)
        if signature is None:
            near = nearest_hint(at.head, list(self.scope.functions))
            raise Unreadable(at, f"there is no function '{at.head}'{f' ({near})' if near else ''}")
        if len(at.rest) != len(signature):
            raise Unreadable(at, f"{at.head} takes {len(signature)} arguments, not {len(at.rest)}")
        arguments = (
            self.term(part, type_, known) for part, type_ in zip(at.rest, signature, strict=True)
        )
        if not all(map(self._is_within, at.rest, signature, itertools.repeat(known))):
            self.numbers.functions.widen(at.head)
        return Function(self.scope.names.of("function", at.head), tuple(arguments))

    def _is_within(self, at: Expression, type_: str, known: Variables) -> bool:
        """Whether a variable has values of a type only; an object is tested elsewhere."""
        parameter = known.get(at.text) if isinstance(at, PddlWord) else None
        return parameter is None or self.scope.is_subtype(parameter.type, type_)

    def _unsupported(
        self,
        at: Expression,
        what: str,
        hint: str = "no times, preferences, constraints and object fluents are read",
    ) -> None:
        self.document.add(at, "K802", f"{what} are not supported", hint)

    def atom(self, at: Group, known: Variables) -> Atom | None:
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
            self.term(part, type_, known) for part, type_ in zip(at.rest, signature, strict=True)
        )
        return Function(self.scope.names.of("predicate", at.head), tuple(arguments))

    def _unknown(self, at: Group) -> None:
        if not at.head:
            hint = "write (and ...) around several of them"
            self.document.add(at, "K801", "a name is missing after this parenthesis", hint)
        elif at.head in self.scope.functions:
            self.document.add(
                at, "K103", f"'{at.head}' is a number, not a condition", "compare it: (>= (...) 1)"
            )
        elif at.head in TEMPORAL_WORDS:
            self._unsupported(at, "temporal conditions, preferences and timed literals")
        elif at.head in UNCERTAIN_WORDS:
            hint = "what is true at the start, and what an action does, is known"
            self._unsupported(at, f"facts and effects with '{at.head}'", hint)
        else:
            near = nearest_hint(at.head, list(self.scope.predicates))
            self.document.add(at, "K101", f"unknown predicate '{at.head}'", near)

    def term(self, at: Expression, expected: str, known: Variables) -> Term:
        """A variable in scope or an object.

        A type that surely differs from the expected one is reported.
        """
        if isinstance(at, Group):
            self._unsupported(at, "object fluents")
            return Function("unreadable")
        if at.text.startswith("?"):
            parameter = known.get(at.text)
            if parameter is None:
                self.document.add(at, "K105", f"variable {at.text} is not declared here")
                return self.scope.names.variable(at.text)
            if not self.scope.overlaps(parameter.type, expected):
                self._mismatch(at, parameter.type, expected)
            return parameter.variable
        if at.text not in self.scope.objects:
            near = nearest_hint(at.text, list(self.scope.objects))
            self.document.add(at, "K101", f"unknown object '{at.text}'", near)
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
        known: Variables,
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
            case "and":
                for part in at.rest:
                    yield from self.effects(part, known, local, when)
            case "" if not at.parts:
                return
            case "forall" if len(at.rest) == 2 and isinstance(at.rest[0], Group):
                own = self.scope.parameters(self.document, at.rest[0].parts, known)
                inner = (*local, *own.values())
                yield from self.effects(at.rest[1], {**known, **own}, inner, when)
            case "when" if len(at.rest) == 2:
                condition = self.condition(at.rest[0], known)
                yield from self.effects(at.rest[1], known, local, And((when, condition)))
            case head if head in CHANGE_WORDS:
                self._known(at)
            case _:
                yield from self._effect(at, known, local, when)

    def _effect(
        self, at: Group, known: Variables, local: tuple[Parameter, ...], when: Condition
    ) -> Iterator[Effect]:
        inner = at.rest[0] if at.head == "not" and len(at.rest) == 1 else at
        atom = self.atom(inner, known) if isinstance(inner, Group) else None
        if atom is None and isinstance(inner, PddlWord):
            self.document.add(
                inner, "K801", f"'{inner.text}' is not an effect", "write (not (predicate ...))"
            )
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
