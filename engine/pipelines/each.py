"""Goals about all objects as one goal for each of them, so that one that cannot be reached does not take the others with it."""

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import replace

from cellwright.engine.stages.validation.datalog import holds
from cellwright.engine.stages.validation.facts import Facts
from cellwright.engine.stages.validation.semantics import Semantics
from cellwright.kb.model.conditions import And, Comparison, Condition, ForAll, Literal, Not, Or, goal_parts
from cellwright.kb.model.domain import Kind
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Term, Variable, natural_key, substitute, substitute_atom

MOST = 1_000  # goals that one goal may become

Binding = Mapping[Variable, Term]


def for_each(problem: Problem) -> Problem:
    """The problem with "sorted(I) : item(I)" as sorted(a), sorted(b), ...; what has no such form stays as it is."""
    goals = goal_parts(problem.goal)
    if not any(isinstance(each, ForAll) for each in goals):
        return problem
    known = Semantics(problem)
    return replace(problem, goal=And(tuple(part for goal in goals for part in _parts(goal, known))))


def _parts(goal: Condition, known: Semantics) -> tuple[Condition, ...]:
    if not isinstance(goal, ForAll):
        return (goal,)
    values = [
        sorted({atom.arguments[0] for atom in known.statics.named(each.type)}, key=natural_key)
        for each in goal.parameters
    ]
    names = [each.variable for each in goal.parameters]
    bindings = (dict(zip(names, each, strict=True)) for each in itertools.product(*values))
    try:
        found = [_bound(goal.part, each) for each in itertools.islice(bindings, MOST + 1)]
    except _Other:
        return (goal,)
    statics = known.facts(frozenset())
    return tuple(_left(found, statics, known)) if 0 < len(found) <= MOST else (goal,)


class _Other(Exception):
    """A condition with parts that are not bound here: aggregates, and conditions on some or all objects."""


def _bound(condition: Condition, binding: Binding) -> Condition:
    match condition:
        case Literal(atom):
            return replace(condition, atom=substitute_atom(atom, binding))
        case Comparison(left, relation, right):
            return Comparison(substitute(left, binding), relation, substitute(right, binding))
        case Not(part):
            return Not(_bound(part, binding))
        case And(parts) | Or(parts):
            return replace(condition, parts=tuple(_bound(each, binding) for each in parts))
        case _:
            raise _Other


def _left(found: list[Condition], statics: Facts, known: Semantics) -> Iterator[Condition]:
    """What is left of conditions when what statics decide is decided."""
    for each in found:
        parts = each.parts if isinstance(each, Or) else (each,)
        fixed = [part for part in parts if _is_static(part, known.problem)]
        if not any(holds(part, statics, {}) for part in fixed):
            others = tuple(part for part in parts if part not in fixed)
            yield others[0] if len(others) == 1 else Or(others)


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
            return all(_is_static(each, problem) for each in parts)
        case _:
            return False
