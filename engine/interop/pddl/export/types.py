"""Conditions that a declared type says already are left out."""

from collections.abc import Iterable, Mapping
from dataclasses import replace

from engine.interop.pddl.export.conditions import FALSE, conjunction, disjunction, negation
from engine.interop.pddl.export.world import World
from kb.model.conditions import TRUE, And, Condition, Exists, ForAll, Literal, Not, Or, Parameter
from kb.model.domain import Effect, Operator
from kb.terms import Function, Variable

Scope = Mapping[Variable, str]


class TypedScopes:
    """Simplifies what is flat, given the types of the variables around it."""

    def __init__(self, world: World) -> None:
        self.world = world

    def operator(self, operator: Operator) -> Operator:
        """The operator with simpler conditions; effects that cannot happen are dropped."""
        scope = _inside({}, operator.parameters)
        effects = (self._effect(effect, scope) for effect in operator.effects)
        return replace(
            operator,
            precondition=self.condition(operator.precondition, scope),
            effects=tuple(effect for effect in effects if effect.condition != FALSE),
        )

    def _effect(self, effect: Effect, scope: Scope) -> Effect:
        return replace(effect, condition=self.condition(effect.condition, _inside(scope, effect.parameters)))

    def condition(self, condition: Condition, scope: Scope) -> Condition:
        """An equivalent condition without the types that its variables have anyway."""
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
        return name in self.world.domain.types and known is not None and self.world.is_subtype(known, name)


def _inside(scope: Scope, parameters: Iterable[Parameter]) -> dict[Variable, str]:
    return {**scope, **{parameter.variable: parameter.type for parameter in parameters}}
