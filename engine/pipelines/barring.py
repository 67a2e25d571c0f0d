"""Problems in which some steps are not taken: those that use what is lost, and those that are known to fail.

What is lost may still be put away, so that others can go on: a step that uses it is taken if all that it ends are facts about
what is lost, and if it makes something true that is not about it (a hand is empty again). Or if all that it does is to carry what is
lost from one place to another: a gripper takes a broken plate off the shaker.
"""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace

from cellwright.engine.stages.macros.lifted.deduction import Following, NotGeneral
from cellwright.engine.stages.macros.lifted.schema import OperatorSchema, Schemas
from cellwright.engine.stages.validation.semantics import Semantics
from cellwright.kb.model.conditions import And, Comparison, Condition, Literal, Or
from cellwright.kb.model.domain import Operator
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Function, Term, Variable


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
            self.names(each) and not self._may(operator, each, each)
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
        if not isinstance(resource, Variable):
            return
        type_ = next(each.type for each in operator.parameters if each.variable == resource)
        values = {atom.arguments[0] for atom in self.statics.named(type_)}
        for value in sorted(filter(self.names, values), key=str):
            if not self._may(operator, resource, value):
                yield Comparison(resource, "!=", value)

    def _may(self, operator: Operator, resource: Term, lost: Term) -> bool:
        """Whether steps may still use what is lost as this resource."""
        try:
            schema = self.schemas.named(operator.name)
        except NotGeneral:
            return False
        if _puts_away(schema, resource):
            return True
        return len(operator.resources) > 1 and _carries(schema, resource, lost) and not self._acts(lost)

    def _acts(self, value: Term) -> bool:
        """Whether something does steps by itself, as an arm that moves: such a thing is not carried."""
        return any(
            self._can_be(each, each.resources[0], value)
            for each in self.schemas.domain.operators
            if len(each.resources) == 1
        )

    def _can_be(self, operator: Operator, resource: Term, value: Term) -> bool:
        types = [each.type for each in operator.parameters if each.variable == resource]
        known = (atom.arguments[0] for type_ in types for atom in self.statics.named(type_))
        return resource == value or value in known


def _puts_away(schema: OperatorSchema, resource: Term) -> bool:
    ends, makes = ([each.atom for each in found] for found in (schema.denies, schema.adds))
    return (
        bool(ends) and all(_about(a, resource) for a in ends) and not all(_about(a, resource) for a in makes)
    )


def _carries(schema: OperatorSchema, resource: Term, lost: Term) -> bool:
    """Whether all that a step changes is where a thing is, and whether the places and hands that it leaves or comes to are free."""
    ends = [each.atom for each in schema.denies if _can_follow(each, resource, lost)]
    makes = [each.atom for each in schema.adds if _can_follow(each, resource, lost)]
    left = {each.name for each in ends if _about(each, resource)}
    come_to = {each.name for each in makes if _about(each, resource)}
    held = (part.atom for body in schema.alternatives for part in body if isinstance(part, Literal))
    about = [each for each in (*ends, *makes, *held) if _about(each, resource)]
    places = {argument for each in about for argument in each.arguments}
    others = [each for each in (*ends, *makes) if not _about(each, resource)]
    events = schema.events or schema.batches
    return (
        bool(come_to)
        and come_to <= left
        and not events
        and all(a.arguments and places.issuperset(a.arguments) for a in others)
    )


def _can_follow(effect: Following, resource: Term, lost: Term) -> bool:
    """Whether an effect can come about for this thing: what is said of the lid alone does not for a probe."""
    equal = (part for part in effect.guard if isinstance(part, Comparison) and part.relation == "=")
    sides = ((part.left, part.right) for part in equal)
    named = (other for one, two in sides for this, other in ((one, two), (two, one)) if this == resource)
    return all(isinstance(each, Variable) or each == lost for each in named)


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
