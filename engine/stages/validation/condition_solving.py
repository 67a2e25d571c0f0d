"""Solving of conditions over facts by plain recursion: how the checker evaluates conditions.

The checker's own, like the rest of its Datalog.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from cellwright.engine.stages.validation.aggregate_values import Tuple, can_test, fitting_bindings
from cellwright.engine.stages.validation.checker_facts import CheckerFacts
from cellwright.kb.arithmetic import compare_terms, evaluate_term
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
from cellwright.kb.model.domain_model import UNLISTED_TYPES
from cellwright.kb.terms import (
    Atom,
    Function,
    Operation,
    Term,
    Variable,
    is_ground,
    match_term,
    substitute_atom,
    substitute_term,
    term_variables,
)

Bindings = Mapping[Variable, Term]
_ANY_VALUE = Function("value")  # stands for what a variable will be


def order_body(body: Body, bound: Iterable[Variable]) -> Body:
    """The parts of a body in the order in which they are solved once some variables have values."""
    ordered: list[BodyPart] = []
    values: dict[Variable, Term] = dict.fromkeys(bound, _ANY_VALUE)
    while body:
        part, body = next_part(body, values)
        ordered.append(part)
        values |= dict.fromkeys(bound_variables(part), _ANY_VALUE)
    return tuple(ordered)


def bound_variables(part: BodyPart) -> Iterator[Variable]:
    """The variables that have values once a literal or a comparison is solved, beside those
    that had values before.
    """
    match part:
        case Literal(atom, positive):
            terms: tuple[Term, ...] = (atom,) if positive else ()
        case Comparison(left, _, right):
            terms = (left, right)
        case _:
            raise TypeError(
                f"the order of a body with aggregates is not decided beforehand: {part}"
            )
    return (variable for term in terms for variable in term_variables(term) if variable.name != "_")


def next_part(body: Body, bindings: Bindings) -> tuple[BodyPart, Body]:
    """The part to solve first, and the other parts.

    First comes a test whose variables are bound, else the positive literal of which most is bound.
    """
    for index, part in enumerate(body):
        if _is_test(part, bindings):
            return part, body[:index] + body[index + 1 :]
    choices = (i for i, part in enumerate(body) if isinstance(part, Literal) and part.positive)
    index = min(choices, key=lambda i: _literal_openness(body[i], bindings), default=0)
    return body[index], body[:index] + body[index + 1 :]


def _literal_openness(part: BodyPart, bindings: Bindings) -> tuple[bool, int]:
    """How little of a literal is bound: whether no argument is, and the number of those that
    are not.
    """
    assert isinstance(part, Literal)
    unbound = sum(not _is_bound(argument, bindings) for argument in part.atom.arguments)
    return unbound == len(part.atom.arguments), unbound


def _is_test(part: BodyPart, bindings: Bindings) -> bool:
    match part:
        case Comparison(left, relation, right):
            bound = [_is_bound(side, bindings) for side in (left, right)]
            if all(bound) or relation != "=" or not any(bound):
                return all(bound)
            # else it must be computed first
            return not isinstance(right if bound[0] else left, Operation)
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
        return is_ground(term) or all(_is_bound(argument, bindings) for argument in term.arguments)
    if isinstance(term, Operation):
        return _is_bound(term.left, bindings) and _is_bound(term.right, bindings)
    return True


__all__ = [
    "Bindings",
    "OrderedCondition",
    "bind_parameters",
    "condition_holds",
    "order_condition",
    "solve_conditions",
    "solve_in_order",
]


def solve_conditions(
    body: Body, facts: CheckerFacts, bindings: Bindings, below: CheckerFacts | None = None
) -> Iterator[dict[Variable, Term]]:
    """Every binding that extends `bindings` and satisfies `body`.

    `below` (default: `facts`) decides whether `not p` holds.
    """
    if not body:
        yield dict(bindings)
        return
    part, rest = next_part(body, bindings) if len(body) > 1 else (body[0], ())
    for extended in _solve_part(part, facts, bindings, below or facts):
        yield from solve_conditions(rest, facts, extended, below)


def solve_in_order(ordered: Body, facts: CheckerFacts, bindings: Bindings) -> Iterator[Bindings]:
    """`solve` for a body that is in order already."""
    for place, part in enumerate(ordered):
        partial: Iterable[Bindings]
        if isinstance(part, Literal) and part.positive:
            atom = substitute_atom(part.atom, bindings)
            if is_ground(atom):
                if atom not in facts:
                    return
                continue
            partial = _match_facts(atom, facts, bindings)
        else:
            partial = _solve_part(part, facts, bindings, facts)
        rest = ordered[place + 1 :]
        if not rest:
            yield from partial
            return
        for extended in partial:
            yield from solve_in_order(rest, facts, extended)
        return
    yield bindings


def _match_facts(atom: Atom, facts: CheckerFacts, bindings: Bindings) -> list[Bindings]:
    """Bindings extended by each fact that matches an atom."""
    matches = (match_term(atom, fact, bindings) for fact in facts.matching(atom))
    return [match_bindings for match_bindings in matches if match_bindings is not None]


def _solve_part(
    part: BodyPart, facts: CheckerFacts, bindings: Bindings, below: CheckerFacts
) -> Iterator[Bindings]:
    match part:
        case Literal(atom, positive):
            yield from _solve_literal(
                substitute_atom(atom, bindings), positive, facts, bindings, below
            )
        case Comparison():
            yield from _solve_comparison(part, bindings)
        case StateAggregate():
            tuples = _collect_tuples(part, facts, bindings, below)
            other_tuples = (
                tuples if below is facts else _collect_tuples(part, below, bindings, facts)
            )
            yield from fitting_bindings(part, bindings, tuples, other_tuples)
        case Aggregate(text):
            raise ValueError(f"aggregates are evaluated by clingo beforehand: {text}")


def _collect_tuples(
    part: StateAggregate, facts: CheckerFacts, bindings: Bindings, below: CheckerFacts
) -> set[Tuple]:
    """The tuples in the set of an aggregate."""
    outer_bindings = {
        variable: bindings[variable] for variable in part.outer if variable in bindings
    }
    tuples = {
        tuple(evaluate_term(substitute_term(term, bound)) for term in element.terms)
        for element in part.elements
        for bound in solve_conditions(element.body, facts, outer_bindings, below)
    }
    return {member for member in tuples if None not in member}


def _solve_literal(
    atom: Atom, positive: bool, facts: CheckerFacts, bindings: Bindings, below: CheckerFacts
) -> Iterator[Bindings]:
    if is_ground(atom):
        if (atom in facts) if positive else (atom not in below):
            yield bindings
        return
    if not positive:
        if not any(match_term(atom, fact, {}) is not None for fact in below.matching(atom)):
            yield bindings
        return
    yield from _match_facts(atom, facts, bindings)


def _solve_comparison(part: Comparison, bindings: Bindings) -> Iterator[Bindings]:
    left, right = substitute_term(part.left, bindings), substitute_term(part.right, bindings)
    if part.relation == "=" and not (is_ground(left) and is_ground(right)):
        pattern, ground = (left, right) if is_ground(right) else (right, left)
        value = evaluate_term(ground, part.exact)
        extended = match_term(pattern, value, bindings) if value is not None else None
        if extended is not None:
            yield extended
    elif compare_terms(left, part.relation, right, part.exact):
        yield bindings


def condition_holds(
    condition: Condition, facts: CheckerFacts, bindings: Bindings, below: CheckerFacts | None = None
) -> bool:
    """Whether a condition is true; with `below`, whether it is true in every state from `facts`
    to `below`.
    """
    match condition:
        case Literal() | Comparison() | StateAggregate():
            return next(_solve_part(condition, facts, bindings, below or facts), None) is not None
        case And(parts):
            return all(condition_holds(part, facts, bindings, below) for part in parts)
        case Or(parts):
            return any(condition_holds(part, facts, bindings, below) for part in parts)
        case Not(part):
            return not condition_holds(part, below or facts, bindings, facts if below else None)
        case Exists(parameters, part):
            return next(bind_parameters(parameters, part, facts, bindings, below), None) is not None
        case ForAll(parameters, part):
            return not condition_holds(
                Exists(parameters, Not(part)), below or facts, bindings, facts if below else None
            )
        case Aggregate(text):
            raise ValueError(f"aggregates are evaluated by clingo beforehand: {text}")


def _type_literals(parameters: Iterable[Parameter]) -> Iterator[Literal]:
    """The literals that list the values of each parameter whose type can be listed."""
    return (
        Literal(Function(p.type, (p.variable,))) for p in parameters if p.type not in UNLISTED_TYPES
    )


def bind_parameters(
    parameters: tuple[Parameter, ...],
    condition: Condition,
    facts: CheckerFacts,
    bindings: Bindings,
    below: CheckerFacts | None = None,
) -> Iterator[Bindings]:
    """The bindings of all parameters with which a condition holds; with `below` as in `holds`."""
    if not parameters:
        if condition_holds(condition, facts, bindings, below):
            yield bindings
        return
    ordered = _cached_order(parameters, condition, bindings)
    if ordered is not None:
        yield from _solve_ordered(ordered, facts, bindings)
        return
    for solution in _bind_quantified(parameters, condition, facts, bindings):
        if condition_holds(condition, facts, solution, below):
            yield solution


@dataclass(frozen=True, slots=True)
class OrderedCondition:
    """The conditions of some parameters, in an order decided once, and the parameters whose
    types are left to be tested.
    """

    parameters: tuple[Parameter, ...]
    condition: Condition
    body: Body
    typed: tuple[Parameter, ...]


_ORDERED_CONDITIONS: dict[tuple[int, int, frozenset[Variable]], OrderedCondition | None] = {}
MAX_ORDERED_CONDITIONS = 1 << 12  # conditions in order that are kept


def _cached_order(
    parameters: tuple[Parameter, ...], part: Condition, bindings: Bindings
) -> OrderedCondition | None:
    """A condition in order, if facts give parameters their values and nothing is left to be tested
    after; else None.

    It is found again by identity: conditions that differ in whether they are exact are equal.
    """
    if not isinstance(part, Literal | And):
        return None
    key = id(parameters), id(part), frozenset(bindings)
    ordered = _ORDERED_CONDITIONS.get(key)
    if ordered is None or ordered.condition is not part or ordered.parameters is not parameters:
        if len(_ORDERED_CONDITIONS) >= MAX_ORDERED_CONDITIONS:
            _ORDERED_CONDITIONS.clear()
        ordered = _ORDERED_CONDITIONS[key] = order_condition(parameters, part, bindings)
    return ordered


def order_condition(
    parameters: tuple[Parameter, ...], part: Condition, bindings: Iterable[Variable]
) -> OrderedCondition | None:
    """A condition in order once some variables have values; None if it is of another kind."""
    if isinstance(part, Literal):
        return (
            OrderedCondition(parameters, part, (part,), parameters)
            if _binds_all(part, parameters)
            else None
        )
    body = tuple(
        conjunct for conjunct in goal_parts(part) if isinstance(conjunct, Literal | Comparison)
    )
    if len(body) < len(goal_parts(part)) or all(
        parameter.type not in UNLISTED_TYPES for parameter in parameters
    ):
        return None
    body = (*_type_literals(parameters), *body)
    if any(isinstance(conjunct, Literal) and not conjunct.positive for conjunct in body):
        return None
    return OrderedCondition(parameters, part, order_body(body, bindings), ())


def _binds_all(part: Literal, parameters: Iterable[Parameter]) -> bool:
    """Whether a fact that matches a literal gives all parameters a value.

    A type without values has none for the others.
    """
    return part.positive and {each.variable for each in parameters} <= set(
        term_variables(part.atom)
    )


def _solve_ordered(
    ordered: OrderedCondition, facts: CheckerFacts, bindings: Bindings
) -> Iterator[Bindings]:
    for solution in solve_in_order(ordered.body, facts, bindings):
        if all(
            p.variable not in solution or facts.has_type(solution[p.variable], p.type)
            for p in ordered.typed
        ):
            yield solution


def _bind_quantified(
    parameters: tuple[Parameter, ...], part: Condition, facts: CheckerFacts, bindings: Bindings
) -> Iterator[Bindings]:
    """Bindings of quantified variables: from the facts if the part is a literal, else from the
    types.
    """
    if isinstance(part, Literal) and _binds_all(part, parameters):
        for literal_bindings in _solve_literal(
            substitute_atom(part.atom, bindings), True, facts, bindings, facts
        ):
            if all(
                p.variable not in literal_bindings
                or facts.has_type(literal_bindings[p.variable], p.type)
                for p in parameters
            ):
                yield literal_bindings
        return
    if any(parameter.type in UNLISTED_TYPES for parameter in parameters):  # only facts bind numbers
        body = tuple(
            conjunct for conjunct in goal_parts(part) if isinstance(conjunct, Literal | Comparison)
        )
        yield from solve_conditions((*_type_literals(parameters), *body), facts, bindings)
        return
    if not parameters:
        yield bindings
        return
    first, rest = parameters[0], parameters[1:]
    for atom in list(facts.named(first.type)):
        yield from _bind_quantified(
            rest, part, facts, {**bindings, first.variable: atom.arguments[0]}
        )
