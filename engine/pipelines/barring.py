"""Problems in which some steps are not taken: those that use what is lost, and those that are known to fail.

What is lost may still be put away, so that others can go on: a step that uses it is taken if all that it ends are facts about
what is lost, and if it makes something true that is not about it (a hand is empty again).
"""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace

from engine.stages.macros.lifted.schema import NotGeneral, Schemas
from engine.stages.validation.semantics import Semantics
from kb.model.conditions import And, Comparison, Condition, Or
from kb.model.domain import Operator
from kb.model.problem import Problem
from kb.terms import Function, Term, Variable


def barred(problem: Problem, lost: Collection[str] = (), blocked: Collection[Function] = ()) -> Problem:
    """The problem without the steps that use a lost resource, and without those that fit a pattern in `blocked`.

    A resource is lost with each object that is named in it. Each variable of a pattern stands for anything.
    """
    if not lost and not blocked:
        return problem
    losses = _Losses(problem, lost) if lost else None
    kept = [
        _without_steps(losses.spared(each) if losses else each, [b for b in blocked if b.name == each.name])
        for each in problem.domain.operators
        if not (losses and losses.stops(each)) and not any(_is_whole(each, pattern) for pattern in blocked)
    ]
    return replace(problem, domain=replace(problem.domain, operators=tuple(kept)))


class _Losses:
    """The terms that are lost with some objects, and what operators are without them."""

    def __init__(self, problem: Problem, lost: Collection[str]) -> None:
        self.lost = frozenset(lost)
        self.schemas = Schemas(problem.domain)
        self.statics = Semantics(problem).statics

    def stops(self, operator: Operator) -> bool:
        """Whether no step of an operator can be taken any more."""
        return any(
            self.names(each) and not self._puts_away(operator, each)
            for each in operator.resources
            if not isinstance(each, Variable)
        )

    def spared(self, operator: Operator) -> Operator:
        """The operator for other resources than those that are lost."""
        others = tuple(part for each in operator.resources for part in self._other(operator, each))
        return replace(operator, body=(*operator.body, *others)) if others else operator

    def names(self, term: Term) -> bool:
        """Whether something lost is named in a term."""
        if not isinstance(term, Function):
            return False
        named = term.name in self.lost or str(term) in self.lost
        return named or any(map(self.names, term.arguments))

    def _other(self, operator: Operator, resource: Term) -> Iterator[Comparison]:
        if not isinstance(resource, Variable) or self._puts_away(operator, resource):
            return
        type_ = next(each.type for each in operator.parameters if each.variable == resource)
        values = {atom.arguments[0] for atom in self.statics.named(type_)}
        for value in sorted(filter(self.names, values), key=str):
            yield Comparison(resource, "!=", value)

    def _puts_away(self, operator: Operator, resource: Term) -> bool:
        try:
            schema = self.schemas.named(operator.name)
        except NotGeneral:
            return False
        ends, makes = ([each.atom for each in found] for found in (schema.denies, schema.adds))
        return (
            bool(ends)
            and all(_about(a, resource) for a in ends)
            and not all(_about(a, resource) for a in makes)
        )


def _about(term: Term, resource: Term) -> bool:
    """Whether a resource is named in a term."""
    inner = term.arguments if isinstance(term, Function) else ()
    return term == resource or any(_about(each, resource) for each in inner)


def _is_whole(operator: Operator, pattern: Function) -> bool:
    """Whether a pattern stands for every step of an operator."""
    return pattern.name == operator.name and all(isinstance(each, Variable) for each in pattern.arguments)


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
