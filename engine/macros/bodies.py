"""Bodies solved over facts by join: the cheapest part first, tests as soon as they can be decided."""

from collections.abc import Iterator, Mapping

from engine.macros.facts import Facts
from kb.model.conditions import Aggregate, Body, BodyPart, Comparison, Literal, substitute_part
from kb.terms import Function, Number, Operation, Term, Text, Variable, is_ground, match

Bindings = Mapping[Variable, Term]


def evaluate(term: Term) -> Term | None:
    """A ground term with its arithmetic done as clingo does it; None where it has no value."""
    if not isinstance(term, Operation):
        return term
    left, right = evaluate(term.left), evaluate(term.right)
    if not isinstance(left, Number) or not isinstance(right, Number):
        return None
    return _calculate(term.operator, left.value, right.value)


def _calculate(operator: str, left: int, right: int) -> Term | None:
    if operator == "+":
        return Number(left + right)
    if operator == "-":
        return Number(left - right)
    if operator == "*":
        return Number(left * right)
    if right == 0:
        return None
    quotient = abs(left) // abs(right)
    quotient = quotient if (left < 0) == (right < 0) else -quotient
    return Number(quotient if operator == "/" else left - quotient * right)


def _order(term: Term) -> tuple[object, ...]:
    """clingo's order of terms: numbers, constants, texts, then compound terms by arity, name and arguments."""
    match term:
        case Number(value):
            return (0, value)
        case Function(name, ()):
            return (1, name)
        case Text(value):
            return (2, value)
        case Function(name, arguments):
            return (3, len(arguments), name, tuple(map(_order, arguments)))
        case _:
            raise ValueError(f"{term} is not ground")


def compare(left: Term, relation: str, right: Term) -> bool:
    """Whether a ground comparison is true; false where arithmetic has no value."""
    one, other = evaluate(left), evaluate(right)
    if one is None or other is None:
        return False
    if relation in ("=", "!="):
        return (one == other) == (relation == "=")
    low, high = _order(one), _order(other)
    if relation in ("<", "<="):
        return low < high or (relation == "<=" and low == high)
    return low > high or (relation == ">=" and low == high)


def solve(body: Body, facts: Facts, bindings: Bindings) -> Iterator[dict[Variable, Term]]:
    """Every binding that extends `bindings` and satisfies `body`; negated literals mean absence."""
    if not body:
        yield dict(bindings)
        return
    parts = [substitute_part(part, bindings) for part in body]
    index = _cheapest(parts, facts) if len(parts) > 1 else 0
    rest = body[:index] + body[index + 1 :]
    for extended in _extensions(parts[index], facts, bindings):
        yield from solve(rest, facts, extended)


def satisfiable(body: Body, facts: Facts, bindings: Bindings) -> bool:
    """Whether a body has a binding."""
    return not body or next(solve(body, facts, bindings), None) is not None


def _cheapest(parts: list[BodyPart], facts: Facts) -> int:
    best, best_cost = 0, float("inf")
    for index, part in enumerate(parts):
        cost = _cost(part, facts)
        if cost == 0:
            return index
        if cost < best_cost:
            best, best_cost = index, cost
    return best


def _cost(part: BodyPart, facts: Facts) -> float:
    """How many bindings a part may yield; 0 for a test."""
    match part:
        case Comparison(left, relation, right):
            sides = is_ground(left), is_ground(right)
            return 0 if all(sides) or (relation == "=" and any(sides)) else float("inf")
        case Literal(atom, positive):
            if is_ground(atom):
                return 0
            return 1 + len(facts.matching(atom)) if positive else 1e9
        case Aggregate():
            raise ValueError(f"aggregates are evaluated beforehand: {part}")


def _extensions(part: BodyPart, facts: Facts, bindings: Bindings) -> Iterator[Bindings]:
    match part:
        case Literal(atom, True):
            for other in facts.matching(atom):
                extended = match(atom, other, bindings)
                if extended is not None:
                    yield extended
        case Literal(atom):
            absent = (
                atom not in facts
                if is_ground(atom)
                else not any(match(atom, other, {}) is not None for other in facts.matching(atom))
            )
            if absent:
                yield bindings
        case Comparison():
            yield from _comparison(part, bindings)
        case _:
            return


def _comparison(part: Comparison, bindings: Bindings) -> Iterator[Bindings]:
    left_ground, right_ground = is_ground(part.left), is_ground(part.right)
    if left_ground and right_ground:
        if compare(part.left, part.relation, part.right):
            yield bindings
        return
    if part.relation != "=" or not (left_ground or right_ground):
        return
    pattern, ground = (part.right, part.left) if left_ground else (part.left, part.right)
    value = evaluate(ground)
    extended = match(pattern, value, bindings) if value is not None else None
    if extended is not None:
        yield extended
