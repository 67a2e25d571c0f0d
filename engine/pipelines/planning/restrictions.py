"""Makes a problem without the steps that use lost resources, and without steps that failed.

What is lost may still be put away, so that others can go on: a step that uses it is taken if all
that it ends are facts about what is lost, and if it makes something true that is not about it (a
hand is empty again). Or if all that it does is to carry what is lost from one place to another: a
gripper takes a broken plate off the shaker.
"""

import itertools
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

from cellwright.engine.model.motion_values import Unmoved
from cellwright.engine.stages.lifted.operator_schemas import (
    GuardedAtom,
    NotGeneral,
    OperatorSchema,
    OperatorSchemas,
)
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.kb.model.conditions import And, Comparison, Condition, Literal, Or
from cellwright.kb.model.domain_model import Operator
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import ANYTHING, Atom, Function, Term, Variable, is_ground, match_term


@dataclass(frozen=True, slots=True)
class _ForbiddenSteps:
    """The steps that fit a pattern, forbidden while some facts hold. Each variable of the pattern
    stands for anything.
    """

    pattern: Function
    while_true: tuple[Atom, ...] = ()

    def are_all(self) -> bool:
        """Whether these are all steps of an operator, at any time."""
        return not self.while_true and all(
            isinstance(argument, Variable) for argument in self.pattern.arguments
        )


def forbid_steps(
    problem: Problem, lost: Collection[str] = (), blocked: Collection[Function] = ()
) -> Problem:
    """The problem without the steps that use a lost resource, and without those that fit a pattern
    in `blocked`.

    A resource is lost with each object that is named in it. Each variable of a pattern stands for
    anything.
    """
    if not lost and not blocked:
        return problem
    losses = _Losses(problem, lost) if lost else None
    spelt_out = (spelt for pattern in blocked for spelt in _spelt_out(problem, pattern))
    left_operators = [
        losses.spared(operator) if losses else operator
        for operator in problem.domain.operators
        if not (losses and losses.stops(operator))
    ]
    return _remove_steps(problem, left_operators, map(_ForbiddenSteps, spelt_out))


def _spelt_out(problem: Problem, pattern: Function) -> Iterator[Function]:
    """A pattern for each value that fits an argument with variables inside a term: a condition
    cannot say `slot(furnace, _)`.
    """
    inner = [not isinstance(each, Variable) and not is_ground(each) for each in pattern.arguments]
    operator = next((each for each in problem.domain.operators if each.name == pattern.name), None)
    if not any(inner) or operator is None:
        yield pattern
        return
    statics = Semantics(problem).statics
    choices = [
        sorted(
            {a.arguments[0] for a in statics.named(parameter.type) if _fits(term, a.arguments[0])},
            key=str,
        )
        if partly
        else [term]
        for term, partly, parameter in zip(
            pattern.arguments, inner, operator.parameters, strict=True
        )
    ]
    yield from (Function(pattern.name, arguments) for arguments in itertools.product(*choices))


def _fits(pattern: Term, value: Term) -> bool:
    one, other = Function("_", (pattern,)), Function("_", (value,))
    return match_term(one, other, {}) is not None


class _Losses:
    """The terms that are lost with some objects, and what operators are without them."""

    def __init__(self, problem: Problem, lost: Collection[str]) -> None:
        self.lost = frozenset(lost)
        self.schemas = OperatorSchemas(problem.domain)
        self.statics = Semantics(problem).statics

    def stops(self, operator: Operator) -> bool:
        """Whether no step of an operator can be taken any more."""
        return any(
            self.names(resource) and not self._may(operator, resource, resource)
            for resource in operator.resources
            if not isinstance(resource, Variable)
        )

    def spared(self, operator: Operator) -> Operator:
        """The operator for other resources than those that are lost."""
        other_conditions = tuple(
            part for resource in operator.resources for part in self._other(operator, resource)
        )
        return (
            replace(operator, body=(*operator.body, *other_conditions))
            if other_conditions
            else operator
        )

    def names(self, term: Term) -> bool:
        """Whether something lost is named in a term."""
        if not isinstance(term, Function):
            return False
        named = term.name in self.lost or str(term) in self.lost
        return named or any(map(self.names, term.arguments))

    def _other(self, operator: Operator, resource: Term) -> Iterator[Comparison]:
        if not isinstance(resource, Variable):
            return
        type_ = next(
            parameter.type for parameter in operator.parameters if parameter.variable == resource
        )
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
        return (
            len(operator.resources) > 1
            and _is_transport(schema, resource, lost)
            and not self._acts(lost)
        )

    def _acts(self, value: Term) -> bool:
        """Whether something does steps by itself, as an arm that moves: such a thing is not
        carried.
        """
        return any(
            self._can_be(operator, operator.resources[0], value)
            for operator in self.schemas.domain.operators
            if len(operator.resources) == 1
        )

    def _can_be(self, operator: Operator, resource: Term, value: Term) -> bool:
        types = [
            parameter.type for parameter in operator.parameters if parameter.variable == resource
        ]
        typed_objects = (atom.arguments[0] for type_ in types for atom in self.statics.named(type_))
        return resource == value or value in typed_objects


