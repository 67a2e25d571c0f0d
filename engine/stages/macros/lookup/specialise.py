"""Specialises a MACROP: variables that stood for the same object in the original plan become one variable.

The proof of a MACROP holds for every binding, so it also holds if such variables are equal. Searches need the
special form, because it is what recurs: a robot that calibrates and takes an image does both at the same
place.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace

from cellwright.kb.model.conditions import Literal, Parameter, substitute_part
from cellwright.kb.model.macro import Macrop, MacroStep
from cellwright.kb.terms import (
    Atom,
    Function,
    Substitution,
    Term,
    Variable,
    match,
    substitute,
    substitute_atom,
)


def specialised(macrop: Macrop, operators: Sequence[Function]) -> Macrop:
    """A MACROP with one variable for each object in `operators`, the steps that it was generalised from.

    The MACROP must have no workflow chains.
    """
    bindings: dict[Variable, Term] | None = {}
    for step, operator in zip(macrop.steps, operators, strict=True):
        bindings = None if bindings is None else match(step.operator, operator, bindings)
    first: dict[Term, Variable] = {}
    for variable, term in (bindings or {}).items():
        first.setdefault(term, variable)
    return _substituted(macrop, {variable: first[term] for variable, term in (bindings or {}).items()})


def _substituted(macrop: Macrop, same: Substitution) -> Macrop:
    arguments = dict.fromkeys(substitute(each, same) for each in macrop.name.arguments)
    types = dict.fromkeys((substitute(each.variable, same), each.type) for each in macrop.types)
    return replace(
        macrop,
        name=Function(macrop.name.name, tuple(arguments)),
        goals=_literals(macrop.goals, same),
        preconditions=_literals(macrop.preconditions, same),
        adders=tuple(dict.fromkeys(_atoms(macrop.adders, same))),
        types=tuple(Parameter(variable, name) for variable, name in types if isinstance(variable, Variable)),
        constraints=tuple(dict.fromkeys(substitute_part(each, same) for each in macrop.constraints)),
        disequalities=tuple(
            dict.fromkeys(
                replace(each, left=substitute(each.left, same), right=substitute(each.right, same))
                for each in macrop.disequalities
            )
        ),
        exclusions=tuple(tuple(substitute_part(each, same) for each in body) for body in macrop.exclusions),
        resources=tuple(dict.fromkeys(substitute(each, same) for each in macrop.resources)),
        steps=tuple(_step(each, same) for each in macrop.steps),
        links=tuple(replace(each, condition=substitute_atom(each.condition, same)) for each in macrop.links),
    )


def _literals(literals: Iterable[Literal], same: Substitution) -> tuple[Literal, ...]:
    return tuple(dict.fromkeys(Literal(substitute_atom(each.atom, same), each.positive) for each in literals))


def _atoms(atoms: Iterable[Atom], same: Substitution) -> Iterable[Atom]:
    return (substitute_atom(each, same) for each in atoms)


def _step(step: MacroStep, same: Substitution) -> MacroStep:
    return replace(
        step,
        operator=substitute_atom(step.operator, same),
        resources=tuple(substitute(each, same) for each in step.resources),
        duration=substitute(step.duration, same),
        cost=substitute(step.cost, same),
    )
