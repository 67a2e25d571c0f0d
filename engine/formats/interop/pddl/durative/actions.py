"""Reads the domain file of a PDDL task with times: declarations and durative actions."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from cellwright.engine.formats.interop.pddl.declared_names import PddlScope, Variables
from cellwright.engine.formats.interop.pddl.domain_reader import DomainReader
from cellwright.engine.formats.interop.pddl.durative.definitions import (
    DerivedDefinitions,
    replace_variables,
)
from cellwright.engine.formats.interop.pddl.durative.numbers import ExactNumbers
from cellwright.engine.formats.interop.pddl.expressions import Document, Expression, Group, PddlWord
from cellwright.engine.formats.interop.pddl.keywords import TIMED_DOMAIN
from cellwright.engine.formats.interop.pddl.numeric_functions import (
    CHANGE_WORDS,
    Unreadable,
    function_of,
)
from cellwright.engine.formats.interop.pddl.pddl_conditions import ConditionReader
from cellwright.kb.model.conditions import (
    ALWAYS_TRUE,
    And,
    Condition,
    ForAll,
    Literal,
    Or,
    Parameter,
)
from cellwright.kb.model.durative import (
    DurationLimit,
    DurativeAction,
    Moment,
    NumericChange,
    TimedCondition,
    TimedEffect,
)
from cellwright.kb.terms import Term

MOMENTS = {
    ("at", "start"): Moment.START,
    ("over", "all"): Moment.THROUGHOUT,
    ("at", "end"): Moment.END,
}
When = tuple[TimedCondition, ...]
Local = tuple[Parameter, ...]


class TimedReader(ConditionReader):
    """Reads conditions and effects with their moments in one document."""

    def __init__(
        self, document: Document, scope: PddlScope, definitions: DerivedDefinitions
    ) -> None:
        super().__init__(document, scope)
        self.exact = ExactNumbers(document, scope.names)
        self.numbers = self.exact
        self.definitions = definitions

    def _simple(self, at: Group, known: Variables, positive: bool) -> Condition:
        """A comparison, a literal, or what a derived predicate is defined by."""
        axioms = self.definitions.axioms.get(at.head)
        atom = self.atom(at, known) if axioms is not None else None
        if axioms is None or atom is None:
            return super()._simple(at, known, positive)
        if at.head in self.definitions.under_way:
            said = f"'{at.head}' depends on itself: that is not supported with times"
            self.document.add(at, "K802", said)
            return ALWAYS_TRUE
        parts = [self.defined(axiom, known, positive, atom.arguments) for axiom in axioms]
        if len(parts) == 1:
            return parts[0]
        return (Or if positive else And)(tuple(parts))

    def defined(
        self, axiom: Group, known: Variables, positive: bool, arguments: Sequence[Term] = ()
    ) -> Condition:
        """The condition of an axiom, or the opposite of it, for some arguments."""
        head = axiom.rest[0]
        assert isinstance(head, Group)
        own = self.definitions.parameters(axiom, known)
        self.definitions.under_way.append(head.head)
        condition = self.condition(axiom.rest[1], {**known, **own}, positive)
        self.definitions.under_way.pop()
        variables = (parameter.variable for parameter in own.values())
        return replace_variables(condition, dict(zip(variables, arguments, strict=False)))

    def timed_conditions(self, at: Expression, known: Variables) -> Iterator[TimedCondition]:
        """The conditions of a durative action, each with its moment."""
        if isinstance(at, Group) and not at.parts:
            return
        if isinstance(at, Group) and at.head == "and":
            for part in at.rest:
                yield from self.timed_conditions(part, known)
        elif isinstance(at, Group) and at.head == "forall" and len(at.rest) == 2:
            yield from self._for_all(at, known)
        elif (split := self._moment(at)) is not None:
            moment, inner = split
            yield TimedCondition(moment, self.condition(inner, known), self.document.where(at))

    def _for_all(self, at: Group, known: Variables) -> Iterator[TimedCondition]:
        """A universal condition around moments: the moments are moved outside."""
        listed = at.rest[0] if isinstance(at.rest[0], Group) else Group((), at.offset)
        own = self.scope.parameters(self.document, listed.parts, known)
        for part in self.timed_conditions(at.rest[1], {**known, **own}):
            yield replace(part, condition=ForAll(tuple(own.values()), part.condition))

    def _moment(self, at: Expression) -> tuple[Moment, Expression] | None:
        """The moment of a timed part and what stands in it; None, and a finding, for what has
        no moment.
        """
        if isinstance(at, Group) and len(at.parts) == 3 and isinstance(at.parts[1], PddlWord):
            moment = MOMENTS.get((at.head, at.parts[1].text))
            if moment is not None:
                return moment, at.parts[2]
        if isinstance(at, Group) and at.head == "preference":
            self.document.add(at, "K802", "preferences are not supported", "leave them out")
            return None
        hint = "write (at start ...), (over all ...) or (at end ...)"
        self.document.add(at, "K801", "a part of a durative action has a moment", hint)
        return None

    def timed_effects(
        self, at: Expression, known: Variables, local: Local = (), when: When = ()
    ) -> Iterator[TimedEffect]:
        """The effects of a durative action, each with its moment."""
        match at:
            case Group(()):
                return
            case Group() if at.head == "and":
                for part in at.rest:
                    yield from self.timed_effects(part, known, local, when)
            case Group() if (
                at.head == "forall" and len(at.rest) == 2 and isinstance(at.rest[0], Group)
            ):
                own = self.scope.parameters(self.document, at.rest[0].parts, known)
                inner = {**known, **own}
                yield from self.timed_effects(at.rest[1], inner, (*local, *own.values()), when)
            case Group() if at.head == "when" and len(at.rest) == 2:
                conditions = tuple(self.timed_conditions(at.rest[0], known))
                yield from self.timed_effects(at.rest[1], known, local, (*when, *conditions))
            case Group() if at.head in ("increase", "decrease"):
                self.document.add(
                    at, "K802", "an effect that changes continuously is not supported", "at end"
                )
            case _:
                yield from self._at_moment(at, known, local, when)

    def _at_moment(
        self, at: Expression, known: Variables, local: Local, when: When
    ) -> Iterator[TimedEffect]:
        split = self._moment(at)
        if split is None:
            return
        moment, inner = split
        if moment is Moment.THROUGHOUT:
            self.document.add(at, "K801", "an effect happens at start or at end")
            return
        yield from self.instant_effects(inner, known, moment, local, when)

    def instant_effects(
        self, at: Expression, known: Variables, moment: Moment, local: Local = (), when: When = ()
    ) -> Iterator[TimedEffect]:
        """The effects inside a moment, or of an action without times."""
        match at:
            case Group() if at.head in ("and", ""):
                for part in at.rest:
                    yield from self.instant_effects(part, known, moment, local, when)
            case Group() if (
                at.head == "forall" and len(at.rest) == 2 and isinstance(at.rest[0], Group)
            ):
                own = self.scope.parameters(self.document, at.rest[0].parts, known)
                inner = {**known, **own}
                yield from self.instant_effects(
                    at.rest[1], inner, moment, (*local, *own.values()), when
                )
            case Group() if at.head == "when" and len(at.rest) == 2:
                condition = TimedCondition(
                    moment, self.condition(at.rest[0], known), self.document.where(at)
                )
                yield from self.instant_effects(
                    at.rest[1], known, moment, local, (*when, condition)
                )
            case Group() if at.head in CHANGE_WORDS:
                change = self.numeric_change(at, known)
                if change is not None:
                    yield TimedEffect(moment, change, local, when)
            case _:
                literal = self.effect_literal(at, known)
                if literal is not None:
                    yield TimedEffect(moment, literal, local, when)

    def effect_literal(self, at: Expression, known: Variables) -> Literal | None:
        """The atom that an effect adds or deletes; None, and a finding, for what is none."""
        if isinstance(at, PddlWord):
            self.document.add(
                at, "K801", f"'{at.text}' is not an effect", "write effects in parentheses"
            )
            return None
        negated = at.head == "not" and len(at.rest) == 1
        inner = at.rest[0] if negated else at
        if isinstance(inner, Group) and inner.head in self.definitions.axioms:
            said = f"'{inner.head}' is derived: no effect can change it"
            self.document.add(at, "K103", said, "change what it follows from")
        atom = self.atom(inner, known) if isinstance(inner, Group) else None
        return None if atom is None else Literal(atom, not negated)

    def numeric_change(self, at: Group, known: Variables) -> NumericChange | None:
        """The change of a number; None, and a finding, for what is none."""
        changed = function_of(at.rest[0]) if len(at.rest) == 2 else None
        if changed is None or changed.head not in self.scope.functions:
            hint = "write (increase (f ?x) 1)"
            self.document.add(at, "K801", f"'{at.head}' changes a function by an amount", hint)
            return None
        try:
            fluent = self.function(changed, known)
        except Unreadable as wrong:
            self.document.add(wrong.at, "K101", wrong.why)
            return None
        amount = self.exact.amount(at.rest[1], lambda group: self.function(group, known))
        return NumericChange(at.head, fluent, amount)

    def limits(self, at: Expression | None, known: Variables) -> Iterator[DurationLimit]:
        """What is said about the length of a durative action."""
        if at is None or (isinstance(at, Group) and not at.parts):
            return
        if isinstance(at, Group) and at.head == "and":
            for part in at.rest:
                yield from self.limits(part, known)
        elif isinstance(at, Group) and at.head == "at":
            split = self._moment(at)
            moment, inner = split or (Moment.START, Group((), at.offset))
            for limit in self.limits(inner, known):
                yield replace(limit, moment=moment)
        elif isinstance(at, Group) and at.head in ("=", "<=", ">=") and _names_duration(at):
            amount = self.exact.amount(at.rest[1], lambda group: self.function(group, known))
            yield DurationLimit(at.head, amount)
        else:
            hint = "write (= ?duration 5), or (and (>= ?duration 5) (<= ?duration 9))"
            self.document.add(at, "K801", "a duration is compared with a number", hint)


def _names_duration(at: Group) -> bool:
    first = at.rest[0] if len(at.rest) == 2 else None
    return isinstance(first, PddlWord) and first.text == "?duration"


class ActionReader(DomainReader):
    """Reads a domain with durative actions: declarations, then actions."""

    kind = TIMED_DOMAIN

    def __init__(self, document: Document) -> None:
        super().__init__(document)
        self.definitions = DerivedDefinitions(document, self.scope)
        self.timed = TimedReader(document, self.scope, self.definitions)

    def actions(self) -> tuple[DurativeAction, ...]:
        """The actions of the domain, with and without duration, once the objects of the problem
        are known.
        """
        self.definitions.collect(self._all(":derived"))
        for axioms in list(self.definitions.axioms.values()):
            for axiom in axioms:  # what is wrong in it is told here, at its place
                self.timed.defined(axiom, {}, True)
        return tuple(
            self._durative(group)
            if group.head == ":durative-action"
            else self._instantaneous(group)
            for group in self.groups
            if group.head in (":action", ":durative-action")
        )

    def _head(self, group: Group) -> tuple[str, dict[str, Parameter]]:
        word = group.rest[0] if group.rest else group
        if not isinstance(word, PddlWord):
            self.document.add(group, "K801", "an action needs a name")
        name = word.text if isinstance(word, PddlWord) else "action"
        listed = group.field(":parameters")
        parameters = self.scope.parameters(
            self.document, listed.parts if isinstance(listed, Group) else ()
        )
        return self.scope.names.of("operator", name), parameters

    def _durative(self, group: Group) -> DurativeAction:
        name, known = self._head(group)
        parameters = tuple(known.values())
        condition, effect = group.field(":condition"), group.field(":effect")
        limits = tuple(self.timed.limits(group.field(":duration"), known))
        conditions = (
            tuple(self.timed.timed_conditions(condition, known)) if condition is not None else ()
        )
        effects = tuple(self.timed.timed_effects(effect, known)) if effect is not None else ()
        where = self.document.where(group)
        return DurativeAction(name, parameters, limits, conditions, effects, where=where)

    def _instantaneous(self, group: Group) -> DurativeAction:
        name, known = self._head(group)
        parameters = tuple(known.values())
        needed, effect = group.field(":precondition"), group.field(":effect")
        conditions: tuple[TimedCondition, ...] = ()
        if needed is not None:
            read = self.timed.condition(needed, known)
            conditions = (TimedCondition(Moment.START, read, self.document.where(needed)),)
        effects = (
            tuple(self.timed.instant_effects(effect, known, Moment.START))
            if effect is not None
            else ()
        )
        where = self.document.where(group)
        return DurativeAction(name, parameters, (), conditions, effects, True, where)


def objects_with_types(scope: PddlScope) -> dict[str, frozenset[str]]:
    """All types of each object, with all that is above them, by the names of the model."""
    known = ["object", *scope.types]
    return {
        scope.names.of("object", name): frozenset(
            each for each in known if scope.is_subtype(type_, each)
        )
        for name, type_ in scope.objects.items()
    }


__all__ = ["ActionReader", "TimedReader", "objects_with_types"]
