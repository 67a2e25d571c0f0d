"""Problems in which some steps are not taken: those that use what is lost, and those that are known to fail."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace

from kb.model.conditions import And, Comparison, Condition, Or
from kb.model.domain import Operator
from kb.model.problem import Problem
from kb.terms import Function, Term, Variable


def barred(problem: Problem, lost: Collection[str] = (), blocked: Collection[Function] = ()) -> Problem:
    """The problem without the steps that use a lost resource, and without those that fit a pattern in `blocked`."""
    if not lost and not blocked:
        return problem
    gone = [Function(name) for name in sorted(lost)]
    kept = [
        _without_steps(_without_resources(each, gone), [b for b in blocked if b.name == each.name])
        for each in problem.domain.operators
        if not set(gone) & set(each.resources) and not any(_is_whole(each, pattern) for pattern in blocked)
    ]
    return replace(problem, domain=replace(problem.domain, operators=tuple(kept)))


def _is_whole(operator: Operator, pattern: Function) -> bool:
    """Whether a pattern stands for every step of an operator."""
    return pattern.name == operator.name and all(isinstance(each, Variable) for each in pattern.arguments)


def _without_resources(operator: Operator, gone: Sequence[Function]) -> Operator:
    """The operator for other resources than those that are gone."""
    return replace(operator, body=(*operator.body, *_spared(operator, gone))) if gone else operator


def _spared(operator: Operator, gone: Sequence[Function]) -> Iterator[Comparison]:
    for resource in operator.resources:
        if isinstance(resource, Variable):
            yield from (Comparison(resource, "!=", each) for each in gone)


def _without_steps(operator: Operator, patterns: Sequence[Function]) -> Operator:
    """The operator without the steps that fit a pattern: some argument is another one."""
    if not patterns:
        return operator
    others = tuple(_other(operator.variables, each.arguments) for each in patterns)
    return replace(operator, precondition=And((operator.precondition, *others)))


def _other(variables: Sequence[Variable], wanted: Sequence[Term]) -> Condition:
    named = [(v, term) for v, term in zip(variables, wanted, strict=True) if not isinstance(term, Variable)]
    found = tuple(Comparison(variable, "!=", term) for variable, term in named)
    return found[0] if len(found) == 1 else Or(found)
