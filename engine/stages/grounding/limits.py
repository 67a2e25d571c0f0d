"""Protection against groundings that grow without bound.

A problem that may have too many instances is first grounded on trial, under limits of time and memory.
"""

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import prod

from engine.stages.grounding.consequences import sides
from engine.stages.grounding.program import (
    Schema,
    Vocabulary,
    deduction_rules,
    effect_rules,
    instance_rule,
    reachable,
    rule,
    schemas,
)
from kb.asp.trial import affordable
from kb.asp.vocabulary import guard, static_program
from kb.diagnostics import Diagnostic, InvalidInput, Source
from kb.model.conditions import Literal, Parameter
from kb.model.domain import NUMERIC_TYPES, OBJECT, Consequence, DeductiveOperator, Domain
from kb.model.normalise import Normaliser
from kb.model.problem import Problem
from kb.terms import Variable, variables

SUSPICIOUS = 5_000_000  # a larger upper bound on instances leads to a trial
NUMBERS = 1000  # assumed number of values of a numeric variable


@dataclass(frozen=True, slots=True)
class Suspect:
    """An operator, rule or consequence with an upper bound on the number of its instances.

    The bound is infinite for rules that count.
    """

    what: str
    where: Source
    bound: float


def require_affordable(problem: Problem, found: list[Schema], vocabulary: Vocabulary) -> None:
    """Raises `InvalidInput` if grounding would exceed the limits of a trial.

    There is no trial if every upper bound is small.
    """
    require_affordable_statics(problem)
    suspects = [*_operators(problem, found), *_consequences(problem)]
    _require(suspects, lambda: "\n".join(_program(problem, found, vocabulary)))


def require_affordable_statics(problem: Problem) -> None:
    """The same check for the static facts and rules alone, which are all that the checker needs."""
    _require(list(_rules(problem)), lambda: static_program(problem))


def size(problem: Problem) -> float:
    """An upper bound on the number of operator instances of a problem."""
    normaliser, vocabulary = Normaliser(), Vocabulary(problem.domain)
    found = list(schemas(problem.domain, normaliser, vocabulary))
    return sum(each.bound for each in _operators(problem, found))


def _require(suspects: Sequence[Suspect], program: Callable[[], str]) -> None:
    suspects = [each for each in suspects if each.bound > SUSPICIOUS]
    if not suspects or affordable(program()):
        return
    worst = max(suspects, key=lambda each: each.bound)
    count = "no upper bound" if worst.bound == float("inf") else f"up to {worst.bound:.0e} instances"
    message = (
        f"grounding exceeds its limit of time or memory; the most likely cause is {worst.what} ({count})"
    )
    raise InvalidInput(
        [Diagnostic(worst.where, "K307", message, "constrain its variables with types or static facts")]
    )


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
        yield Suspect(str(operator.header), operator.where, most_bindings(values, given))


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


def _rules(problem: Problem) -> Iterator[Suspect]:
    domain = problem.domain
    everything = sum(1 for _ in (*domain.objects, *problem.objects)) + len(problem.statics)
    for each in domain.asp:
        names = set(each.variables)
        bound = float("inf") if each.counts and names else float(everything) ** len(names)
        yield Suspect(each.text, each.where, bound)


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


def _program(problem: Problem, found: list[Schema], vocabulary: Vocabulary) -> Iterator[str]:
    """The program of the trial.

    It derives what can be reached from the given facts and all defaults, and every pair of a trigger and a
    consequence that cannot be split into two sides.
    """
    yield static_program(problem)
    yield from (f"{reachable(fact)}." for fact in problem.initial)
    for default in problem.domain.defaults:
        yield rule(reachable(default.atom), [*guard(default.parameters), *map(str, default.body)])
    for chain in problem.chains:
        yield from (f"_v_{stage}." for stage in chain.stages if stage.name in vocabulary.events)
    for schema in found:
        yield instance_rule(schema, vocabulary)
        yield from effect_rules(schema, vocabulary)
    for number, deductive in enumerate(problem.domain.deductive_operators):
        yield from deduction_rules(deductive)
        for place, consequence in enumerate(deductive.consequences):
            if sides(deductive, consequence) is not None:
                continue
            atoms = [reachable(deductive.trigger.atom), reachable(consequence.atom)]
            body = [*atoms, *guard(consequence.parameters), *map(str, (*deductive.body, *consequence.body))]
            yield rule(f"_pair_{number}_{place}({deductive.trigger.atom}, {consequence.atom})", body)
