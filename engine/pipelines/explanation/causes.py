"""Finds what would make a fact true: steps and consequences, each with what it needs."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from cellwright.engine.stages.validation.condition_solving import solve_conditions
from cellwright.engine.stages.validation.operator_semantics import Semantics
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
from cellwright.kb.model.domain_model import NUMERIC_TYPES, Effect, Kind, Operator
from cellwright.kb.terms import (
    Atom,
    Function,
    Substitution,
    Term,
    Variable,
    is_ground,
    match_term,
    substitute_atom,
)


@dataclass(frozen=True, slots=True)
class PossibleCause:
    """A step that makes something true, or the fact itself where it follows from another one, and
    what it needs.

    `operator` and `bindings` are those of the step.
    """

    name: str
    needs: tuple[BodyPart, ...]
    operator: Operator | None = None
    bindings: tuple[tuple[Variable, Term], ...] = ()

    @property
    def atoms(self) -> Iterator[Atom]:
        """What has to be true."""
        return (need.atom for need in self.needs if isinstance(need, Literal) and need.positive)


def find_causes(semantics: Semantics, atom: Atom) -> Iterator[PossibleCause]:
    """Every step and every deductive operator that could make an atom true."""
    for operator in semantics.problem.domain.operators:
        for effect in (effect for effect in operator.effects if effect.adds):
            for solution in _cause_bindings(
                semantics, atom, effect.atom, operator.parameters, operator.body
            ):
                needs = (
                    *plain_conjuncts(operator.precondition),
                    *plain_conjuncts(effect.condition),
                )
                yield PossibleCause(
                    str(substitute_atom(operator.header, solution)),
                    tuple(substitute_part(need, solution) for need in needs),
                    operator,
                    tuple(
                        (variable, solution[variable])
                        for variable in operator.variables
                        if variable in solution
                    ),
                )
    for rule in semantics.problem.domain.deductive_operators:
        for implication in (
            consequence for consequence in rule.consequences if consequence.implied
        ):
            parameters = (*rule.parameters, *implication.parameters)
            for solution_entry in _cause_bindings(
                semantics, atom, implication.atom, parameters, (*rule.body, *implication.body)
            ):
                trigger = Literal(
                    substitute_atom(rule.trigger.atom, solution_entry), rule.trigger.positive
                )
                yield PossibleCause(str(atom), (trigger,))


def plain_conjuncts(condition: Condition) -> tuple[Literal | Comparison, ...]:
    """The conjuncts of a condition that are literals or comparisons."""
    return tuple(part for part in goal_parts(condition) if isinstance(part, Literal | Comparison))


def _cause_bindings(
    semantics: Semantics, atom: Atom, made_atom: Atom, parameters: Iterable[Parameter], body: Body
) -> Iterator[Substitution]:
    """The values with which what is made is the atom, and the static body holds."""
    bound: dict[Variable, Term] | None = {} if made_atom.name == atom.name else None
    for own, wanted_argument in zip(made_atom.arguments, atom.arguments, strict=False):
        if bound is not None and is_ground(wanted_argument):
            bound = match_term(own, wanted_argument, bound)
    if bound is not None:
        yield from solve_conditions(
            (*_type_literals(semantics, parameters), *semantics.body(body)),
            semantics.statics,
            bound,
        )


def _type_literals(semantics: Semantics, parameters: Iterable[Parameter]) -> tuple[Literal, ...]:
    types = semantics.problem.domain.types
    return tuple(
        Literal(Function(parameter.type, (parameter.variable,)))
        for parameter in parameters
        if parameter.type not in NUMERIC_TYPES and parameter.type in types
    )


@dataclass(frozen=True, slots=True)
class CompanionEvent:
    """An event that a step lets happen besides another one, and under which conditions it does."""

    event: Atom
    when: tuple[BodyPart, ...]


def ground_companions(semantics: Semantics, cause: PossibleCause) -> Iterator[CompanionEvent]:
    """The events that a step lets happen, each with the condition under which it does."""
    return (
        companion
        for companion in possible_companions(semantics, cause)
        if is_ground(companion.event)
    )


def possible_companions(semantics: Semantics, cause: PossibleCause) -> Iterator[CompanionEvent]:
    """`company`, with the events of which a number is not known."""
    domain, bindings = semantics.problem.domain, dict(cause.bindings)
    for effect in cause.operator.effects if cause.operator is not None else ():
        if effect.adds and domain.predicates[effect.atom.name].kind is Kind.EVENT:
            for solution in _effect_bindings(semantics, effect, bindings):
                when = tuple(
                    substitute_part(condition, solution)
                    for condition in plain_conjuncts(effect.condition)
                )
                yield CompanionEvent(substitute_atom(effect.atom, solution), when)


def _effect_bindings(
    semantics: Semantics, effect: Effect, bindings: Substitution
) -> Iterator[Substitution]:
    return solve_conditions(
        _type_literals(semantics, effect.parameters), semantics.statics, dict(bindings)
    )
