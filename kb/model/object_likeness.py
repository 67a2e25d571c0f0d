"""Objects that are alike: nothing that the goals can need tells them apart.

Two objects are alike if exchanging them changes neither the goals nor any relevant fact. A relevant
fact about two such objects ties them, and then neither is left out.
"""

from collections.abc import Iterable, Iterator, Mapping

from cellwright.kb.model.conditions import (
    Aggregate,
    Body,
    BodyPart,
    Comparison,
    Condition,
    ForAll,
    Literal,
    Not,
    Parameter,
    StateAggregate,
)
from cellwright.kb.model.conditions import all_conditions as parts_of
from cellwright.kb.model.domain_model import Domain, Operator
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function, Operation, Term

OBJECT_STAND_IN = Function("?")


def free_objects(problem: Problem) -> dict[str, str]:
    """The objects, with their types, that neither goals nor operators and rules name, and over
    which nothing ranges.
    """
    objects = {**problem.domain.objects, **problem.objects}
    fixed = {name for term in _terms_mentioned(problem) for name in constant_names(term)}
    ranged = _types_ranged_over(problem)
    barred = {
        type_
        for type_ in set(objects.values())
        if any(problem.domain.is_subtype(type_, r) for r in ranged)
    }
    return {
        name: type_ for name, type_ in objects.items() if name not in fixed and type_ not in barred
    }


def alike_objects(free: Mapping[str, str], facts: Iterable[Atom]) -> tuple[tuple[str, ...], ...]:
    """Classes of at least two free objects that are alike, each in the order of `free`.

    `facts` are all static facts and all facts of the state that are relevant.
    """
    profiles = _fact_profiles(free, facts)
    classes: dict[tuple[str, frozenset[Atom]], list[str]] = {}
    for name, type_ in free.items():
        if name in profiles:
            classes.setdefault((type_, frozenset(profiles[name])), []).append(name)
    return tuple(tuple(alike_names) for alike_names in classes.values() if len(alike_names) > 1)


def _fact_profiles(free: Mapping[str, str], facts: Iterable[Atom]) -> dict[str, set[Atom]]:
    """What the facts say about each free object, which `?` stands for; objects that a fact ties
    are left out.
    """
    profiles: dict[str, set[Atom]] = {name: set() for name in free}
    tied: set[str] = set()
    for fact in facts:
        about = {name for name in constant_names(fact) if name in free}
        if len(about) > 1:
            tied |= about
        for name in about:
            profiles[name].add(with_name(fact, name))
    return {name: facts for name, facts in profiles.items() if name not in tied}


def with_name(term: Function, name: str, other: Function = OBJECT_STAND_IN) -> Function:
    """A term with another one in the place of an object."""
    if not term.arguments:
        return other if term.name == name else term
    return Function(
        term.name,
        tuple(
            with_name(argument, name, other) if isinstance(argument, Function) else argument
            for argument in term.arguments
        ),
    )


def constant_names(term: Term) -> list[str]:
    """The names of the constants in a term. The name of an atom itself is none of them."""
    if isinstance(term, Operation):
        return constant_names(Function("", (term.left, term.right)))
    constants = list[str]()
    for argument in term.arguments if isinstance(term, Function) else ():
        if isinstance(argument, Function) and not argument.arguments:
            constants.append(argument.name)
        elif isinstance(argument, Function | Operation):
            constants += constant_names(argument)
    return constants


def _terms_mentioned(problem: Problem) -> Iterator[Term]:
    """Every term in the goals, the workflow, and the operators and rules of the domain."""
    yield from _condition_terms(problem.goal)
    for chain in problem.chains:
        yield from chain.stages
        if chain.subject is not None:
            yield Function("", (chain.subject,))
    for operator in problem.domain.operators:
        yield from _of_operator(operator)
    for deductive in problem.domain.deductive_operators:
        yield deductive.trigger.atom
        yield from _of_body(deductive.body)
        for consequence in deductive.consequences:
            yield consequence.atom
            yield from _of_body(consequence.body)
    for rule in problem.domain.rules:
        yield rule.head
        yield from _of_body(rule.body)


