"""Values of aggregates over fluents in the checker: that of a set, or the range in which it lies.

Where only bounds of a state are known, so are only bounds of the set: tuples that are in it for
certain, and others that may be.
"""

from collections.abc import Iterator, Mapping, Set

from cellwright.kb.arithmetic import evaluate_term, order_key
from cellwright.kb.model.conditions import StateAggregate
from cellwright.kb.terms import Number, Term, Variable, is_ground, substitute_term

Tuple = tuple[Term | None, ...]
Key = tuple[object, ...]
Bindings = Mapping[Variable, Term]
LOWEST_KEY: Key = (-1,)  # the #max of nothing: before all terms
HIGHEST_KEY: Key = (9,)  # the #min of nothing: behind all terms


def can_test(aggregate: StateAggregate, bindings: Bindings) -> bool:
    """Whether the outer variables of an aggregate have values, except for one that takes its
    value.
    """
    taken = _taken_variable(aggregate, bindings)
    return all(variable in bindings or variable == taken for variable in aggregate.outer)


def _taken_variable(aggregate: StateAggregate, bindings: Bindings) -> Variable | None:
    """The variable that takes the value of the aggregate; None if there is none."""
    if not aggregate.positive:
        return None
    open_ = (t for relation, t in aggregate.guards if relation == "=" and isinstance(t, Variable))
    return next((term for term in open_ if term not in bindings), None)


def fitting_bindings(
    aggregate: StateAggregate, bindings: Bindings, one: Set[Tuple], other: Set[Tuple]
) -> Iterator[Bindings]:
    """The bindings with which an aggregate is true of a set.

    If all of `one` are in `other`, the set lies between them, and the aggregate must be true of
    each such set. Else the set lies between `other` and `one`, and the aggregate may be true of one
    such set. If they are the same, so is the answer.
    """
    for_certain = one <= other
    certain, possible = (one, other) if for_certain else (other, one)
    low, high = _value_range(aggregate.function, certain, possible)
    taken = _taken_variable(aggregate, bindings)
    if taken is None:
        if _is_true(aggregate, bindings, low, high, for_certain):
            yield bindings
        return
    values = (
        _values_between(aggregate.function, possible, low, high)
        if low == high or not for_certain
        else ()
    )
    for value in values:
        extended = {**bindings, taken: value}
        if _is_true(aggregate, extended, low, high, for_certain):
            yield extended


def _value_range(function: str, certain: Set[Tuple], possible: Set[Tuple]) -> tuple[Key, Key]:
    """The least and the greatest value of a set between two others."""
    if function == "count":
        return (0, len(certain)), (0, len(possible))
    if function == "sum":
        certain_sum = sum(map(_tuple_weight, certain))
        open_ = [_tuple_weight(member) for member in possible - certain]
        return (0, certain_sum + sum(w for w in open_ if w < 0)), (
            0,
            certain_sum + sum(w for w in open_ if w > 0),
        )
    choose, nothing = (min, HIGHEST_KEY) if function == "min" else (max, LOWEST_KEY)
    ends = [choose(map(_first_key, members), default=nothing) for members in (certain, possible)]
    return min(ends), max(ends)


def _tuple_weight(member: Tuple) -> int:
    return member[0].value if member and isinstance(member[0], Number) else 0


def _first_key(member: Tuple) -> Key:
    return order_key(member[0]) if member and member[0] is not None else LOWEST_KEY


def _values_between(function: str, possible: Set[Tuple], low: Key, high: Key) -> Iterator[Term]:
    """The values between two ends that an aggregate may have, as terms."""
    if function in ("count", "sum"):
        assert isinstance(low[1], int)
        assert isinstance(high[1], int)
        yield from map(Number, range(low[1], high[1] + 1))
        return
    terms = {member[0] for member in possible if member and member[0] is not None}
    yield from sorted((t for t in terms if low <= order_key(t) <= high), key=order_key)


def _is_true(
    aggregate: StateAggregate, bindings: Bindings, low: Key, high: Key, for_certain: bool
) -> bool:
    """Whether all comparisons hold for every value between two ends, or may hold for one; the
    reverse under `not`.
    """
    sides = [
        (relation, evaluate_term(substitute_term(term, bindings)))
        for relation, term in aggregate.guards
    ]
    if any(side is None or not is_ground(side) for _, side in sides):
        return False
    bounds = [(relation, order_key(side)) for relation, side in sides if side is not None]
    if for_certain is aggregate.positive:
        all_hold = all(
            not _may_hold(_NEGATED_RELATIONS[relation], low, high, bound)
            for relation, bound in bounds
        )
    else:
        all_hold = all(_may_hold(relation, low, high, bound) for relation, bound in bounds)
    return all_hold is aggregate.positive


def _may_hold(relation: str, low: Key, high: Key, bound: Key) -> bool:
    """Whether a comparison may hold for some value between two ends."""
    match relation:
        case "=":
            return low <= bound <= high
        case "!=":
            return not low == bound == high
        case "<":
            return low < bound
        case "<=":
            return low <= bound
        case ">":
            return high > bound
        case _:
            return high >= bound


_NEGATED_RELATIONS = {"=": "!=", "!=": "=", "<": ">=", ">=": "<", ">": "<=", "<=": ">"}
