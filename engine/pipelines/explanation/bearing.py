"""Which facts of the initial state can bear on the goals at all: nobody need try to change the others."""

from functools import cached_property

from cellwright.engine.pipelines.explanation.space import names
from cellwright.engine.stages.grounding.need import relevance
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Atom


class Bearing:
    """What the goals of a problem can need from the initial state. It leaves nothing out that they may need."""

    def __init__(self, problem: Problem) -> None:
        self.problem, self.needs = problem, relevance(problem)

    def on_goals(self, fact: Atom) -> bool:
        """Whether a fluent or a quantity at the start can matter to any goal. `_` stands for any value."""
        if fact.name in self.problem.domain.quantities:
            return fact.name in self._asked
        return fact.name in self._deciding or self.needs.concerns(fact)

    @cached_property
    def _deciding(self) -> frozenset[str]:
        """The names of facts from which it follows whether something holds that the goals can need: a default, say."""
        wanted = {each.pattern.name for each in self.needs.wanted}
        found = set[str]()
        while (
            more := {
                rule.trigger.atom.name
                for rule in self.problem.domain.deductive_operators
                if (wanted | found) & {each.atom.name for each in rule.consequences}
            }
            - found
        ):
            found |= more
        return frozenset(found)

    @cached_property
    def _asked(self) -> frozenset[str]:
        """The names that goals, rules and those operators mention which the goals can need."""
        domain = self.problem.domain
        operators = tuple(each for each in domain.operators if each.name in self.needs.bindings)
        parts = (self.problem.goal, domain.rules, domain.deductive_operators, operators)
        return frozenset(name for part in parts for name in names(part))
