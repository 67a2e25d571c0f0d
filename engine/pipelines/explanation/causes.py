"""What would make something true: steps and consequences, each with what it needs for that, by what is static."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from cellwright.engine.stages.validation.datalog import solve
from cellwright.engine.stages.validation.semantics import Semantics
from cellwright.kb.model.conditions import (
    Body,
    BodyPart,
    Comparison,
    Condition,
    Literal,
    Parameter,
    goal_parts,
    substitute_part,
)
from cellwright.kb.model.domain import NUMERIC_TYPES, Effect, Kind, Operator
from cellwright.kb.terms import (
    Atom,
    Function,
    Substitution,
    Term,
    Variable,
    is_ground,
    match,
    substitute_atom,
)


@dataclass(frozen=True, slots=True)
class Cause:
    """A step that makes something true, or the fact itself where it follows from another one, and what it needs.

    `operator` and `bindings` are those of the step.
    """

    name: str
    needs: tuple[BodyPart, ...]
    operator: Operator | None = None
    bindings: tuple[tuple[Variable, Term], ...] = ()

    @property
    def atoms(self) -> Iterator[Atom]:
        """What has to be true."""
        return (each.atom for each in self.needs if isinstance(each, Literal) and each.positive)


def causes(semantics: Semantics, atom: Atom) -> Iterator[Cause]:
    """Every step and every deductive operator that could make an atom true."""
    for operator in semantics.problem.domain.operators:
        for effect in (each for each in operator.effects if each.adds):
            for found in _solutions(semantics, atom, effect.atom, operator.parameters, operator.body):
                needs = (*plain(operator.precondition), *plain(effect.condition))
                yield Cause(
                    str(substitute_atom(operator.header, found)),
                    tuple(substitute_part(each, found) for each in needs),
                    operator,
                    tuple((each, found[each]) for each in operator.variables if each in found),
                )
    for rule in semantics.problem.domain.deductive_operators:
        for each in (each for each in rule.consequences if each.implied):
            parameters = (*rule.parameters, *each.parameters)
            for found in _solutions(semantics, atom, each.atom, parameters, (*rule.body, *each.body)):
                trigger = Literal(substitute_atom(rule.trigger.atom, found), rule.trigger.positive)
                yield Cause(str(atom), (trigger,))


def plain(condition: Condition) -> tuple[Literal | Comparison, ...]:
    """The conjuncts of a condition that are literals or comparisons."""
    return tuple(part for part in goal_parts(condition) if isinstance(part, Literal | Comparison))


def _solutions(
    semantics: Semantics, atom: Atom, made: Atom, parameters: Iterable[Parameter], body: Body
) -> Iterator[Substitution]:
    """The values with which what is made is the atom, and the static body holds."""
    bound: dict[Variable, Term] | None = {} if made.name == atom.name else None
    for own, wanted in zip(made.arguments, atom.arguments, strict=False):
        if bound is not None and is_ground(wanted):
            bound = match(own, wanted, bound)
    if bound is not None:
        yield from solve((*_typed(semantics, parameters), *semantics.body(body)), semantics.statics, bound)


def _typed(semantics: Semantics, parameters: Iterable[Parameter]) -> tuple[Literal, ...]:
    types = semantics.problem.domain.types
    return tuple(
        Literal(Function(each.type, (each.variable,)))
        for each in parameters
        if each.type not in NUMERIC_TYPES and each.type in types
    )


@dataclass(frozen=True, slots=True)
class Company:
    """An event that a step lets happen besides another one, and under which conditions it does."""

    event: Atom
    when: tuple[BodyPart, ...]


def company(semantics: Semantics, cause: Cause) -> Iterator[Company]:
    """The events that a step lets happen, each with the condition under which it does."""
    return (each for each in happening(semantics, cause) if is_ground(each.event))


def happening(semantics: Semantics, cause: Cause) -> Iterator[Company]:
    """`company`, with the events of which a number is not known."""
    domain, bindings = semantics.problem.domain, dict(cause.bindings)
    for effect in cause.operator.effects if cause.operator is not None else ():
        if effect.adds and domain.predicates[effect.atom.name].kind is Kind.EVENT:
            for found in _happening(semantics, effect, bindings):
                when = tuple(substitute_part(each, found) for each in plain(effect.condition))
                yield Company(substitute_atom(effect.atom, found), when)


def _happening(semantics: Semantics, effect: Effect, bindings: Substitution) -> Iterator[Substitution]:
    return solve(_typed(semantics, effect.parameters), semantics.statics, dict(bindings))
