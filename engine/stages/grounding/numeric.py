"""Quantities are taken out of a problem before it is grounded. `levels` puts them into the ground task at the end.

Each comparison with a quantity becomes a derived atom `_compared_n(variables)`, and the changes of operators are kept apart. So
clingo never sees the values.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.model.bindings import free_variables
from cellwright.kb.model.conditions import (
    And,
    Body,
    Comparison,
    Condition,
    Exists,
    ForAll,
    Literal,
    Not,
    Or,
    goal_parts,
)
from cellwright.kb.model.domain import Domain, Operator
from cellwright.kb.model.problem import Problem
from cellwright.kb.model.quantities import misvalued
from cellwright.kb.terms import (
    Atom,
    Function,
    Number,
    Term,
    Variable,
)

COMPARED = "_compared_"


@dataclass(frozen=True, slots=True)
class Test:
    """What the derived predicate of `head` stands for: a comparison, in which variables are the values of quantities."""

    head: Atom
    values: Mapping[Variable, Function]
    comparison: Comparison
    where: Source


@dataclass(frozen=True, slots=True)
class Setting:
    """An operator sets `quantity` to `value`, in which variables are the values of quantities."""

    quantity: Function
    value: Term
    values: Mapping[Variable, Function]


@dataclass
class Quantities:
    """The comparisons and changes of a problem, and `problem` without them."""

    problem: Problem
    tests: list[Test] = field(default_factory=list)
    settings: dict[str, list[Setting]] = field(default_factory=dict)
    initial: dict[Function, int] = field(default_factory=dict)

    def without_tests(self, body: Body) -> Body:
        """A body without the literals that stand for comparisons."""
        return tuple(p for p in body if not (isinstance(p, Literal) and p.atom.name.startswith(COMPARED)))

    def literals_of(self, literals: Sequence[Literal]) -> list[Literal]:
        """Those among some literals that stand for comparisons."""
        return [each for each in literals if each.atom.name.startswith(COMPARED)]


def without_quantities(problem: Problem) -> Quantities:
    """A problem without quantities, and what was taken out. Raises `InvalidInput` if a quantity has no single value."""
    domain = problem.domain
    if not domain.quantities:
        return Quantities(problem)
    found = Quantities(problem)
    taking = _Taking(domain, found)
    operators = tuple(map(taking.operator, domain.operators))
    plain = dataclasses.replace(
        domain,
        operators=operators,
        predicates={n: each for n, each in domain.predicates.items() if n not in domain.quantities},
        quantities={},
    )
    facts = [atom for atom in problem.initial if atom.name in domain.quantities]
    _note_values(problem, facts, found.initial)
    found.problem = dataclasses.replace(
        problem,
        domain=plain,
        initial=tuple(atom for atom in problem.initial if atom.name not in domain.quantities),
        goal=taking.condition(problem.goal, problem.where),
    )
    return found


def _note_values(problem: Problem, facts: Sequence[Atom], initial: dict[Function, int]) -> None:
    wrong: list[Diagnostic] = []
    for atom in facts:
        *rest, value = atom.arguments
        assert isinstance(value, Number)
        if (found := misvalued(atom, problem.domain.quantities[atom.name], initial)) is not None:
            wrong.append(Diagnostic(problem.where, *found))
        initial[Function(atom.name, tuple(rest))] = value.value
    if wrong:
        raise InvalidInput(wrong)


class _Taking:
    """Takes quantities out of the operators and goals of a domain."""

    def __init__(self, domain: Domain, found: Quantities) -> None:
        self.domain, self.found = domain, found

    def operator(self, operator: Operator) -> Operator:
        """The operator without quantities."""
        self.found.settings[operator.name] = [
            setting for each in operator.effects if (setting := self._setting(each.atom, each.condition))
        ]
        effects = tuple(
            dataclasses.replace(each, condition=self.condition(each.condition, operator.where))
            for each in operator.effects
            if each.atom.name not in self.domain.quantities
        )
        precondition = self.condition(operator.precondition, operator.where)
        return dataclasses.replace(operator, precondition=precondition, effects=effects)

    def _setting(self, atom: Atom, condition: Condition) -> Setting | None:
        """The change that adds a new value; None for any other effect."""
        if atom.name not in self.domain.quantities:
            return None
        *rest, value = atom.arguments
        for part in goal_parts(condition):
            if isinstance(part, Comparison) and part.relation == "=" and part.left == value:
                return Setting(Function(atom.name, tuple(rest)), part.right, self._values(condition))
        return None

    def _values(self, condition: Condition) -> dict[Variable, Function]:
        """The quantities whose values the variables of a conjunction are."""
        found = {}
        for part in goal_parts(condition):
            if isinstance(part, Literal) and part.atom.name in self.domain.quantities:
                *rest, value = part.atom.arguments
                assert isinstance(value, Variable)
                found[value] = Function(part.atom.name, tuple(rest))
        return found

    def condition(self, condition: Condition, where: Source) -> Condition:
        """The condition with derived atoms in the place of comparisons with quantities."""
        match condition:
            case Exists(_, part) if values := self._values(part):
                tests = [each for each in goal_parts(part) if isinstance(each, Comparison)]
                made = tuple(self._test(values, each, where) for each in tests)
                return made[0] if len(made) == 1 else And(made)
            case And(parts) | Or(parts):
                return type(condition)(tuple(self.condition(part, where) for part in parts))
            case Not(part):
                return Not(self.condition(part, where))
            case Exists(parameters, part) | ForAll(parameters, part):
                return type(condition)(parameters, self.condition(part, where))
            case _:
                return condition

    def _test(self, values: Mapping[Variable, Function], comparison: Comparison, where: Source) -> Literal:
        own = {v: each for v, each in values.items() if v in free_variables(comparison)}
        free = [*free_variables(comparison), *(v for q in own.values() for v in free_variables(Literal(q)))]
        outer = tuple(v for v in dict.fromkeys(free) if v not in own)
        head = Function(f"{COMPARED}{len(self.found.tests)}", outer)
        self.found.tests.append(Test(head, own, comparison, where))
        return Literal(head)
