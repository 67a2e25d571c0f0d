"""The program with which clingo finds what can be reached, if nothing that was true ever ends (relaxed reachability)."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

from cellwright.engine.stages.grounding.numeric import COMPARED, Quantities
from cellwright.engine.stages.grounding.program import (
    Conditional,
    Schema,
    Vocabulary,
    conditional_body,
    deduction_rules,
    derived_rule,
    effect_rules,
    instance_rule,
    reachable,
    rule,
)
from cellwright.kb.asp.vocabulary import static_program
from cellwright.kb.model.conditions import Body, Literal
from cellwright.kb.model.domain import Rule
from cellwright.kb.terms import Atom


@dataclass(frozen=True)
class Reachability:
    """What can be reached in a problem without quantities (`taken`): by operators, under conditions, by derived rules.

    `goals` are the alternatives of each conjunct of the goal.
    """

    taken: Quantities
    vocabulary: Vocabulary
    schemas: Sequence[Schema]
    conditionals: Sequence[Conditional]
    rules: Sequence[Rule]
    goals: Sequence[Sequence[Body]]

    def text(self, initial: Iterable[Atom]) -> Iterator[str]:
        """The statements of the program, from the atoms that are true at the start."""
        problem = self.taken.problem
        yield static_program(problem)
        yield from (f"{reachable(atom)}." for atom in initial)
        yield from self._stages()
        for schema in self.schemas:
            yield instance_rule(schema, self.vocabulary)
            yield from effect_rules(schema, self.vocabulary)
            yield from self._conditional_rules(schema)
            yield from self._comparison_rules(schema)
        yield from (derived_rule(each, self.vocabulary) for each in self.rules)
        named = {p.atom for part in self.goals for body in part for p in body if isinstance(p, Literal)}
        yield from (f"{reachable(a)}." for a in sorted(named, key=str) if a.name.startswith(COMPARED))
        yield from (r for operator in problem.domain.deductive_operators for r in deduction_rules(operator))

    def _stages(self) -> Iterator[str]:
        """The events that stages of workflows name."""
        for chain in self.taken.problem.chains:
            for stage in chain.stages:
                if stage.name in self.vocabulary.events:
                    yield f"_v_{stage.name}({', '.join(map(str, stage.arguments))})."

    def _conditional_rules(self, schema: Schema) -> Iterator[str]:
        for each in self.conditionals:
            if each.operator is schema.operator and each.effect.adds:
                yield rule(reachable(each.effect.atom), conditional_body(each, schema))

    def _comparison_rules(self, schema: Schema) -> Iterator[str]:
        """Rules for the comparisons of quantities in a schema, which are taken to be reachable wherever the rest is."""
        compared = [each.atom for each in self.taken.literals_of(schema.literals)]
        rest = tuple(each for each in schema.literals if each.atom not in compared)
        body = instance_rule(replace(schema, literals=rest), self.vocabulary).partition(" :- ")[2].rstrip(".")
        for atom in compared:
            yield rule(reachable(atom), [body] if body else [])
        for each in self.conditionals:
            inner = self.taken.literals_of(each.literals) if each.operator is schema.operator else []
            for literal in inner:
                others = tuple(p for p in each.literals if p not in inner)
                yield rule(reachable(literal.atom), conditional_body(replace(each, literals=others), schema))
