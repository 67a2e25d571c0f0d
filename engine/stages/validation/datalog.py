"""Solves bodies over sets of facts by plain recursion: this is how the checker itself evaluates conditions.

It shares with the search how terms are computed and compared (`kb.arithmetic`), but no code that solves.
"""

from collections.abc import Iterable, Iterator, Mapping

from engine.stages.validation.aggregates import Tuple, can_test, fitting
from engine.stages.validation.facts import Facts
from kb.arithmetic import compare, evaluate
from kb.model.conditions import (
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
from kb.model.domain import UNLISTED
from kb.terms import (
    Atom,
    Function,
    Operation,
    Term,
    Variable,
    is_ground,
    match,
    substitute,
    substitute_atom,
    variables,
)

Bindings = Mapping[Variable, Term]
_VALUE = Function("value")  # stands for what a variable will be


def solve(
    body: Body, facts: Facts, bindings: Bindings, below: Facts | None = None
) -> Iterator[dict[Variable, Term]]:
    """Every binding that extends `bindings` and satisfies `body`.

    `below` (default: `facts`) decides whether `not p` holds.
    """
    if not body:
        yield dict(bindings)
        return
    part, rest = _next(body, bindings) if len(body) > 1 else (body[0], ())
    for extended in _part(part, facts, bindings, below or facts):
        yield from solve(rest, facts, extended, below)


def in_order(body: Body, bound: Iterable[Variable]) -> Body:
    """The parts of a body in the order in which they are solved once some variables have values."""
    found: list[BodyPart] = []
    known: dict[Variable, Term] = dict.fromkeys(bound, _VALUE)
    while body:
        part, body = _next(body, known)
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


def solutions(ordered: Body, facts: Facts, bindings: Bindings) -> Iterator[Bindings]:
    """`solve` for a body that is in order already."""
    for place, part in enumerate(ordered):
        if isinstance(part, Literal) and part.positive:
            atom = substitute_atom(part.atom, bindings)
            if is_ground(atom):
                if atom not in facts:
                    return
                continue
        for extended in _part(part, facts, bindings, facts):
            yield from solutions(ordered[place + 1 :], facts, extended)
        return
    yield bindings


def _next(body: Body, bindings: Bindings) -> tuple[BodyPart, Body]:
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
    for other in list(facts.matching(atom)):
        extended = match(atom, other, bindings)
        if extended is not None:
            yield extended


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
            return any(holds(part, facts, each, below) for each in _values(parameters, part, facts, bindings))
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
    parameters: tuple[Parameter, ...], condition: Condition, facts: Facts, bindings: Bindings
) -> Iterator[Bindings]:
    """The bindings of all parameters with which a condition holds."""
    for each in _values(parameters, condition, facts, bindings) if parameters else (bindings,):
        if holds(condition, facts, each):
            yield each


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
