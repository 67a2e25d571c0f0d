"""Preconditions and effects of operators as functions that are made once, over one list of terms for the values of variables.

What is no conjunction of literals and comparisons is evaluated as `datalog` does it, which is the meaning of all of it.
"""

from collections.abc import Callable, Iterable
from typing import NamedTuple

from cellwright.engine.stages.validation.datalog import Arranged, arranged, bound, holds
from cellwright.engine.stages.validation.facts import Facts
from cellwright.engine.stages.validation.instances import Fired, unconditional
from cellwright.engine.stages.validation.lookups import Link, Next, Unprepared, looked_up
from cellwright.engine.stages.validation.scope import Scope
from cellwright.engine.stages.validation.sums import Slots, Test, compared, valued
from cellwright.kb.model.conditions import (
    TRUE,
    BodyPart,
    Comparison,
    Condition,
    Exists,
    Literal,
    Parameter,
    goal_parts,
)
from cellwright.kb.model.domain import Effect, Operator
from cellwright.kb.terms import ANYTHING, Term, Variable, substitute_atom

Holds = Callable[[Facts, Slots], bool]
Fires = Callable[[Facts, Slots], object]


class Part(NamedTuple):
    """A conjunct of a precondition, and the function that tells whether it holds."""

    condition: Condition
    holds: Holds


class Prepared:
    """An operator whose parameters are the first places of a list of terms."""

    def __init__(self, operator: Operator) -> None:
        self.operator = operator
        self._scope = Scope(operator.variables)
        self.unconditional = unconditional(operator)
        self.needs = tuple(self._part(each) for each in goal_parts(operator.precondition))
        self._found = self._scope.empty()
        self._effects = tuple(map(self._effect, operator.effects))

    def unmet(self, facts: Facts, values: Iterable[Term]) -> Condition | None:
        """The first conjunct of the precondition that does not hold; None if all hold."""
        if not self.needs:
            return None
        slots = self._scope.slots(values)
        return next((each.condition for each in self.needs if not each.holds(facts, slots)), None)

    def fired(self, facts: Facts, values: Iterable[Term]) -> list[Fired]:
        """The atoms that effects name in a state, in their order."""
        slots = self._scope.slots(values)
        found = slots[self._found] = list[Fired]()
        for each in self._effects:
            each(facts, slots)
        return found

    def _part(self, condition: Condition) -> Part:
        scope = self._scope.inner()
        try:
            return Part(condition, _test(condition, scope))
        except Unprepared:
            known = self._scope.bindings
            return Part(condition, lambda facts, slots: holds(condition, facts, known(slots)))

    def _effect(self, effect: Effect) -> Fires:
        once = bool(effect.parameters) or effect.condition != TRUE
        scope = self._scope.inner()
        try:
            chain = _chain(effect.parameters, effect.condition, scope) if once else _to_next
        except Unprepared:
            return self._plain(effect)
        made, adds, found = scope.atom(effect.atom), effect.adds, self._found

        def note(_: Facts, slots: Slots) -> bool:
            slots[found].append((made(slots), adds, once))
            return False

        return chain(note)

    def _plain(self, effect: Effect) -> Fires:
        known, found = self._scope.bindings, self._found

        def fire(facts: Facts, slots: Slots) -> None:
            ways = bound(effect.parameters, effect.condition, facts, known(slots))
            slots[found].extend((substitute_atom(effect.atom, each), effect.adds, True) for each in ways)

        return fire


def _stop(_: Facts, __: Slots) -> bool:
    return True


def _to_next(go_on: Next) -> Next:
    return go_on


def _test(condition: Condition, scope: Scope) -> Holds:
    """Whether a conjunct holds."""
    match condition:
        case Literal(atom, positive) if scope.knows(atom):
            made = scope.atom(atom)
            return lambda facts, slots: (made(slots) in facts) is positive
        case Comparison(left, _, right) if scope.knows(left) and scope.knows(right):
            return _of_values(compared(condition, scope.places))
        case Exists(parameters, part) if parameters:
            return _chain(parameters, part, scope)(_stop)
        case _:
            raise Unprepared


def _of_values(test: Test) -> Holds:
    return lambda _, slots: test(slots)


def _chain(parameters: tuple[Parameter, ...], condition: Condition, scope: Scope) -> Link:
    """A function that meets a condition in every way. Raises `Unprepared`."""
    if not parameters:
        parts = [_test(each, scope.inner()) for each in goal_parts(condition)]
        return lambda go_on: (
            lambda facts, slots: all(each(facts, slots) for each in parts) and go_on(facts, slots)
        )
    found = arranged(parameters, condition, scope.parameters)
    if found is None:
        raise Unprepared
    links = [*(_link(part, scope) for part in found.body), *_typed(found, scope)]

    def to(go_on: Next) -> Next:
        for link in reversed(links):
            go_on = link(go_on)
        return go_on

    return to


def _link(part: BodyPart, scope: Scope) -> Link:
    match part:
        case Literal(atom, True):
            return _tested(_test(part, scope)) if scope.knows(atom) else looked_up(atom, scope)
        case Comparison(left, relation, right):
            if scope.knows(left) and scope.knows(right):
                return _tested(_test(part, scope))
            pattern, value = (left, right) if scope.knows(right) else (right, left)
            if (
                relation == "="
                and isinstance(pattern, Variable)
                and pattern != ANYTHING
                and scope.knows(value)
            ):
                found = valued(value, dict(scope.places), part.exact)
                return _computed(scope.place(pattern), found)
    raise Unprepared


def _typed(found: Arranged, scope: Scope) -> list[Link]:
    """Tests of the types of values that facts gave."""
    own = [(scope.places[each.variable], each.type) for each in found.typed if each.variable in scope.places]

    def test(facts: Facts, slots: Slots) -> bool:
        return all(facts.has_type(slots[place], type_) for place, type_ in own)

    return [_tested(test)] if own else []


def _tested(test: Holds) -> Link:
    return lambda go_on: lambda facts, slots: test(facts, slots) and go_on(facts, slots)


def _computed(place: int, value: Callable[[Slots], Term | None]) -> Link:
    def link(go_on: Next) -> Next:
        def step(facts: Facts, slots: Slots) -> bool:
            found = value(slots)
            if found is None:
                return False
            slots[place] = found
            return go_on(facts, slots)

        return step

    return link
