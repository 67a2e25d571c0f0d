"""Prepared conditions: functions over one list of terms that compute sums and look facts up.

Its values are those of `cellwright.kb.arithmetic`. What is no sum of numbers is left to it.
"""

import operator
import operator as plain
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from cellwright.engine.stages.validation.checker_facts import CheckerFacts
from cellwright.kb.arithmetic import CLINGO_BITS, compare_terms, evaluate_term
from cellwright.kb.model.conditions import Comparison
from cellwright.kb.terms import (
    ANYTHING,
    Atom,
    Function,
    Number,
    Operation,
    Term,
    Variable,
    is_ground,
    substitute_term,
    term_variables,
)

Slots = list[Any]  # terms, and what is known of them
Places = Mapping[Term, int]
Value = Callable[[Slots], Term | None]
Test = Callable[[Slots], bool]
Weights = dict[int, int]

RELATION_FUNCTIONS: Mapping[str, Callable[[int, int], bool]] = {
    "=": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}


def term_writer(term: Term, places: Places) -> Value:
    """The function that writes a term with the values of its variables; those without a place
    stay.
    """
    if term in places:
        return operator.itemgetter(places[term])
    variable_places = tuple(
        (term_key, place) for term_key, place in places.items() if isinstance(term_key, Variable)
    )
    return lambda slots: substitute_term(
        term, {variable: slots[place] for variable, place in variable_places}
    )


def value_function(term: Term, places: Places, exact: bool) -> Value:
    """The function that gives the value of a term, all of whose variables have places; None if
    it has no value.
    """
    plain, sum_ = term_writer(term, places), number_function(term, places, exact)

    def value(slots: Slots) -> Term | None:
        total = sum_(slots)
        if total is not None:
            return Number(total)
        own = plain(slots)
        return None if own is None else evaluate_term(own, exact)

    return value


def comparison_test(part: Comparison, places: Places) -> Test:
    """The test of a comparison, all of whose variables have places."""
    (left, right), exact = (part.left, part.right), part.exact
    left_number, right_number = (number_function(side, places, exact) for side in (left, right))
    writers = tuple(term_writer(side, places) for side in (left, right))
    relation, related = part.relation, RELATION_FUNCTIONS[part.relation]

    def test(slots: Slots) -> bool:
        low, high = left_number(slots), right_number(slots)
        if low is not None and high is not None:
            return related(low, high)
        first, second = (writer(slots) for writer in writers)
        return (
            first is not None
            and second is not None
            and compare_terms(first, relation, second, exact)
        )

    return test


def number_function(term: Term, places: Places, exact: bool) -> Callable[[Slots], int | None]:
    """The function that gives the value of a sum of numbers; None if the term is none, or a
    value in it is no number.
    """
    weights: Weights = {}
    constant = _collect_weights(term, places, 1, weights)
    if constant is None:
        return lambda _: None
    wraps = isinstance(term, Operation) and not exact
    return _sum_function(constant, tuple(weights.items()), wraps)


def _sum_function(
    constant: int, weights: Sequence[tuple[int, int]], wraps: bool
) -> Callable[[Slots], int | None]:
    half = 1 << CLINGO_BITS - 1

    def value(slots: Slots) -> int | None:
        total = constant
        for place, weight in weights:
            term = slots[place]
            if type(term) is not Number:
                return None
            total += weight * term.value
        return (total + half) % (2 * half) - half if wraps else total

    return value


def _collect_weights(term: Term, places: Places, factor: int, weights: Weights) -> int | None:
    """Count what a term adds to a sum: its constant part, and weights of places. None if it is no
    sum.

    Sums, differences and products wrap around alike, whether each of them does or the last alone.
    """
    match term:
        case Number(value):
            return factor * value
        case Variable() if term in places:
            weights[places[term]] = weights.get(places[term], 0) + factor
            return 0
        case Operation("+" | "-" as sign, left, right):
            one = _collect_weights(left, places, factor, weights)
            other = _collect_weights(right, places, factor if sign == "+" else -factor, weights)
            return None if one is None or other is None else one + other
        case Operation("*", Number(value), other) | Operation("*", other, Number(value)):
            return _collect_weights(other, places, factor * value, weights)
        case _:
            return None


Made = Callable[[Slots], Atom]
Question = tuple[str, int, tuple[tuple[int, int], ...], tuple[tuple[int, int], ...]]
"""A predicate, the number of its arguments, those of them that are in places of the list, and
pairs of equal ones.
"""


