"""Prepared operators: preconditions and effects as functions over one list of terms, made once.

What is no conjunction of literals and comparisons is evaluated as `datalog` does it, which is the
meaning of all of it.
"""

from collections.abc import Callable, Iterable
from typing import NamedTuple

from cellwright.engine.stages.validation.checker_facts import CheckerFacts
from cellwright.engine.stages.validation.condition_solving import (
    OrderedCondition,
    bind_parameters,
    condition_holds,
    order_condition,
)
from cellwright.engine.stages.validation.prepared_conditions import (
    Link,
    Next,
    Slots,
    SlotScope,
    Test,
    Unprepared,
    comparison_test,
    lookup_link,
    value_function,
)
from cellwright.engine.stages.validation.step_changes import Fired, has_unconditional_effects
from cellwright.kb.model.conditions import (
    ALWAYS_TRUE,
    BodyPart,
    Comparison,
    Condition,
    Exists,
    Literal,
    Parameter,
    goal_parts,
)
from cellwright.kb.model.domain_model import Effect, Operator
from cellwright.kb.terms import ANYTHING, Term, Variable, substitute_atom

Holds = Callable[[CheckerFacts, Slots], bool]
Fires = Callable[[CheckerFacts, Slots], object]


class PreparedConjunct(NamedTuple):
    """A conjunct of a precondition, and the function that tells whether it holds."""

    condition: Condition
    holds: Holds


class PreparedOperator:
    """An operator whose parameters are the first places of a list of terms."""

    def __init__(self, operator: Operator) -> None:
        self.operator = operator
        self._scope = SlotScope(operator.variables)
        self.unconditional = has_unconditional_effects(operator)
        self.needs = tuple(self._part(conjunct) for conjunct in goal_parts(operator.precondition))
        self._found = self._scope.empty()
        self._effects = tuple(map(self._effect, operator.effects))

    def unmet(self, facts: CheckerFacts, values: Iterable[Term]) -> Condition | None:
        """The first conjunct of the precondition that does not hold; None if all hold."""
        if not self.needs:
            return None
        slots = self._scope.slots(values)
        return next((need.condition for need in self.needs if not need.holds(facts, slots)), None)

    def fired(self, facts: CheckerFacts, values: Iterable[Term]) -> list[Fired]:
        """The atoms that effects name in a state, in their order."""
        slots = self._scope.slots(values)
        fired_effects = slots[self._found] = list[Fired]()
        for effect in self._effects:
            effect(facts, slots)
        return fired_effects

    def _part(self, condition: Condition) -> PreparedConjunct:
        scope = self._scope.inner()
        try:
            return PreparedConjunct(condition, _conjunct_test(condition, scope))
        except Unprepared:
            bindings_of = self._scope.bindings
            return PreparedConjunct(
                condition,
                lambda facts, slots: condition_holds(condition, facts, bindings_of(slots)),
            )

    def _effect(self, effect: Effect) -> Fires:
        once = bool(effect.parameters) or effect.condition != ALWAYS_TRUE
        scope = self._scope.inner()
        try:
            chain = (
                _condition_link(effect.parameters, effect.condition, scope) if once else _to_next
            )
        except Unprepared:
            return self._plain(effect)
        atom_of, adds, fired_place = scope.atom(effect.atom), effect.adds, self._found

        def note(_: CheckerFacts, slots: Slots) -> bool:
            slots[fired_place].append((atom_of(slots), adds, once))
            return False

        return chain(note)

    def _plain(self, effect: Effect) -> Fires:
        bindings_of, fired_place = self._scope.bindings, self._found

        def fire(facts: CheckerFacts, slots: Slots) -> None:
            ways = bind_parameters(effect.parameters, effect.condition, facts, bindings_of(slots))
            slots[fired_place].extend(
                (substitute_atom(effect.atom, way), effect.adds, True) for way in ways
            )

        return fire


def _stop_search(_: CheckerFacts, __: Slots) -> bool:
    return True


def _to_next(go_on: Next) -> Next:
    return go_on


def _conjunct_test(condition: Condition, scope: SlotScope) -> Holds:
    """Whether a conjunct holds."""
    match condition:
        case Literal(atom, positive) if scope.knows(atom):
            atom_of = scope.atom(atom)
            return lambda facts, slots: (atom_of(slots) in facts) is positive
        case Comparison(left, _, right) if scope.knows(left) and scope.knows(right):
            return _of_values(comparison_test(condition, scope.places))
        case Exists(parameters, part) if parameters:
            return _condition_link(parameters, part, scope)(_stop_search)
        case _:
            raise Unprepared


def _of_values(test: Test) -> Holds:
    return lambda _, slots: test(slots)


def _condition_link(
    parameters: tuple[Parameter, ...], condition: Condition, scope: SlotScope
) -> Link:
    """A function that meets a condition in every way. Raises `Unprepared`."""
    if not parameters:
        parts = [_conjunct_test(conjunct, scope.inner()) for conjunct in goal_parts(condition)]
        return lambda go_on: (
            lambda facts, slots: all(test(facts, slots) for test in parts) and go_on(facts, slots)
        )
    ordered = order_condition(parameters, condition, scope.parameters)
    if ordered is None:
        raise Unprepared
    links = [*(_part_link(part, scope) for part in ordered.body), *_type_tests(ordered, scope)]

    def to(go_on: Next) -> Next:
        for link in reversed(links):
            go_on = link(go_on)
        return go_on

    return to


def _part_link(part: BodyPart, scope: SlotScope) -> Link:
    match part:
        case Literal(atom, True):
            return (
                _test_link(_conjunct_test(part, scope))
                if scope.knows(atom)
                else lookup_link(atom, scope)
            )
        case Comparison(left, relation, right):
            if scope.knows(left) and scope.knows(right):
                return _test_link(_conjunct_test(part, scope))
            pattern, value = (left, right) if scope.knows(right) else (right, left)
            if (
                relation == "="
                and isinstance(pattern, Variable)
                and pattern != ANYTHING
                and scope.knows(value)
            ):
                value_of = value_function(value, dict(scope.places), part.exact)
                return _compute_link(scope.place(pattern), value_of)
    raise Unprepared


def _type_tests(ordered: OrderedCondition, scope: SlotScope) -> list[Link]:
    """Tests of the types of values that facts gave."""
    own = [
        (scope.places[parameter.variable], parameter.type)
        for parameter in ordered.typed
        if parameter.variable in scope.places
    ]

    def test(facts: CheckerFacts, slots: Slots) -> bool:
        return all(facts.has_type(slots[place], type_) for place, type_ in own)

    return [_test_link(test)] if own else []


def _test_link(test: Holds) -> Link:
    return lambda go_on: lambda facts, slots: test(facts, slots) and go_on(facts, slots)


def _compute_link(place: int, value: Callable[[Slots], Term | None]) -> Link:
    def link(go_on: Next) -> Next:
        def step(facts: CheckerFacts, slots: Slots) -> bool:
            term = value(slots)
            if term is None:
                return False
            slots[place] = term
            return go_on(facts, slots)

        return step

    return link
