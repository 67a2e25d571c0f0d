"""Which condition of a body is solved first: what is needed to know that is which variables have values.

The checker's own, like the rest of its Datalog.
"""

from collections.abc import Iterable, Iterator, Mapping

from cellwright.engine.stages.validation.aggregates import can_test
from cellwright.kb.model.conditions import Aggregate, Body, BodyPart, Comparison, Literal, StateAggregate
from cellwright.kb.terms import Function, Operation, Term, Variable, is_ground, variables

Bindings = Mapping[Variable, Term]
_VALUE = Function("value")  # stands for what a variable will be


def in_order(body: Body, bound: Iterable[Variable]) -> Body:
    """The parts of a body in the order in which they are solved once some variables have values."""
    found: list[BodyPart] = []
    known: dict[Variable, Term] = dict.fromkeys(bound, _VALUE)
    while body:
        part, body = next_part(body, known)
        found.append(part)
        known |= dict.fromkeys(binds(part), _VALUE)
    return tuple(found)


def binds(part: BodyPart) -> Iterator[Variable]:
    """The variables that have values once a literal or a comparison is solved, beside those that had values before."""
    match part:
        case Literal(atom, positive):
            terms: tuple[Term, ...] = (atom,) if positive else ()
        case Comparison(left, _, right):
            terms = (left, right)
        case _:
            raise TypeError(f"the order of a body with aggregates is not decided beforehand: {part}")
    return (each for term in terms for each in variables(term) if each.name != "_")


def next_part(body: Body, bindings: Bindings) -> tuple[BodyPart, Body]:
    """The part to solve first, and the other parts.

    First comes a test whose variables are bound, else the positive literal of which most is bound.
    """
    for index, part in enumerate(body):
        if _is_test(part, bindings):
            return part, body[:index] + body[index + 1 :]
    choices = (i for i, part in enumerate(body) if isinstance(part, Literal) and part.positive)
    index = min(choices, key=lambda i: _openness(body[i], bindings), default=0)
    return body[index], body[:index] + body[index + 1 :]


def _openness(part: BodyPart, bindings: Bindings) -> tuple[bool, int]:
    """How little of a literal is bound: whether no argument is, and the number of those that are not."""
    assert isinstance(part, Literal)
    unbound = sum(not _is_bound(each, bindings) for each in part.atom.arguments)
    return unbound == len(part.atom.arguments), unbound


def _is_test(part: BodyPart, bindings: Bindings) -> bool:
    match part:
        case Comparison(left, relation, right):
            bound = [_is_bound(side, bindings) for side in (left, right)]
            if all(bound) or relation != "=" or not any(bound):
                return all(bound)
            return not isinstance(right if bound[0] else left, Operation)  # else it must be computed first
        case Literal(atom):
            return _is_bound(atom, bindings)
        case Aggregate():
            return False
        case StateAggregate():
            return can_test(part, bindings)


def _is_bound(term: Term, bindings: Bindings) -> bool:
    """Whether a term has no variables under bindings."""
    if isinstance(term, Variable):
        value = bindings.get(term)
        return value is not None and is_ground(value)
    if isinstance(term, Function):
        return is_ground(term) or all(_is_bound(each, bindings) for each in term.arguments)
    if isinstance(term, Operation):
        return _is_bound(term.left, bindings) and _is_bound(term.right, bindings)
    return True