class SlotScope:
    """Places for parameters, constants and variables.

    Scopes inside one another share the list, not the names.
    """

    def __init__(self, parameters: Sequence[Variable]) -> None:
        self.parameters = tuple(parameters)
        self.places: dict[Term, int] = {
            parameter: place for place, parameter in enumerate(parameters)
        }
        self._more: list[Term | None] = []
        self._kept: dict[Question, int] = {}

    def inner(self) -> "SlotScope":
        """A scope that knows the parameters alone."""
        inner_scope = SlotScope(self.parameters)
        inner_scope._more, inner_scope._kept = self._more, self._kept
        return inner_scope

    def slots(self, values: Iterable[Term]) -> Slots:
        """The list for parameters with these values."""
        return [*values, *self._more]

    def bindings(self, slots: Slots) -> dict[Variable, Term]:
        """The values of the parameters by name."""
        return dict(zip(self.parameters, slots, strict=False))

    def place(self, term: Term) -> int:
        """The place of a term, which is new if it had none."""
        if term not in self.places:
            self.places[term] = len(self.parameters) + len(self._more)
            self._more.append(term)
        return self.places[term]

    def empty(self) -> int:
        """A place for something else than a term."""
        self._more.append(None)
        return len(self.parameters) + len(self._more) - 1

    def kept(self, question: Question) -> int | None:
        """The place of the facts that answer a question; None if that depends on more than
        parameters.
        """
        if any(place >= len(self.parameters) for _, place in question[2]):
            return None
        if question not in self._kept:
            self._kept[question] = self.empty()
        return self._kept[question]

    def knows(self, term: Term) -> bool:
        """Whether all variables of a term have places."""
        return all(variable in self.places for variable in term_variables(term))

    def atom(self, atom: Atom) -> Made:
        """The function that writes an atom."""
        if atom in self.places:
            return plain.itemgetter(self.places[atom])
        name, arguments = atom.name, atom.arguments
        if is_ground(atom):
            return lambda _: atom
        if all(
            is_ground(argument) or (isinstance(argument, Variable) and argument in self.places)
            for argument in arguments
        ):
            picked = [self.place(argument) for argument in arguments]
            return lambda slots: Function(name, tuple([slots[place] for place in picked]))
        return term_writer(atom, dict(self.places))  # type: ignore[return-value]


Next = Callable[[CheckerFacts, Slots], bool]
"""Goes on with what is known; tells whether to stop."""
Link = Callable[[Next], Next]
Matching = Callable[[CheckerFacts, Slots], list[Atom]]
Pairs = list[tuple[int, int]]


class Unprepared(Exception):
    """A condition is of a kind that is not prepared."""


class LookupPattern(NamedTuple):
    """What facts are looked up: the places of arguments that are known and of those that become
    known, and equal arguments.
    """

    name: str
    arity: int
    known: Pairs
    new: Pairs
    same: Pairs
    own: int | None  # the place of the fact itself


def lookup_link(atom: Atom, scope: SlotScope) -> Link:
    """Each fact that matches an atom, in the order of `Facts.matching`.

    Raises `Unprepared` for patterns inside arguments.
    """
    known_places, new, same = Pairs(), dict[Term, int](), Pairs()
    for at, argument in enumerate(atom.arguments):
        if argument in new:
            same.append((at, new[argument]))
        elif is_ground(argument) or argument in scope.places:
            known_places.append((at, scope.place(argument)))
        elif not isinstance(argument, Variable):
            raise Unprepared
        elif argument != ANYTHING:
            new[argument] = at
    places = [(at, scope.place(variable)) for variable, at in new.items()]
    own = scope.place(atom) if ANYTHING not in atom.arguments else None
    pattern = LookupPattern(atom.name, len(atom.arguments), known_places, places, same, own)
    return _match_link(
        pattern, scope.kept((pattern.name, pattern.arity, tuple(known_places), tuple(same)))
    )


def _match_link(pattern: LookupPattern, slot: int | None) -> Link:
    matching, new, own = _matching_function(pattern), pattern.new, pattern.own
    if slot is not None:
        matching = _look_once(matching, slot)

    def link(go_on: Next) -> Next:
        def step(facts: CheckerFacts, slots: Slots) -> bool:
            for atom in matching(facts, slots):
                for at, place in new:
                    slots[place] = atom.arguments[at]
                if own is not None:
                    slots[own] = atom
                if go_on(facts, slots):
                    return True
            return False

        return step

    return link


def _matching_function(pattern: LookupPattern) -> Matching:
    """The function that gives the facts that match."""
    name, arity, known_places, _, same, _ = pattern

    def find_matches(facts: CheckerFacts, slots: Slots) -> list[Atom]:
        values = [(at, slots[place]) for at, place in known_places]
        if not values:
            atoms = [fact for fact in facts.having(name, values) if len(fact.arguments) == arity]
        else:
            at, value = values[0]
            atoms = [
                fact
                for fact in facts.having(name, values)
                if len(own := fact.arguments) == arity and (own[at] is value or own[at] == value)
            ]
        for at, value in values[1:]:
            atoms = [atom for atom in atoms if atom.arguments[at] == value]
        for at, twin in same:
            atoms = [atom for atom in atoms if atom.arguments[at] == atom.arguments[twin]]
        return atoms

    return find_matches


def _look_once(matching: Matching, slot: int) -> Matching:
    """The same, which looks once for all conditions of a step that ask for it."""

    def once(facts: CheckerFacts, slots: Slots) -> list[Atom]:
        if slots[slot] is None:
            slots[slot] = matching(facts, slots)
        return slots[slot]  # type: ignore[no-any-return]

    return once
