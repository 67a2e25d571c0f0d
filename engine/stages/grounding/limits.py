"""Upper bounds on what grounding makes: on the instances of operators and of what follows from facts."""

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from math import prod

from cellwright.engine.stages.grounding.consequences import sides
from cellwright.engine.stages.grounding.program import Schema, Vocabulary, schemas
from cellwright.kb.asp.statics import Suspect, static_suspects
from cellwright.kb.model.conditions import Aggregate, Literal, Parameter
from cellwright.kb.model.domain import NUMERIC_TYPES, OBJECT, Consequence, DeductiveOperator, Domain
from cellwright.kb.model.normalise import Normaliser
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Variable, variables

NUMBERS = 1000  # assumed number of values of a numeric variable


def suspects(problem: Problem, found: Sequence[Schema]) -> Iterator[Suspect]:
    """What may have too many instances: rules, operators and what follows from facts."""
    yield from static_suspects(problem)
    yield from _operators(problem, found)
    yield from _consequences(problem)


def size(problem: Problem) -> float:
    """An upper bound on the number of operator instances of a problem."""
    normaliser, vocabulary = Normaliser(), Vocabulary(problem.domain)
    found = list(schemas(problem.domain, normaliser, vocabulary))
    return sum(each.bound for each in _operators(problem, found))


def _operators(problem: Problem, found: Sequence[Schema]) -> Iterator[Suspect]:
    sizes = extents(problem)
    facts = Counter(fact.name for fact in problem.statics) if not problem.domain.asp else Counter[str]()
    for schema in found:
        operator = schema.operator
        values = {p.variable: sizes.get(p.type, NUMBERS) for p in operator.parameters}
        given = [
            (set(variables(part.atom)), facts[part.atom.name])
            for part in schema.static
            if isinstance(part, Literal) and part.positive and part.atom.name in facts
        ]
        counted = sum(len(set(part.standing)) for part in schema.static if isinstance(part, Aggregate))
        bound = most_bindings(values, given) * float(NUMBERS) ** counted
        yield Suspect(str(operator.header), operator.where, bound)


def most_bindings(
    values: Mapping[Variable, float], given: Collection[tuple[Collection[Variable], int]]
) -> float:
    """An upper bound on the number of bindings of variables.

    `values` is the number of values of each variable. `given` are sets of variables that a static relation
    binds together, each with the number of its facts. A set is used as long as it has fewer facts than its
    variables have combinations of values.
    """
    left, bound = dict(values), 1.0
    while True:
        saved, ways, together = max(
            ((prod(left.get(each, 1.0) for each in bound_) / ways, ways, bound_) for bound_, ways in given),
            key=lambda choice: choice[0],
            default=(0.0, 0, ()),
        )
        if saved <= 1:
            return bound * prod(left.values())
        bound *= ways
        left = {variable: count for variable, count in left.items() if variable not in together}


def _consequences(problem: Problem) -> Iterator[Suspect]:
    domain = problem.domain
    sizes = extents(problem)
    for deductive in domain.deductive_operators:
        for consequence in deductive.consequences:
            bound = max(
                prod(sizes.get(p.type, NUMBERS) for p in part) for part in _joined(deductive, consequence)
            )
            yield Suspect(f"what follows from {deductive.trigger}", deductive.where, bound)


def _joined(deductive: DeductiveOperator, consequence: Consequence) -> list[list[Parameter]]:
    """The parameters that are bound together.

    These are all parameters, or the parameters of each side where a consequence is split into two sides.
    """
    parameters = list(consequence.parameters)
    if sides(deductive, consequence) is None:
        return [parameters]
    atoms = (deductive.trigger.atom, consequence.atom)
    return [[p for p in parameters if p.variable in set(variables(atom))] for atom in atoms]


def extents(problem: Problem) -> Mapping[str, float]:
    """An upper bound on the number of values of each type.

    A numeric argument of a term counts as `NUMBERS` values.
    """
    domain = problem.domain
    own: dict[str, float] = {name: float(len(type_.constants)) for name, type_ in domain.types.items()}
    for type_name in (*domain.objects.values(), *problem.objects.values()):
        own[type_name] = own.get(type_name, 0.0) + 1
    order = list(domain.types)
    for _ in order:  # types and functions are not recursive, so one round per type is enough
        total = {
            name: sum(size for sub, size in own.items() if domain.is_subtype(sub, name)) for name in order
        }
        made = _terms(domain, total)
        grown = {name: _plain(problem, name) + made.get(name, 0.0) for name in order}
        if grown == own:
            break
        own = grown
    total = {name: sum(size for sub, size in own.items() if domain.is_subtype(sub, name)) for name in order}
    return {**total, OBJECT: sum(own.values())}


def _plain(problem: Problem, name: str) -> float:
    objects = {**problem.domain.objects, **problem.objects}
    return float(
        len(problem.domain.types[name].constants) + sum(1 for type_ in objects.values() if type_ == name)
    )


def _terms(domain: Domain, total: Mapping[str, float]) -> dict[str, float]:
    made: dict[str, float] = {}
    for function in domain.functions.values():
        size = prod(NUMBERS if a in NUMERIC_TYPES else total.get(a, NUMBERS) for a in function.arguments)
        made[function.result] = made.get(function.result, 0.0) + size
    return made
