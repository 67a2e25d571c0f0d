"""Which facts a proposal may remove: those that stand in the way of steps, not those that define
what the goals mean.

`broken(left)` stands in the way of a step that needs `not broken(Arm)`. `of(hole_3, plate)` says
what "every hole of the plate" means: without it the goal would be smaller, and no engineer would
propose that.
"""

from collections.abc import Collection, Iterator
from functools import cached_property

from cellwright.engine.model.plan_explanation import Edit
from cellwright.engine.pipelines.explanation.amendments import OBJECT, STATIC
from cellwright.engine.pipelines.explanation.parts_of_values import names, values
from cellwright.kb.model.conditions import Aggregate, ForAll, Literal, Not, StateAggregate
from cellwright.kb.model.domain_model import Domain
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.model.statement import Sign
from cellwright.kb.terms import Atom, Number


class Obstacles:
    """What edits of a problem an engineer could mean."""

    def __init__(self, problem: Problem) -> None:
        self.problem, self.domain = problem, problem.domain

    def sensible(self, edit: Edit) -> bool:
        """Whether an edit removes an obstacle or changes a number, and does not turn a thing
        into one of another type.
        """
        if edit.removed is None:
            return True
        if edit.layer == OBJECT:
            return edit.added is None or edit.removed.name in _ancestors(
                self.domain, edit.added.name
            )
        if edit.layer != STATIC or _changes_number(edit.added, edit.removed):
            return True
        if edit.removed.name in self._scopes:
            return False
        return edit.added is not None or edit.removed.name in self._hindering

    @cached_property
    def _hindering(self) -> frozenset[str]:
        """The static predicates that steps and rules need to be false, or from which such a one
        follows.
        """
        domain = self.domain
        conditions = (domain.operators, domain.rules, domain.defaults)
        denied = {
            part.atom.name
            for part in values(conditions)
            if isinstance(part, Literal) and not part.positive
        }
        denied |= {
            name for part in values(conditions) if isinstance(part, Not) for name in names(part)
        }
        denied |= set(names(tuple(each.body for each in domain.deductive_operators)))
        denied |= {
            name
            for rule in domain.deductive_operators
            for each in rule.consequences
            for name in names(each.body)
        }
        return self._behind(denied | self._used(Sign.NEGATIVE))

    @cached_property
    def _scopes(self) -> frozenset[str]:
        """The static predicates that say over what a condition or a goal ranges."""
        domain = self.domain
        every = [
            each
            for each in values((domain.operators, domain.rules, self.problem.goal))
            if isinstance(each, ForAll | Aggregate | StateAggregate)
        ]
        return self._behind(
            {*names(tuple(every)), *names(self.problem.goal), *self._used(Sign.COUNTED)}
        )

    def _used(self, sign: Sign) -> set[str]:
        return {
            use.predicate[0] for each in self.domain.asp for use in each.uses if use.sign is sign
        }

    def _behind(self, wanted: Collection[str]) -> frozenset[str]:
        """Predicates, with those from which rules compute them."""
        found = set(wanted)
        rules = [each for each in self.domain.asp if each.defines and each.body]
        while (
            more := {
                use.predicate[0]
                for each in rules
                if each.defines and each.defines[0] in found
                for use in each.uses
            }
            - found
        ):
            found |= more
        return frozenset(found)


def _ancestors(domain: Domain, name: str) -> Iterator[str]:
    while name in domain.types:
        name = domain.types[name].parent
        yield name


def _changes_number(added: Atom | None, removed: Atom) -> bool:
    """Whether a fact stands in place of the same one with another number."""
    return added is not None and _without_numbers(added) == _without_numbers(removed)


def _without_numbers(fact: Atom) -> tuple[object, ...]:
    return (fact.name, *(None if isinstance(each, Number) else each for each in fact.arguments))
