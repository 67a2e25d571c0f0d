"""What binds the variables of conditions: quantifiers hide them; types, positive atoms and equations give them values.

See Meaning 2 in the language reference.
"""

from collections.abc import Collection, Iterable, Iterator

from cellwright.kb.model.conditions import (
    Aggregate,
    And,
    Comparison,
    Condition,
    Exists,
    ForAll,
    Literal,
    Not,
    Or,
    Parameter,
    StateAggregate,
    part_variables,
    substitute_part,
)
from cellwright.kb.terms import ANYTHING, Function, Substitution, Term, Variable, variables


def free_variables(condition: Condition) -> tuple[Variable, ...]:
    """The variables that no quantifier inside binds, each once, in order of occurrence, without `_`."""
    return tuple(dict.fromkeys(variable for variable in _free(condition) if variable != ANYTHING))


def _free(condition: Condition) -> Iterator[Variable]:
    match condition:
        case Literal() | Comparison() | Aggregate() | StateAggregate():
            yield from part_variables(condition)
        case And(parts) | Or(parts):
            for part in parts:
                yield from _free(part)
        case Not(part):
            yield from _free(part)
        case Exists(parameters, part) | ForAll(parameters, part):
            bound = {parameter.variable for parameter in parameters}
            yield from (variable for variable in _free(part) if variable not in bound)


def bind(condition: Condition, bindings: Substitution) -> Condition:
    """The condition with free variables replaced. A quantified variable hides a binding of the same name."""
    match condition:
        case Literal() | Comparison() | Aggregate() | StateAggregate():
            return substitute_part(condition, bindings)
        case And(parts) | Or(parts):
            return type(condition)(tuple(bind(part, bindings) for part in parts))
        case Not(part):
            return Not(bind(part, bindings))
        case Exists(parameters, part) | ForAll(parameters, part):
            return type(condition)(parameters, bind(part, _outside(bindings, parameters)))


def _outside(bindings: Substitution, parameters: tuple[Parameter, ...]) -> dict[Variable, Term]:
    hidden = {parameter.variable for parameter in parameters}
    return {variable: value for variable, value in bindings.items() if variable not in hidden}


def binding(term: Term) -> Iterator[Variable]:
    """The variables that a positive atom binds: those that are not inside arithmetic."""
    match term:
        case Variable():
            yield term
        case Function(_, arguments):
            for argument in arguments:
                yield from binding(argument)
        case _:
            return


def extended(parameters: Iterable[Parameter]) -> set[Variable]:
    """The parameters whose type has values that can be enumerated."""
    from cellwright.kb.model.domain import UNLISTED

    return {parameter.variable for parameter in parameters if parameter.type not in UNLISTED}


def closed(bound: Collection[Variable], parts: Iterable[Condition]) -> set[Variable]:
    """`bound`, and the variables that positive atoms, equations and counted sets among `parts` bind."""
    parts, found = tuple(parts), set(bound)
    for part in parts:
        match part:
            case Literal(atom, True):
                found.update(binding(atom))
            case Aggregate(binds=Variable() as counted):
                found.add(counted)
    equations = [part for part in parts if isinstance(part, Comparison) and part.relation == "="]
    while more := {variable for each in equations for variable in _solved(each, found)} - found:
        found |= more
    return found


def _solved(equation: Comparison, bound: set[Variable]) -> Iterator[Variable]:
    for one, other in ((equation.left, equation.right), (equation.right, equation.left)):
        if bound.issuperset(variables(one)):
            yield from binding(other)
