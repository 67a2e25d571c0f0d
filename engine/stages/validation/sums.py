"""Arithmetic over a list of terms whose places are known: sums as numbers for each place, found once.

Its values are those of `cellwright.kb.arithmetic`. What is no sum of numbers is left to it.
"""

import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from cellwright.kb.arithmetic import BITS, compare, evaluate
from cellwright.kb.model.conditions import Comparison
from cellwright.kb.terms import Number, Operation, Term, Variable, substitute

Slots = list[Any]  # terms, and what is known of them
Places = Mapping[Term, int]
Value = Callable[[Slots], Term | None]
Test = Callable[[Slots], bool]
Weights = dict[int, int]

RELATIONS: Mapping[str, Callable[[int, int], bool]] = {
    "=": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}


def written(term: Term, places: Places) -> Value:
    """The function that writes a term with the values of its variables; those without a place stay."""
    if term in places:
        return operator.itemgetter(places[term])
    known = tuple((each, place) for each, place in places.items() if isinstance(each, Variable))
    return lambda slots: substitute(term, {variable: slots[place] for variable, place in known})


def valued(term: Term, places: Places, exact: bool) -> Value:
    """The function that gives the value of a term, all of whose variables have places; None if it has no value."""
    plain, sum_ = written(term, places), number(term, places, exact)

    def value(slots: Slots) -> Term | None:
        found = sum_(slots)
        if found is not None:
            return Number(found)
        own = plain(slots)
        return None if own is None else evaluate(own, exact)

    return value


def compared(part: Comparison, places: Places) -> Test:
    """The test of a comparison, all of whose variables have places."""
    (left, right), exact = (part.left, part.right), part.exact
    one, other = (number(each, places, exact) for each in (left, right))
    said = tuple(written(each, places) for each in (left, right))
    relation, related = part.relation, RELATIONS[part.relation]

    def test(slots: Slots) -> bool:
        low, high = one(slots), other(slots)
        if low is not None and high is not None:
            return related(low, high)
        first, second = (each(slots) for each in said)
        return first is not None and second is not None and compare(first, relation, second, exact)

    return test


def number(term: Term, places: Places, exact: bool) -> Callable[[Slots], int | None]:
    """The function that gives the value of a sum of numbers; None if the term is none, or a value in it is no number."""
    weights: Weights = {}
    constant = _collect(term, places, 1, weights)
    if constant is None:
        return lambda _: None
    wraps = isinstance(term, Operation) and not exact
    return _summed(constant, tuple(weights.items()), wraps)


def _summed(constant: int, weights: Sequence[tuple[int, int]], wraps: bool) -> Callable[[Slots], int | None]:
    half = 1 << BITS - 1

    def value(slots: Slots) -> int | None:
        found = constant
        for place, weight in weights:
            each = slots[place]
            if type(each) is not Number:
                return None
            found += weight * each.value
        return (found + half) % (2 * half) - half if wraps else found

    return value


def _collect(term: Term, places: Places, factor: int, weights: Weights) -> int | None:
    """Count what a term adds to a sum: its constant part, and weights of places. None if it is no sum.

    Sums, differences and products wrap around alike, whether each of them does or the last alone.
    """
    match term:
        case Number(value):
            return factor * value
        case Variable() if term in places:
            weights[places[term]] = weights.get(places[term], 0) + factor
            return 0
        case Operation("+" | "-" as sign, left, right):
            one = _collect(left, places, factor, weights)
            other = _collect(right, places, factor if sign == "+" else -factor, weights)
            return None if one is None or other is None else one + other
        case Operation("*", Number(value), other) | Operation("*", other, Number(value)):
            return _collect(other, places, factor * value, weights)
        case _:
            return None
