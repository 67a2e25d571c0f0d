"""Simplification: it leaves out declared types, and exceptions in deletes for atoms that the same step adds.

With fewer conditional effects, more planners and heuristics accept the export.
"""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace

from cellwright.engine.formats.interop.pddl.export.background import Background
from cellwright.engine.formats.interop.pddl.export.conditions import FALSE, conjunction, disjunction, negation
from cellwright.kb.model.conditions import (
    TRUE,
    And,
    Comparison,
    Condition,
    Exists,
    ForAll,
    Literal,
    Not,
    Or,
    Parameter,
    goal_parts,
)
from cellwright.kb.model.domain import Effect, Operator
from cellwright.kb.terms import Atom, Function, Variable, substitute_atom

Scope = Mapping[Variable, str]


class Simplifier:
    """Simplifies flat operators and conditions, given the types of their variables."""

    def __init__(self, background: Background) -> None:
        self.background = background

    def operator(self, operator: Operator) -> Operator:
        """The operator with simpler conditions; effects that cannot happen are dropped."""
        scope = _inside({}, operator.parameters)
        added = {e.atom for e in operator.effects if e.adds and not e.parameters and e.condition == TRUE}
        effects = (self._effect(_without_exceptions(e, added), scope) for e in operator.effects)
        return replace(
            operator,
            precondition=self.condition(operator.precondition, scope),
            effects=tuple(effect for effect in effects if effect.condition != FALSE),
        )

    def _effect(self, effect: Effect, scope: Scope) -> Effect:
        return replace(effect, condition=self.condition(effect.condition, _inside(scope, effect.parameters)))

    def condition(self, condition: Condition, scope: Scope) -> Condition:
        """An equivalent condition without type conditions that the declared types of its variables imply."""
        match condition:
            case Literal(Function(name, (Variable() as variable,)), positive):
                return (TRUE if positive else FALSE) if self._known(name, variable, scope) else condition
            case And(parts):
                return conjunction(self.condition(part, scope) for part in parts)
            case Or(parts):
                return disjunction(self.condition(part, scope) for part in parts)
            case Not(part):
                return negation(self.condition(part, scope))
            case Exists(parameters, part):
                inner = self.condition(part, _inside(scope, parameters))
                return FALSE if inner == FALSE else Exists(parameters, inner)
            case ForAll(parameters, part):
                inner = self.condition(part, _inside(scope, parameters))
                return TRUE if inner == TRUE else ForAll(parameters, inner)
            case _:
                return condition

    def _known(self, name: str, variable: Variable, scope: Scope) -> bool:
        known = scope.get(variable)
        return (
            name in self.background.domain.types
            and known is not None
            and self.background.is_subtype(known, name)
        )


def _without_exceptions(effect: Effect, added: Collection[Atom]) -> Effect:
    """The same delete without exceptions. That is safe for atoms that are always added, because PDDL adds after it deletes."""
    if effect.adds:
        return effect
    own = {parameter.variable for parameter in effect.parameters}
    kept = (p for p in goal_parts(effect.condition) if not _is_exception(p, effect.atom, own, added))
    return replace(effect, condition=conjunction(kept))


def _is_exception(part: Condition, atom: Atom, own: Collection[Variable], added: Collection[Atom]) -> bool:
    """Whether a condition excludes a value for which the atom is among the added ones."""
    match part:
        case Not(Comparison(left, "=", right)):
            pairs = ((left, right), (right, left))
            return any(
                isinstance(variable, Variable)
                and variable in own
                and substitute_atom(atom, {variable: value}) in added
                for variable, value in pairs
            )
        case _:
            return False


def _inside(scope: Scope, parameters: Iterable[Parameter]) -> dict[Variable, str]:
    return {**scope, **{parameter.variable: parameter.type for parameter in parameters}}
