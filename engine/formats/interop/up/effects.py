"""Translation of unified-planning effects into effects of the model."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement

from unified_planning import model as up

from cellwright.engine.formats.interop.up.conditions import ConditionTranslator, Locals, Unsupported
from cellwright.kb.model.bindings import bind
from cellwright.kb.model.conditions import (
    TRUE,
    And,
    Comparison,
    Condition,
    Exists,
    Literal,
    Not,
    Parameter,
    goal_parts,
)
from cellwright.kb.model.domain import Effect
from cellwright.kb.terms import Atom, Function, Term, Variable, substitute, substitute_atom


@dataclass(frozen=True, slots=True)
class Assignment:
    """The assignment of a value to a fluent of objects, for every binding of `parameters` that satisfies `condition`.

    `place` is the fluent without its value.
    """

    place: Atom
    value: Term
    type: str
    parameters: tuple[Parameter, ...]
    condition: Condition


class EffectTranslator:
    """Translates the effects of one action. Its `precondition` may name the values that fluents have before."""

    def __init__(self, conditions: ConditionTranslator, precondition: Condition) -> None:
        self.conditions, self.assignments = conditions, list[Assignment]()
        self._given = [
            p.atom for p in goal_parts(precondition) if isinstance(p, Literal) and p.positive
        ]  # conditions that hold before

    def effects(self, effects: Sequence[up.Effect]) -> tuple[Effect, ...]:
        """All effects. Assignments are also stored, for `consistency`. Raises `Unsupported`."""
        return tuple(each for effect in effects for each in self._effect(effect))

    def _effect(self, effect: up.Effect) -> Iterator[Effect]:
        if not effect.is_assignment():
            raise Unsupported(f"the numeric effect {effect}")
        found = Locals(list(self.conditions.quantified(effect.forall)))
        condition = self.conditions.condition(effect.condition) if effect.is_conditional() else TRUE
        atom = self.conditions.atom(effect.fluent, found)
        if effect.fluent.fluent().type.is_bool_type():
            yield from self._truth(atom, effect.value, found, condition)
        else:
            yield from self._assign(atom, effect, found, condition)

    def _truth(self, atom: Atom, value: up.FNode, found: Locals, condition: Condition) -> Iterator[Effect]:
        """The effects that make a fluent true, false, or equal to the value that an expression had."""
        parameters = tuple(found.parameters)
        if value.is_bool_constant():
            yield Effect(atom, value.bool_constant_value(), parameters, _all(*found.literals, condition))
            return
        for truth in (True, False):
            reason = self.conditions.condition(value, truth)
            yield Effect(atom, truth, parameters, _all(*found.literals, condition, reason))

    def _assign(
        self, place: Atom, effect: up.Effect, found: Locals, condition: Condition
    ) -> Iterator[Effect]:
        """Add the new value and delete every other value, or only the former value if it is known."""
        value, type_ = (
            self.conditions.term(effect.value, found),
            self.conditions.type(effect.fluent.fluent().type),
        )
        parameters, condition = tuple(found.parameters), _all(*found.literals, condition)
        self.assignments.append(Assignment(place, value, type_, parameters, condition))
        yield Effect(_with(place, value), True, parameters, condition)
        former = [
            atom for atom in self._given if atom.name == place.name and atom.arguments[:-1] == place.arguments
        ]
        if former:
            yield Effect(former[0], False, parameters, condition)
            return
        other = self.conditions.fresh(place.name)
        differs = Comparison(other, "!=", value)
        yield Effect(
            _with(place, other), False, (*parameters, Parameter(other, type_)), _all(condition, differs)
        )

    def consistency(self) -> Iterator[Condition]:
        """Conditions that no two assignments give a fluent different values. If they would, the action is not applicable."""
        for one, other in combinations_with_replacement(self.assignments, 2):
            if one.place.name == other.place.name and (one is not other or one.parameters):
                yield self._agree(one, other)

    def _agree(self, one: Assignment, other: Assignment) -> Condition:
        apart: dict[Variable, Term] = {
            p.variable: self.conditions.fresh(p.variable.name) for p in other.parameters
        }
        renamed = tuple(Parameter(v, p.type) for p, v in zip(other.parameters, apart.values(), strict=True))  # type: ignore[arg-type]
        place, value = substitute_atom(other.place, apart), substitute(other.value, apart)
        same = (Comparison(a, "=", b) for a, b in zip(one.place.arguments, place.arguments, strict=True))
        differs = Comparison(one.value, "!=", value)
        clash = _all(one.condition, bind(other.condition, apart), *same, differs)
        parameters = (*one.parameters, *renamed)
        return Not(Exists(parameters, clash) if parameters else clash)


def _with(place: Atom, value: Term) -> Atom:
    return Function(place.name, (*place.arguments, value))


def _all(*parts: Condition) -> Condition:
    kept = tuple(part for part in parts if part != TRUE)
    return kept[0] if len(kept) == 1 else And(kept)
