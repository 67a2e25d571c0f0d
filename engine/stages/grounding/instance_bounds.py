"""Upper bounds on what grounding makes: operator instances, and what follows from facts."""

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from math import prod

from cellwright.engine.stages.grounding.atom_deduction import split_sides
from cellwright.engine.stages.grounding.grounding_program import (
    ChangingPredicates,
    Schema,
    precondition_schemas,
)
from cellwright.kb.asp.static_facts import Suspect, static_suspects
from cellwright.kb.model.condition_forms import Normaliser
from cellwright.kb.model.conditions import Aggregate, Literal, Parameter
from cellwright.kb.model.domain_model import (
    NUMERIC_TYPES,
    OBJECT_TYPE,
    Consequence,
    DeductiveOperator,
    Domain,
)
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Variable, term_variables

ASSUMED_NUMBER_VALUES = 1000  # assumed number of values of a numeric variable


def size_suspects(problem: Problem, operator_schemas: Sequence[Schema]) -> Iterator[Suspect]:
    """What may have too many instances: rules, operators and what follows from facts."""
    yield from static_suspects(problem)
    yield from _operator_suspects(problem, operator_schemas)
    yield from _consequence_suspects(problem)


def bound_instances(problem: Problem) -> float:
    """An upper bound on the number of operator instances of a problem."""
    normaliser, vocabulary = Normaliser(), ChangingPredicates(problem.domain)
    operator_schemas = list(precondition_schemas(problem.domain, normaliser, vocabulary))
    return sum(suspect.bound for suspect in _operator_suspects(problem, operator_schemas))


def _operator_suspects(problem: Problem, operator_schemas: Sequence[Schema]) -> Iterator[Suspect]:
    sizes = bound_type_sizes(problem)
    facts = (
        Counter(fact.name for fact in problem.statics) if not problem.domain.asp else Counter[str]()
    )
    for schema in operator_schemas:
        operator = schema.operator
        values = {p.variable: sizes.get(p.type, ASSUMED_NUMBER_VALUES) for p in operator.parameters}
        fact_counts = [
            (set(term_variables(part.atom)), facts[part.atom.name])
            for part in schema.static
            if isinstance(part, Literal) and part.positive and part.atom.name in facts
        ]
        counted = sum(
            len(set(part.standing)) for part in schema.static if isinstance(part, Aggregate)
        )
        bound = most_bindings(values, fact_counts) * float(ASSUMED_NUMBER_VALUES) ** counted
        yield Suspect(str(operator.header), operator.where, bound)


def most_bindings(
    values: Mapping[Variable, float], fact_counts: Collection[tuple[Collection[Variable], int]]
) -> float:
    """An upper bound on the number of bindings of variables.

    `values` is the number of values of each variable. `given` are sets of variables that a static
    relation binds together, each with the number of its facts. A set is used as long as it has
    fewer facts than its variables have combinations of values.
    """
    values_left, bound = dict(values), 1.0
    while True:
        saved, ways, together = max(
            (
                (prod(values_left.get(variable, 1.0) for variable in bound_) / ways, ways, bound_)
                for bound_, ways in fact_counts
            ),
            key=lambda choice: choice[0],
            default=(0.0, 0, ()),
        )
        if saved <= 1:
            return bound * prod(values_left.values())
        bound *= ways
        values_left = {
            variable: count for variable, count in values_left.items() if variable not in together
        }


def _consequence_suspects(problem: Problem) -> Iterator[Suspect]:
    domain = problem.domain
    sizes = bound_type_sizes(problem)
    for deductive in domain.deductive_operators:
        for consequence in deductive.consequences:
            bound = max(
                prod(sizes.get(p.type, ASSUMED_NUMBER_VALUES) for p in part)
                for part in _joint_parameters(deductive, consequence)
            )
            yield Suspect(f"what follows from {deductive.trigger}", deductive.where, bound)


def _joint_parameters(
    deductive: DeductiveOperator, consequence: Consequence
) -> list[list[Parameter]]:
    """The parameters that are bound together.

    These are all parameters, or the parameters of each side where a consequence is split into two
    sides.
    """
    parameters = list(consequence.parameters)
    if split_sides(deductive, consequence) is None:
        return [parameters]
    atoms = (deductive.trigger.atom, consequence.atom)
    return [[p for p in parameters if p.variable in set(term_variables(atom))] for atom in atoms]


def bound_type_sizes(problem: Problem) -> Mapping[str, float]:
    """An upper bound on the number of values of each type.

    A numeric argument of a term counts as `NUMBERS` values.
    """
    domain = problem.domain
    own: dict[str, float] = {
        name: float(len(type_.constants)) for name, type_ in domain.types.items()
    }
    for type_name in (*domain.objects.values(), *problem.objects.values()):
        own[type_name] = own.get(type_name, 0.0) + 1
    order = list(domain.types)
    for _ in order:  # types and functions are not recursive, so one round per type is enough
        total = {
            name: sum(size for sub, size in own.items() if domain.is_subtype(sub, name))
            for name in order
        }
        counts = _count_terms(domain, total)
        grown = {name: _plain_type_size(problem, name) + counts.get(name, 0.0) for name in order}
        if grown == own:
            break
        own = grown
    total = {
        name: sum(size for sub, size in own.items() if domain.is_subtype(sub, name))
        for name in order
    }
    return {**total, OBJECT_TYPE: sum(own.values())}


def _plain_type_size(problem: Problem, name: str) -> float:
    objects = {**problem.domain.objects, **problem.objects}
    return float(
        len(problem.domain.types[name].constants)
        + sum(1 for type_ in objects.values() if type_ == name)
    )


def _count_terms(domain: Domain, total: Mapping[str, float]) -> dict[str, float]:
    counts: dict[str, float] = {}
    for function in domain.functions.values():
        size = prod(
            ASSUMED_NUMBER_VALUES if a in NUMERIC_TYPES else total.get(a, ASSUMED_NUMBER_VALUES)
            for a in function.arguments
        )
        counts[function.result] = counts.get(function.result, 0.0) + size
    return counts
