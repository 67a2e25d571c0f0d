"""Reads the problem file of a PDDL task with times: objects, facts, values, timed literals, goal,
metric.
"""

from fractions import Fraction

from cellwright.engine.formats.interop.pddl.durative.actions import (
    ActionReader,
    TimedReader,
    objects_with_types,
)
from cellwright.engine.formats.interop.pddl.expressions import Document, Expression, Group, PddlWord
from cellwright.engine.formats.interop.pddl.keywords import check_sections
from cellwright.engine.formats.interop.pddl.numeric_functions import (
    CHANGE_WORDS,
    Unreadable,
    function_of,
    written_number,
)
from cellwright.kb.diagnostics import Diagnostic
from cellwright.kb.model.conditions import ALWAYS_TRUE, Condition, Literal
from cellwright.kb.model.durative import NumericChange, TemporalProblem, TimedChange, rational
from cellwright.kb.terms import Atom, Function


def is_timed_fact(part: Expression) -> bool:
    """Whether a part of `:init` says what becomes true or false later."""
    if not isinstance(part, Group) or part.head != "at" or len(part.parts) != 3:
        return False
    return written_number(part.parts[1]) is not None and isinstance(part.parts[2], Group)


class ProblemReader:
    """Reads the problem file, once the declarations of the domain are read."""

    def __init__(self, document: Document, domain: ActionReader) -> None:
        self.document, self.domain, self.scope = document, domain, domain.scope
        self.reader = TimedReader(document, self.scope, domain.definitions)
        self.sections = {part.head: part for part in document.root.rest if isinstance(part, Group)}
        self.initial: list[Atom] = []
        self.values: dict[Function, Fraction] = {}
        self.changes: list[TimedChange] = []
        self.warnings: list[Diagnostic] = []

    def read(self) -> TemporalProblem:
        """The problem. Objects come before the actions, which may only name constants."""
        check_sections(self.document, "problem")
        if ":objects" in self.sections:
            self.domain.declare_objects(self.document, self.sections[":objects"].rest, {})
        everything, self.scope.objects = self.scope.objects, dict(self.domain.constants)
        actions = self.domain.actions()
        self.scope.objects = everything
        for part in self.sections[":init"].rest if ":init" in self.sections else ():
            self._initial(part)
        goal = self._goal()
        self._metric()
        return TemporalProblem(
            self._name(),
            objects_with_types(self.scope),
            actions,
            frozenset(self.initial),
            self.values,
            tuple(sorted(self.changes, key=lambda change: change.at)),
            goal,
            where=self.document.where(self.document.root),
        )

    def _name(self) -> str:
        group = self.sections.get("problem")
        word = group.rest[0] if group and group.rest else None
        return word.text if isinstance(word, PddlWord) else "problem"

    def _goal(self) -> Condition:
        group = self.sections.get(":goal")
        if group is None or len(group.rest) != 1:
            at = group or self.document.root
            self.document.add(at, "K801", "a problem has one goal", "write (:goal (and ...))")
            return ALWAYS_TRUE
        return self.reader.condition(group.rest[0], {})

    def _initial(self, part: Expression) -> None:
        """A true fact, a value or a timed change.

        Negated facts are skipped: in a closed world they say nothing new.
        """
        if isinstance(part, PddlWord):
            said = f"'{part.text}' is not a fact"
            self.document.add(part, "K801", said, "write facts in parentheses")
        elif part.head == "not" and len(part.rest) == 1:
            return
        elif is_timed_fact(part):
            self._timed(part)
        elif part.head == "=":
            change = self._value(part)
            if change is not None:
                self.values[change[0]] = change[1]
        elif part.head in self.domain.definitions.axioms:
            said = f"'{part.head}' is derived: no fact can say that it is true"
            self.document.add(part, "K103", said, "say what it follows from")
        elif (atom := self.reader.atom(part, {})) is not None:
            self.initial.append(atom)

    def _value(self, part: Group) -> tuple[Function, Fraction] | None:
        function, value = (
            (function_of(part.rest[0]), written_number(part.rest[1]))
            if len(part.rest) == 2
            else (None, None)
        )
        if function is None or value is None:
            hint = "a number is whole or decimal, with at most 12 decimals: (= (fuel truck) 20.5)"
            self.document.add(part, "K802", "this initial value is not supported", hint)
            return None
        if function.head == "total-cost" and "total-cost" not in self.scope.functions:
            return None
        try:
            return self.reader.function(function, {}), value
        except Unreadable as wrong:
            self.document.add(part, "K101", wrong.why)
            return None

    def _timed(self, part: Group) -> None:
        at, inner = written_number(part.parts[1]), part.parts[2]
        assert at is not None
        assert isinstance(inner, Group)
        where = self.document.where(part)
        if at <= 0:
            self.document.add(
                part, "K802", "a timed literal is after time 0", "write it without (at ...)"
            )
        if inner.head == "=":
            value = self._value(inner)
            if value is not None:
                self.changes.append(
                    TimedChange(at, NumericChange("assign", value[0], rational(value[1])), where)
                )
            return
        if inner.head in CHANGE_WORDS:
            numeric = self.reader.numeric_change(inner, {})
            self.changes += [TimedChange(at, numeric, where)] if numeric is not None else []
            return
        literal = self.reader.effect_literal(inner, {})
        if literal is not None:
            self.changes.append(TimedChange(at, Literal(literal.atom, literal.positive), where))

    def _metric(self) -> None:
        """Whether the metric is the total time, which plans have little of; others are told not
        to be followed.
        """
        group = self.sections.get(":metric")
        if group is None or [_text(part) for part in group.rest] in (["minimize", "total-time"],):
            return
        message = "the metric is not followed: plans with times have a small makespan"
        where = self.document.where(group)
        self.warnings.append(
            Diagnostic(where, "K802", message, "total-time is what is minimised", True)
        )


def _text(part: Expression) -> str:
    """A word, or a group of one word, as text."""
    if isinstance(part, PddlWord):
        return part.text
    return part.head if len(part.parts) == 1 else ""
