"""Solves bodies over facts by join.

The cheapest part comes first, and each test runs as soon as it can be decided.
"""

from collections.abc import Iterator, Mapping

from cellwright.engine.stages.macros.lifted.facts import Facts
from cellwright.kb.arithmetic import aggregated, compare, evaluate, order_key, relates, term_of
from cellwright.kb.model.conditions import (
    Aggregate,
    Body,
    BodyPart,
    Comparison,
    Literal,
    StateAggregate,
    substitute_part,
)
from cellwright.kb.terms import Operation, Term, Variable, is_ground, match, substitute

Bindings = Mapping[Variable, Term]


def solve(body: Body, facts: Facts, bindings: Bindings) -> Iterator[dict[Variable, Term]]:
    """Every binding that extends `bindings` and satisfies `body`; negated literals mean absence."""
    return _solved([substitute_part(part, bindings) for part in body], facts, dict(bindings))


def _solved(
    parts: list[BodyPart], facts: Facts, bindings: dict[Variable, Term]
) -> Iterator[dict[Variable, Term]]:
    """The same, for parts in which the bound variables are already replaced."""
    waiting = []
    for part in parts:
        truth = _truth(part, facts)
        if truth is None:
            waiting.append(part)
        elif not truth:
            return
    if not waiting:
        yield bindings
        return
    chosen = waiting.pop(_cheapest(waiting, facts) if len(waiting) > 1 else 0)
    for new in _extensions(chosen, facts):
        rest = [substitute_part(part, new) for part in waiting] if new else waiting
        yield from _solved(rest, facts, {**bindings, **new})


def _truth(part: BodyPart, facts: Facts) -> bool | None:
    """Whether a part holds; None while it has open variables."""
    match part:
        case Literal(atom, positive):
            return (atom in facts) == positive if is_ground(atom) else None
        case Comparison(left, relation, right):
            return compare(left, relation, right) if is_ground(left) and is_ground(right) else None
        case StateAggregate():
            return None if part.outer else next(_fitting(part, facts), None) is not None
        case Aggregate():
            raise ValueError(f"aggregates must be evaluated before this: {part}")


def satisfiable(body: Body, facts: Facts, bindings: Bindings) -> bool:
    """Whether a body has a binding. Tests come first: most bodies have nothing else."""
    waiting = []
    for part in body:
        bound = substitute_part(part, bindings)
        truth = _truth(bound, facts)
        if truth is None:
            waiting.append(bound)
        elif not truth:
            return False
    return not waiting or next(_solved(waiting, facts, {}), None) is not None


def _cheapest(parts: list[BodyPart], facts: Facts) -> int:
    costs = [_cost(part, facts) for part in parts]
    return costs.index(min(costs))


def _cost(part: BodyPart, facts: Facts) -> float:
    """An estimate of how many bindings a part with open variables yields."""
    match part:
        case Comparison(left, relation, right):
            return 0 if relation == "=" and _binds(left, right) else float("inf")
        case Literal(atom, positive):
            return len(facts.matching(atom)) if positive else 1e9
        case StateAggregate(outer=outer):
            return 1e10 if len(outer) == 1 else float("inf")
        case _:
            return float("inf")


def _extensions(part: BodyPart, facts: Facts) -> Iterator[Bindings]:
    """The bindings of a part's open variables that make it true."""
    match part:
        case Literal(atom, True):
            found = (match(atom, other, {}) for other in facts.matching(atom))
            yield from (each for each in found if each is not None)
        case Literal(atom):
            if not any(match(atom, other, {}) is not None for other in facts.matching(atom)):
                yield {}
        case Comparison():
            yield from _comparison(part)
        case StateAggregate():
            yield from _fitting(part, facts)
        case _:
            return


def _fitting(part: StateAggregate, facts: Facts) -> Iterator[Bindings]:
    """The value of the variable that takes that of an aggregate, or nothing to bind, if the aggregate is true."""
    tuples = {
        tuple(evaluate(substitute(term, found)) for term in each.terms)
        for each in part.elements
        for found in solve(each.body, facts, {})
    }
    value = aggregated(part.function, tuples)
    term = term_of(value, tuples)
    bindings = {part.outer[0]: term} if part.outer and term is not None else {}
    sides = [(relation, evaluate(substitute(side, bindings))) for relation, side in part.guards]
    if all(side is not None and is_ground(side) for _, side in sides):
        true = all(relates(relation, value, order_key(side)) for relation, side in sides if side is not None)
        if true is part.positive:
            yield bindings


def _binds(left: Term, right: Term) -> bool:
    """Whether an equation gives values to the variables of one side.

    The other side must have a value, and the side with the variables must not be arithmetic.
    """
    one, other = is_ground(left), is_ground(right)
    return (one or other) and not isinstance(right if one else left, Operation)


def _comparison(part: Comparison) -> Iterator[Bindings]:
    if part.relation != "=" or not _binds(part.left, part.right):
        return
    pattern, ground = (part.right, part.left) if is_ground(part.left) else (part.left, part.right)
    value = evaluate(ground)
    extended = match(pattern, value, {}) if value is not None else None
    if extended is not None:
        yield extended
