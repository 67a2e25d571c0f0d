"""Solves bodies over sets of facts by plain recursion: this is how the checker itself evaluates conditions.

It shares with the search how terms are computed and compared (`cellwright.kb.arithmetic`), but no code that solves.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from cellwright.engine.stages.validation.aggregates import Tuple, fitting
from cellwright.engine.stages.validation.facts import Facts
from cellwright.engine.stages.validation.ordering import Bindings, in_order, next_part
from cellwright.kb.arithmetic import compare, evaluate
from cellwright.kb.model.conditions import (
    Aggregate,
    And,
    Body,
    BodyPart,
    Comparison,
    Condition,
    Exists,
    ForAll,
    Literal,
    Not,
    Or,
    Parameter,
    StateAggregate,
    goal_parts,
)
from cellwright.kb.model.domain import UNLISTED
from cellwright.kb.terms import (
    Atom,
    Function,
    Term,
    Variable,
    is_ground,
    match,
    substitute,
    substitute_atom,
)

__all__ = ["Arranged", "Bindings", "arranged", "bound", "holds", "solutions", "solve"]


def solve(
    body: Body, facts: Facts, bindings: Bindings, below: Facts | None = None
) -> Iterator[dict[Variable, Term]]:
    """Every binding that extends `bindings` and satisfies `body`.

    `below` (default: `facts`) decides whether `not p` holds.
    """
    if not body:
        yield dict(bindings)
        return
    part, rest = next_part(body, bindings) if len(body) > 1 else (body[0], ())
    for extended in _part(part, facts, bindings, below or facts):
        yield from solve(rest, facts, extended, below)


def solutions(ordered: Body, facts: Facts, bindings: Bindings) -> Iterator[Bindings]:
    """`solve` for a body that is in order already."""
    for place, part in enumerate(ordered):
        found: Iterable[Bindings]
        if isinstance(part, Literal) and part.positive:
            atom = substitute_atom(part.atom, bindings)
            if is_ground(atom):
                if atom not in facts:
                    return
                continue
            found = _matching(atom, facts, bindings)
        else:
            found = _part(part, facts, bindings, facts)
        rest = ordered[place + 1 :]
        if not rest:
            yield from found
            return
        for extended in found:
            yield from solutions(rest, facts, extended)
        return
    yield bindings


def _matching(atom: Atom, facts: Facts, bindings: Bindings) -> list[Bindings]:
    """Bindings extended by each fact that matches an atom."""
    found = (match(atom, other, bindings) for other in facts.matching(atom))
    return [each for each in found if each is not None]


def _part(part: BodyPart, facts: Facts, bindings: Bindings, below: Facts) -> Iterator[Bindings]:
    match part:
        case Literal(atom, positive):
            yield from _literal(substitute_atom(atom, bindings), positive, facts, bindings, below)
        case Comparison():
            yield from _comparison(part, bindings)
        case StateAggregate():
            tuples = _collected(part, facts, bindings, below)
            others = tuples if below is facts else _collected(part, below, bindings, facts)
            yield from fitting(part, bindings, tuples, others)
        case Aggregate(text):
            raise ValueError(f"aggregates are evaluated by clingo beforehand: {text}")


def _collected(part: StateAggregate, facts: Facts, bindings: Bindings, below: Facts) -> set[Tuple]:
    """The tuples in the set of an aggregate."""
    known = {variable: bindings[variable] for variable in part.outer if variable in bindings}
    found = {
        tuple(evaluate(substitute(term, bound)) for term in each.terms)
        for each in part.elements
        for bound in solve(each.body, facts, known, below)
    }
    return {each for each in found if None not in each}


def _literal(
    atom: Atom, positive: bool, facts: Facts, bindings: Bindings, below: Facts
) -> Iterator[Bindings]:
    if is_ground(atom):
        if (atom in facts) if positive else (atom not in below):
            yield bindings
        return
    if not positive:
        if not any(match(atom, other, {}) is not None for other in below.matching(atom)):
            yield bindings
        return
    yield from _matching(atom, facts, bindings)


def _comparison(part: Comparison, bindings: Bindings) -> Iterator[Bindings]:
    left, right = substitute(part.left, bindings), substitute(part.right, bindings)
    if part.relation == "=" and not (is_ground(left) and is_ground(right)):
        pattern, ground = (left, right) if is_ground(right) else (right, left)
        value = evaluate(ground, part.exact)
        extended = match(pattern, value, bindings) if value is not None else None
        if extended is not None:
            yield extended
    elif compare(left, part.relation, right, part.exact):
        yield bindings


def holds(condition: Condition, facts: Facts, bindings: Bindings, below: Facts | None = None) -> bool:
    """Whether a condition is true; with `below`, whether it is true in every state from `facts` to `below`."""
    match condition:
        case Literal() | Comparison() | StateAggregate():
            return next(_part(condition, facts, bindings, below or facts), None) is not None
        case And(parts):
            return all(holds(part, facts, bindings, below) for part in parts)
        case Or(parts):
            return any(holds(part, facts, bindings, below) for part in parts)
        case Not(part):
            return not holds(part, below or facts, bindings, facts if below else None)
        case Exists(parameters, part):
            return next(bound(parameters, part, facts, bindings, below), None) is not None
        case ForAll(parameters, part):
            return not holds(
                Exists(parameters, Not(part)), below or facts, bindings, facts if below else None
            )
        case Aggregate(text):
            raise ValueError(f"aggregates are evaluated by clingo beforehand: {text}")


def _typed(parameters: Iterable[Parameter]) -> Iterator[Literal]:
    """The literals that list the values of each parameter whose type can be listed."""
    return (Literal(Function(p.type, (p.variable,))) for p in parameters if p.type not in UNLISTED)


def bound(
    parameters: tuple[Parameter, ...],
    condition: Condition,
    facts: Facts,
    bindings: Bindings,
    below: Facts | None = None,
) -> Iterator[Bindings]:
    """The bindings of all parameters with which a condition holds; with `below` as in `holds`."""
    if not parameters:
        if holds(condition, facts, bindings, below):
            yield bindings
        return
    ordered = _ordered(parameters, condition, bindings)
    if ordered is not None:
        yield from _solved(ordered, facts, bindings)
        return
    for each in _values(parameters, condition, facts, bindings):
        if holds(condition, facts, each, below):
            yield each


@dataclass(frozen=True, slots=True)
class Arranged:
    """The conditions of some parameters, in an order decided once, and the parameters whose types are left to be tested."""

    parameters: tuple[Parameter, ...]
    condition: Condition
    body: Body
    typed: tuple[Parameter, ...]


_ORDERED: dict[tuple[int, int, frozenset[Variable]], Arranged | None] = {}
MOST = 1 << 12  # conditions in order that are kept


def _ordered(parameters: tuple[Parameter, ...], part: Condition, bindings: Bindings) -> Arranged | None:
    """A condition in order, if facts give parameters their values and nothing is left to be tested after; else None.

    It is found again by identity: conditions that differ in whether they are exact are equal.
    """
    if not isinstance(part, Literal | And):
        return None
    key = id(parameters), id(part), frozenset(bindings)
    found = _ORDERED.get(key)
    if found is None or found.condition is not part or found.parameters is not parameters:
        if len(_ORDERED) >= MOST:
            _ORDERED.clear()
        found = _ORDERED[key] = arranged(parameters, part, bindings)
    return found


def arranged(
    parameters: tuple[Parameter, ...], part: Condition, bindings: Iterable[Variable]
) -> Arranged | None:
    """A condition in order once some variables have values; None if it is of another kind."""
    if isinstance(part, Literal):
        return Arranged(parameters, part, (part,), parameters) if part.positive else None
    body = tuple(each for each in goal_parts(part) if isinstance(each, Literal | Comparison))
    if len(body) < len(goal_parts(part)) or all(each.type not in UNLISTED for each in parameters):
        return None
    body = (*_typed(parameters), *body)
    if any(isinstance(each, Literal) and not each.positive for each in body):
        return None
    return Arranged(parameters, part, in_order(body, bindings), ())


def _solved(ordered: Arranged, facts: Facts, bindings: Bindings) -> Iterator[Bindings]:
    for found in solutions(ordered.body, facts, bindings):
        if all(p.variable not in found or facts.has_type(found[p.variable], p.type) for p in ordered.typed):
            yield found


def _values(
    parameters: tuple[Parameter, ...], part: Condition, facts: Facts, bindings: Bindings
) -> Iterator[Bindings]:
    """Bindings of quantified variables: from the facts if the part is a literal, else from the types."""
    if isinstance(part, Literal) and part.positive:
        for found in _literal(substitute_atom(part.atom, bindings), True, facts, bindings, facts):
            if all(p.variable not in found or facts.has_type(found[p.variable], p.type) for p in parameters):
                yield found
        return
    if any(parameter.type in UNLISTED for parameter in parameters):  # only facts bind numbers
        body = tuple(each for each in goal_parts(part) if isinstance(each, Literal | Comparison))
        yield from solve((*_typed(parameters), *body), facts, bindings)
        return
    if not parameters:
        yield bindings
        return
    first, rest = parameters[0], parameters[1:]
    for atom in list(facts.named(first.type)):
        yield from _values(rest, part, facts, {**bindings, first.variable: atom.arguments[0]})
