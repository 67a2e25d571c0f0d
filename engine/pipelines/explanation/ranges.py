"""Steps that no values of quantities allow: what they need is out of the range of a quantity, whatever facts there are."""

from collections.abc import Iterator
from dataclasses import dataclass

from cellwright.engine.model.quantities import UNBOUNDED, never
from cellwright.engine.pipelines.explanation.culprits import Goal, only
from cellwright.engine.stages.grounding.numeric import COMPARED, Quantities, without_quantities
from cellwright.kb.model.conditions import Comparison, Condition, Literal, goal_parts
from cellwright.kb.model.domain import Domain, Operator, Quantity
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import (
    ANYTHING,
    Atom,
    Function,
    Number,
    Operation,
    Substitution,
    Term,
    Variable,
    match,
    parts_of,
    substitute,
    substitute_atom,
    variables,
)


def out_of_range(problem: Problem, goal: Goal) -> tuple[str, ...]:
    """Why ranges rule out a goal: itself, or a sentence for each step that would reach it; none if they allow some step."""
    asked = only(problem, [goal])
    reading = _Reading(without_quantities(asked), problem.domain)
    stages = [part for chain in asked.chains if chain.wanted for part in parts_of(chain.stages[-1])]
    wanted = [each.atom for each in _atoms(reading.taken.problem.goal)]
    for atom in (*stages, *wanted):
        if found := tuple(reading.barred(atom)):
            return found
    return ()


def _atoms(condition: Condition) -> Iterator[Literal]:
    return (each for each in goal_parts(condition) if isinstance(each, Literal) and each.positive)


@dataclass(frozen=True, slots=True)
class _Reading:
    taken: Quantities
    domain: Domain

    def barred(self, atom: Atom) -> Iterator[str]:
        """A sentence for each operator that would make an atom true; none if ranges allow one, or facts imply the atom."""
        if atom.name.startswith(COMPARED):
            yield from (f"{needed} cannot be: {within}" for needed, within in self._missed(atom))
            return
        rules = self.domain.deductive_operators
        found = [None for rule in rules for each in rule.consequences if each.atom.name == atom.name]
        reasons = [*found, *(self._reason(*each) for each in self._makers(atom))]
        if None not in reasons:
            yield from dict.fromkeys(each for each in reasons if each)

    def _makers(self, atom: Atom) -> Iterator[tuple[Operator, Substitution]]:
        for operator in self.taken.problem.domain.operators:
            for effect in (e for e in operator.effects if e.adds and e.atom.name == atom.name):
                if (bound := match(effect.atom, atom, {})) is not None:
                    yield operator, bound

    def _reason(self, operator: Operator, bound: Substitution) -> str | None:
        """What an instance of an operator needs that no value of a quantity gives; None if there is no such thing."""
        header = substitute_atom(substitute_atom(operator.header, bound), _any(operator.header))
        needs = (substitute_atom(each.atom, bound) for each in _atoms(operator.precondition))
        missed = (each for atom in needs if atom.name.startswith(COMPARED) for each in self._missed(atom))
        return next((f"{header} needs {needed}, and {within}" for needed, within in missed), None)

    def _missed(self, atom: Atom) -> Iterator[tuple[Comparison, str]]:
        """A comparison that never holds, with the ranges that rule it out."""
        test = next(each for each in self.taken.tests if each.head.name == atom.name)
        inner = match(test.head, atom, {}) or {}
        left, right = (substitute(each, inner) for each in (test.comparison.left, test.comparison.right))
        ranges = {v: self.domain.quantities[each.name] for v, each in test.values.items()}
        if never(test.comparison.relation, *_interval(Operation("-", left, right), ranges)):
            named = {v: substitute_atom(each, inner) for v, each in test.values.items()}
            needed = Comparison(substitute(left, named), test.comparison.relation, substitute(right, named))
            yield needed, ", ".join(f"{named[v]} is within {_said(each)}" for v, each in ranges.items())


def _any(header: Function) -> Substitution:
    return {each: ANYTHING for each in variables(header)}


def _said(bounds: Quantity) -> str:
    return "..".join("" if end is None else str(end) for end in (bounds.low, bounds.high))


def _interval(term: Term, ranges: dict[Variable, Quantity]) -> tuple[int, int]:
    """The least and the greatest value of a sum of quantities; anything else may have every value."""
    match term:
        case Number(value):
            return value, value
        case Variable() if term in ranges:
            bounds = ranges[term]
            low = -UNBOUNDED if bounds.low is None else bounds.low
            return low, UNBOUNDED if bounds.high is None else bounds.high
        case Operation("+" | "-" | "*" as sign, left, right):
            (a, b), (c, d) = _interval(left, ranges), _interval(right, ranges)
            if sign == "*":
                products = [a * c, a * d, b * c, b * d]
                return min(products), max(products)
            return (a + c, b + d) if sign == "+" else (a - d, b - c)
        case _:
            return -UNBOUNDED, UNBOUNDED
