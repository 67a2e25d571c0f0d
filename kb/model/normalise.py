"""Brings conditions into disjunctive normal form over literals.

Universal conditions become derived predicates. `forall X: phi` holds if no X violates phi. So a new predicate
collects the violations and must be false (Lloyd & Topor 1984). Its supports are found like those of any
derived predicate.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, field

from cellwright.kb.model.bindings import bind, free_variables
from cellwright.kb.model.conditions import (
    And,
    BodyPart,
    Comparison,
    Condition,
    Exists,
    ForAll,
    Literal,
    Not,
    Or,
    Parameter,
)
from cellwright.kb.model.domain import BUILT_IN_TYPES, OBJECT, Rule
from cellwright.kb.terms import Function, Variable

Disjunct = tuple[BodyPart, ...]
NEGATED = {"=": "!=", "!=": "=", "<": ">=", ">=": "<", ">": "<=", "<=": ">"}


@dataclass
class Normaliser:
    """Turns conditions into disjuncts, and collects the rules of the new predicates."""

    rules: list[Rule] = field(default_factory=list)
    prefix: str = "_violated"
    _counter: Iterator[int] = field(default_factory=itertools.count)

    def disjuncts(self, condition: Condition, types: dict[Variable, str]) -> list[Disjunct]:
        """The alternatives of `condition`; `types` are those of its free variables."""
        return self._positive(condition, types)

    def _positive(self, condition: Condition, types: dict[Variable, str]) -> list[Disjunct]:
        match condition:
            case And(parts):
                return _product([self._positive(part, types) for part in parts])
            case Or(parts):
                return [disjunct for part in parts for disjunct in self._positive(part, types)]
            case Not(part):
                return self._negative(part, types)
            case Exists(parameters, part):
                parameters, part = self._renamed_apart(parameters, part)
                inner = {**types, **{p.variable: p.type for p in parameters}}
                guards = tuple(
                    type_literal(p) for p in parameters if p.type not in BUILT_IN_TYPES or p.type == OBJECT
                )
                return [(*guards, *disjunct) for disjunct in self._positive(part, inner)]
            case ForAll(parameters, part):
                return [(self._no(Exists(parameters, Not(part)), types),)]
            case _:
                return [(condition,)]

    def _renamed_apart(
        self, parameters: tuple[Parameter, ...], part: Condition
    ) -> tuple[tuple[Parameter, ...], Condition]:
        """The same part with variables that occur nowhere else, because disjuncts join their variables."""
        fresh = {p.variable: Variable(f"{p.variable}__{next(self._counter)}") for p in parameters}
        return tuple(Parameter(fresh[p.variable], p.type) for p in parameters), bind(part, fresh)

    def _negative(self, condition: Condition, types: dict[Variable, str]) -> list[Disjunct]:
        match condition:
            case Literal(atom, positive):
                return [(Literal(atom, not positive),)]
            case Comparison(left, relation, right):
                return [(Comparison(left, NEGATED[relation], right, condition.exact),)]
            case And(parts):
                return [disjunct for part in parts for disjunct in self._negative(part, types)]
            case Or(parts):
                return _product([self._negative(part, types) for part in parts])
            case Not(part):
                return self._positive(part, types)
            case ForAll(parameters, part):
                return self._positive(Exists(parameters, Not(part)), types)
            case _:
                return [(self._no(condition, types),)]

    def _no(self, condition: Condition, types: dict[Variable, str]) -> Literal:
        """The literal that is true when `condition` is false for the values of its free variables."""
        parameters = [
            Parameter(variable, types.get(variable, OBJECT)) for variable in free_variables(condition)
        ]
        head = Function(
            f"{self.prefix}_{len(self.rules)}_{len(parameters)}", tuple(p.variable for p in parameters)
        )
        guards = tuple(
            type_literal(p) for p in parameters if p.type not in BUILT_IN_TYPES or p.type == OBJECT
        )
        self.rules.append(Rule(head, ()))  # keeps the name unique while inner conditions are compiled
        own = len(self.rules) - 1
        alternatives = self._positive(condition, types)
        self.rules[own : own + 1] = [Rule(head, (*guards, *body)) for body in alternatives]
        return Literal(head, positive=False)


def _product(choices: list[list[Disjunct]]) -> list[Disjunct]:
    found: list[Disjunct] = [()]
    for alternatives in choices:
        found = [(*before, *after) for before in found for after in alternatives]
    return found


def type_literal(parameter: Parameter) -> Literal:
    """`type(Variable)`."""
    return Literal(Function(parameter.type, (parameter.variable,)))