def _puts_away(schema: OperatorSchema, resource: Term) -> bool:
    ends, makes = (
        [literal.atom for literal in literals_of_effect]
        for literals_of_effect in (schema.denies, schema.adds)
    )
    return (
        bool(ends)
        and all(_mentions_resource(a, resource) for a in ends)
        and not all(_mentions_resource(a, resource) for a in makes)
    )


def _is_transport(schema: OperatorSchema, resource: Term, lost: Term) -> bool:
    """Whether all that a step changes is where a thing is, and whether the places and hands
    that it leaves or comes to are free.
    """
    ends = [literal.atom for literal in schema.denies if _can_follow(literal, resource, lost)]
    makes = [literal.atom for literal in schema.adds if _can_follow(literal, resource, lost)]
    left_names = {ended.name for ended in ends if _mentions_resource(ended, resource)}
    come_to = {begun.name for begun in makes if _mentions_resource(begun, resource)}
    held_atoms = (
        part.atom for body in schema.alternatives for part in body if isinstance(part, Literal)
    )
    about = [atom for atom in (*ends, *makes, *held_atoms) if _mentions_resource(atom, resource)]
    places = {argument for atom in about for argument in atom.arguments}
    other_atoms = [atom for atom in (*ends, *makes) if not _mentions_resource(atom, resource)]
    events = schema.events or schema.batches
    return (
        bool(come_to)
        and come_to <= left_names
        and not events
        and all(a.arguments and places.issuperset(a.arguments) for a in other_atoms)
    )


def _can_follow(effect: GuardedAtom, resource: Term, lost: Term) -> bool:
    """Whether an effect can come about for this thing: what is said of the lid alone does not
    for a probe.
    """
    equal = (part for part in effect.guard if isinstance(part, Comparison) and part.relation == "=")
    sides = ((part.left, part.right) for part in equal)
    named = (
        opposite
        for own_side, two in sides
        for this, opposite in ((own_side, two), (two, own_side))
        if this == resource
    )
    return all(isinstance(term, Variable) or term == lost for term in named)


def _mentions_resource(term: Term, resource: Term) -> bool:
    """Whether a resource is named in a term."""
    inner = term.arguments if isinstance(term, Function) else ()
    return term == resource or any(_mentions_resource(inner_term, resource) for inner_term in inner)


def forbid_unreachable_steps(problem: Problem, refused: Iterable[Unmoved]) -> Problem:
    """The problem in which no refused step is taken while the facts hold that its motion failed
    under.
    """
    return _remove_steps(problem, problem.domain.operators, map(_unreachable_steps, refused))


def _unreachable_steps(unmoved: Unmoved) -> _ForbiddenSteps:
    """All steps that have no motion for the same reason as a refused one."""
    arguments = tuple(
        ANYTHING if place in unmoved.regardless else value
        for place, value in enumerate(unmoved.operator.arguments)
    )
    return _ForbiddenSteps(Function(unmoved.operator.name, arguments), tuple(unmoved.while_true))


def _remove_steps(
    problem: Problem, operators: Iterable[Operator], forbidden: Iterable[_ForbiddenSteps]
) -> Problem:
    """The problem with these operators, and without those of their steps that are forbidden."""
    forbidden_of: dict[str, list[_ForbiddenSteps]] = {}
    for steps in forbidden:
        forbidden_of.setdefault(steps.pattern.name, []).append(steps)
    kept_operators = (
        _without_steps(operator, forbidden_of.get(operator.name, ())) for operator in operators
    )
    kept = tuple(operator for operator in kept_operators if operator is not None)
    return replace(problem, domain=replace(problem.domain, operators=kept))


def _without_steps(operator: Operator, forbidden: Sequence[_ForbiddenSteps]) -> Operator | None:
    """The operator without its forbidden steps; None if nothing is left of it."""
    if any(steps.are_all() for steps in forbidden):
        return None
    if not forbidden:
        return operator
    conditions = (_excluding_condition(operator.variables, steps) for steps in forbidden)
    return replace(operator, precondition=And((operator.precondition, *conditions)))


def _excluding_condition(variables: Sequence[Variable], steps: _ForbiddenSteps) -> Condition:
    """That a step is none of these: some argument is another one, or a fact does not hold."""
    differences: tuple[Condition, ...] = (
        *(
            Comparison(variable, "!=", value)
            for variable, value in zip(variables, steps.pattern.arguments, strict=True)
            if not isinstance(value, Variable)
        ),
        *(Literal(fact, positive=False) for fact in steps.while_true),
    )
    return differences[0] if len(differences) == 1 else Or(differences)


def refusal_sentence(refused: Iterable[Unmoved]) -> str:
    """What has no motion, and why, as one sentence for people."""
    return "; ".join(f"{unmoved.operator} has no motion: {unmoved.reason}" for unmoved in refused)
