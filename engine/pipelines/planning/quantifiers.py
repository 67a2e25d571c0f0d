"""Expands goals about all objects (forall) into one goal for each object."""

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import replace

from cellwright.engine.stages.validation.checker_facts import CheckerFacts
from cellwright.engine.stages.validation.condition_solving import condition_holds
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.kb.model.conditions import (
    And,
    Comparison,
    Condition,
    ForAll,
    Literal,
    Not,
    Or,
    goal_parts,
)
from cellwright.kb.model.domain_model import Kind
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Term, Variable, natural_key, substitute_atom, substitute_term

MAX_EXPANDED_GOALS = 1_000  # goals that one goal may become

Binding = Mapping[Variable, Term]


def expand_forall(problem: Problem) -> Problem:
    """The problem with "sorted(I) : item(I)" as sorted(a), sorted(b), ...; what has no such
    form stays as it is.
    """
    goals = goal_parts(problem.goal)
    if not any(isinstance(goal, ForAll) for goal in goals):
        return problem
    semantics = Semantics(problem)
    return replace(
        problem,
        goal=And(tuple(part for goal in goals for part in _expanded_goals(goal, semantics))),
    )


def _expanded_goals(goal: Condition, known: Semantics) -> tuple[Condition, ...]:
    if not isinstance(goal, ForAll):
        return (goal,)
    values = [
        sorted({atom.arguments[0] for atom in known.statics.named(parameter.type)}, key=natural_key)
        for parameter in goal.parameters
    ]
    names = [parameter.variable for parameter in goal.parameters]
    bindings = (dict(zip(names, row, strict=True)) for row in itertools.product(*values))
    try:
        expanded = [
            _bind_condition(goal.part, binding)
            for binding in itertools.islice(bindings, MAX_EXPANDED_GOALS + 1)
        ]
    except _Other:
        return (goal,)
    statics = known.facts(frozenset())
    return (
        tuple(_undecided_parts(expanded, statics, known))
        if 0 < len(expanded) <= MAX_EXPANDED_GOALS
        else (goal,)
    )


class _Other(Exception):
    """A condition with parts that are not bound here: aggregates, and conditions on some or all
    objects.
    """


def _bind_condition(condition: Condition, binding: Binding) -> Condition:
    match condition:
        case Literal(atom):
            return replace(condition, atom=substitute_atom(atom, binding))
        case Comparison(left_term, relation, right):
            return Comparison(
                substitute_term(left_term, binding), relation, substitute_term(right, binding)
            )
        case Not(part):
            return Not(_bind_condition(part, binding))
        case And(parts) | Or(parts):
            return replace(condition, parts=tuple(_bind_condition(part, binding) for part in parts))
        case _:
            raise _Other


def _undecided_parts(
    conditions: list[Condition], statics: CheckerFacts, known: Semantics
) -> Iterator[Condition]:
    """What is left of conditions when what statics decide is decided."""
    for condition in conditions:
        parts = condition.parts if isinstance(condition, Or) else (condition,)
        fixed = [part for part in parts if _is_static(part, known.problem)]
        if not any(condition_holds(part, statics, {}) for part in fixed):
            remaining_parts = tuple(part for part in parts if part not in fixed)
            yield remaining_parts[0] if len(remaining_parts) == 1 else Or(remaining_parts)


def _is_static(condition: Condition, problem: Problem) -> bool:
    match condition:
        case Literal(atom):
            predicate = problem.domain.predicates.get(atom.name)
            return atom.name in problem.domain.types or (
                predicate is not None and predicate.kind is Kind.STATIC
            )
        case Comparison():
            return True
        case Not(part):
            return _is_static(part, problem)
        case And(parts) | Or(parts):
            return all(_is_static(part, problem) for part in parts)
        case _:
            return False