def _of_operator(operator: Operator) -> Iterator[Term]:
    yield from _condition_terms(operator.precondition)
    for effect in operator.effects:
        yield effect.atom
        yield from _condition_terms(effect.condition)
    yield from _of_body(operator.body)
    yield Function("", (*operator.resources, *operator.amounts))


def _of_body(body: Body) -> Iterator[Term]:
    for part in body:
        yield from _of_part(part)


def _condition_terms(condition: Condition) -> Iterator[Term]:
    for part in parts_of(condition):
        if isinstance(part, Literal | Comparison):
            yield from _of_part(part)


def _of_part(part: BodyPart) -> Iterator[Term]:
    match part:
        case Literal(atom):
            yield atom
        case Comparison(left, _, right):
            yield Function("", (left, right))


def _types_ranged_over(problem: Problem) -> set[str]:
    """The types over all of whose objects something says something: no object of them may be left
    out.

    Those are types in universal conditions, in effects with parameters, and in rules of derived
    predicates; and all types if an aggregate counts.
    """
    domain = problem.domain
    types: set[str] = set()
    for operator in domain.operators:
        types |= _universal_types(operator.precondition)
        for effect in operator.effects:
            types |= {parameter.type for parameter in effect.parameters} | _universal_types(
                effect.condition
            )
    types |= _universal_types(problem.goal)
    for rule in domain.rules:
        for literal in (Literal(rule.head), *rule.body):
            if isinstance(literal, Literal) and literal.atom.name in domain.predicates:
                types |= set(domain.predicates[literal.atom.name].arguments)
    if domain.quantities or any(
        isinstance(part, Aggregate | StateAggregate)
        for body in domain_bodies(domain)
        for part in body
    ):
        types.add("object")
    return _types_holding(domain, types)


def _universal_types(condition: Condition) -> set[str]:
    """The types of universally quantified variables; a negation counts as such a quantifier."""
    types: set[str] = set()
    for part in parts_of(condition):
        if isinstance(part, ForAll):
            types |= {parameter.type for parameter in part.parameters}
        if isinstance(part, Not):
            types |= {
                parameter.type
                for inner in parts_of(part)
                for parameter in getattr(inner, "parameters", ())
            }
    return types


def domain_bodies(domain: Domain) -> Iterator[Body]:
    """The bodies of operators, deductive operators with their consequences, and rules over
    fluents.
    """
    for operator in domain.operators:
        yield operator.body
    for deductive in domain.deductive_operators:
        yield deductive.body
        yield from (consequence.body for consequence in deductive.consequences)
    yield from (rule.body for rule in domain.rules)


def _types_holding(domain: Domain, types: set[str]) -> set[str]:
    """The types, and those of whose objects the terms of these types are made."""
    holding_types = set(types)
    while True:
        more = {
            argument
            for function in domain.functions.values()
            if any(
                domain.is_subtype(function.result, holding_type) for holding_type in holding_types
            )
            for argument in function.arguments
        }
        if more <= holding_types:
            return holding_types
        holding_types |= more


def most_at_once(domain: Domain, type_: str) -> int:
    """The most objects of a type that one step can name, and that one of its consequences can
    name beside them.
    """
    step = max(
        (_most_held(domain, operator.parameters, type_) for operator in domain.operators), default=0
    )
    follows = (c.parameters for d in domain.deductive_operators for c in d.consequences)
    return step + max(
        (_most_held(domain, consequence_parameters, type_) for consequence_parameters in follows),
        default=0,
    )


def _most_held(domain: Domain, parameters: Iterable[Parameter], type_: str) -> int:
    return sum(_may_hold(domain, parameter.type, type_) for parameter in parameters)


def _may_hold(domain: Domain, wanted: str, type_: str) -> int:
    """How many objects of `type_` a value of type `wanted` can hold."""
    if domain.is_subtype(type_, wanted):
        return 1
    made = (f for f in domain.functions.values() if domain.is_subtype(f.result, wanted))
    return max(
        (sum(_may_hold(domain, argument, type_) for argument in f.arguments) for f in made),
        default=0,
    )
