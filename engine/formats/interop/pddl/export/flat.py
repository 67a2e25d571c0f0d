"""A problem in flat terms: the whole content of a PDDL domain and problem, before it is written as text."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from cellwright.engine.formats.interop.pddl.export.background import CHAIN, NUMERAL, WORDS, Background
from cellwright.engine.formats.interop.pddl.export.conditions import Conditions, conjunction, disjunction
from cellwright.engine.formats.interop.pddl.export.operators import FlatOperator, Operators
from cellwright.engine.formats.interop.pddl.export.simplification import Simplifier
from cellwright.engine.formats.interop.pddl.export.stages import BEGIN, REACH, Stages
from cellwright.engine.model.task import Task
from cellwright.kb.model.conditions import (
    And,
    Comparison,
    Condition,
    Exists,
    ForAll,
    Literal,
    Not,
    Or,
    Parameter,
)
from cellwright.kb.model.domain import OBJECT, Operator
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Atom, Function, Term, is_ground


@dataclass(frozen=True, slots=True)
class Axiom:
    """A derived predicate with the condition that makes it true."""

    name: str
    parameters: tuple[Parameter, ...]
    condition: Condition


@dataclass(frozen=True, slots=True)
class Flat:
    """The content of an export: types with parents, objects with types, operators, axioms, facts and the goal.

    `comments` say what the PDDL leaves out.
    """

    name: str
    domain: str
    types: dict[str, str]
    objects: dict[Term, str]
    operators: tuple[Operator, ...]
    axioms: tuple[Axiom, ...]
    facts: tuple[Atom, ...]
    goal: Condition
    priced: bool
    origins: tuple[FlatOperator, ...] = ()
    comments: tuple[str, ...] = ()


def flattened(problem: Problem, task: Task) -> Flat:
    """The problem in flat terms; `task` is its ground task. Raises `NotLiftable`."""
    background = Background(problem, task)
    conditions = Conditions(background)
    stages = Stages(background, conditions.fresh)
    operators = Operators(conditions, stages)
    origins = tuple(operators.flat(operator) for operator in problem.domain.operators)
    simplifier = Simplifier(background)
    reachings = (
        replace(each, parameters=tuple(map(conditions.declared, each.parameters)))
        for each in stages.reachings()
    )
    made = (*(simplifier.operator(each.operator) for each in origins), *reachings, *stages.beginnings())
    axioms = tuple(_axioms(conditions, simplifier))
    goal = simplifier.condition(conjunction([conditions.flat(problem.goal), *stages.goals()]), {})
    names = frozenset(_predicates([*_conditions(made), *(axiom.condition for axiom in axioms), goal]))
    facts = dict.fromkeys((*operators.facts, *stages.facts(), *stages.initial(), *stages.waiting()))
    facts |= dict.fromkeys(_relations(conditions, background))
    facts |= dict.fromkeys(
        fact
        for name in sorted(names)
        if background.is_static(name)
        for fact in background.facts.get(name, ())
    )
    facts |= dict.fromkeys(atom for atom in background.initial)
    objects = dict.fromkeys((*background.terms, *_mentioned(facts), *_constants(made, goal, axioms)))
    return Flat(
        problem.name,
        problem.domain.name,
        _types(background),
        {term: background.type_of(term) for term in objects},
        made,
        axioms,
        tuple(facts),
        goal,
        operators.priced or any(operator.name.startswith((BEGIN, REACH)) for operator in made),
        origins,
        tuple(_left_out(problem)),
    )


def _types(background: Background) -> dict[str, str]:
    found = {
        name: background.plain(type_.parent) if type_.parent in background.domain.types else OBJECT
        for name, type_ in background.domain.types.items()
        if name not in background.shared
    }
    return found | {NUMERAL: OBJECT, WORDS: OBJECT, CHAIN: OBJECT}


def _axioms(conditions: Conditions, simplifier: Simplifier) -> Iterator[Axiom]:
    for name in sorted(conditions.recursive):
        types = conditions.background.signature(name)
        parameters = tuple(Parameter(conditions.fresh.variable("x"), type_) for type_ in types)
        arguments = tuple(parameter.variable for parameter in parameters)
        rules = (rule for rule in conditions.background.domain.rules if rule.head.name == name)
        condition = disjunction(conditions.body(rule, arguments) for rule in rules)
        declared = tuple(map(conditions.declared, parameters))
        known = {parameter.variable: parameter.type for parameter in declared}
        yield Axiom(name, declared, simplifier.condition(condition, known))


def _relations(conditions: Conditions, background: Background) -> Iterator[Atom]:
    """The facts of the relations that replace compound terms."""
    for term in background.terms:
        if isinstance(term, Function) and (term.name, len(term.arguments)) in conditions.functions:
            yield Function(f"_is_{term.name}", (*term.arguments, term))


def _conditions(operators: Iterable[Operator]) -> Iterator[Condition]:
    for operator in operators:
        yield operator.precondition
        yield from (effect.condition for effect in operator.effects)


def _predicates(conditions: Iterable[Condition]) -> Iterator[str]:
    return (atom.name for condition in conditions for atom in atoms(condition))


def atoms(condition: Condition) -> Iterator[Atom]:
    """Every atom in a condition."""
    match condition:
        case Literal(atom):
            yield atom
        case And(parts) | Or(parts):
            for part in parts:
                yield from atoms(part)
        case Not(part) | Exists(_, part) | ForAll(_, part):
            yield from atoms(part)
        case Comparison(left, _, right):
            yield Function("=", (left, right))
        case _:
            return


def _mentioned(facts: Iterable[Atom]) -> Iterator[Term]:
    for fact in facts:
        arguments = fact.arguments[:-1] if fact.name.startswith("_cost_") else fact.arguments
        yield from arguments


def _constants(operators: Iterable[Operator], goal: Condition, axioms: Iterable[Axiom]) -> Iterator[Term]:
    everything = [*_conditions(operators), goal, *(axiom.condition for axiom in axioms)]
    found = [atom for condition in everything for atom in atoms(condition)]
    found += [effect.atom for operator in operators for effect in operator.effects]
    return (term for atom in found for term in atom.arguments if is_ground(term))


def _left_out(problem: Problem) -> Iterator[str]:
    timed = [operator for operator in problem.domain.operators if operator.duration is not None]
    if timed:
        yield f"durations and resources are left out: {', '.join(operator.name for operator in timed)}"
