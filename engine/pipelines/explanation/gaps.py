"""What nothing in a domain can make true, on the way back from a goal that is out of reach: an operator is missing there."""

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from engine.pipelines.explanation.space import Space
from engine.stages.validation.datalog import solve
from engine.stages.validation.semantics import Semantics
from kb.model.conditions import Body, Condition, Literal, Parameter, goal_parts
from kb.model.domain import NUMERIC_TYPES, Kind
from kb.model.problem import Problem
from kb.terms import Atom, Function, Substitution, Term, Variable, is_ground, match, parts_of, substitute_atom

MOST_INSTANCES, MOST_ATOMS = 200, 300
Cause = tuple[str, tuple[Atom, ...]]  # a step or a rule that would make something true, and what it needs


def gaps(problem: Problem, space: Space) -> Iterator[str]:
    """A sentence for each fact that a way to the goals needs, that does not hold and that no operator makes true."""
    seeking = _Seeking(Semantics(problem), space)
    wanted = [part for chain in problem.chains for stage in chain.stages for part in parts_of(stage)]
    for atom in (*_positive(problem.goal), *wanted):
        yield from seeking.back_from(atom, "the goal")


def _positive(condition: Condition) -> Iterator[Atom]:
    return (each.atom for each in goal_parts(condition) if isinstance(each, Literal) and each.positive)


@dataclass
class _Seeking:
    semantics: Semantics
    space: Space
    seen: set[Atom] = field(default_factory=set)

    def back_from(self, atom: Atom, user: str) -> Iterator[str]:
        """The gaps behind an atom that `user` needs; nothing if it is within reach."""
        if atom in self.seen or len(self.seen) > MOST_ATOMS or not self._is_missing(atom):
            return
        self.seen.add(atom)
        causes = list(itertools.islice(self._causes(atom), MOST_INSTANCES))
        if not causes:
            yield f"no operator makes {atom} true, and {user} needs it"
        for name, needed in causes:
            for each in needed:
                yield from self.back_from(each, name)

    def _is_missing(self, atom: Atom) -> bool:
        """Whether a fluent or event is out of reach, even if nothing is ever denied."""
        declared = self.semantics.problem.domain.predicates.get(atom.name)
        if declared is None or declared.kind not in (Kind.FLUENT, Kind.EVENT):
            return False
        name = f"{'_h' if declared.kind is Kind.EVENT else '_r'}_{atom.name}"
        rows = self.space.rows((name, len(atom.arguments)))
        return all(match(atom, Function(atom.name, row), {}) is None for row in rows)

    def _causes(self, atom: Atom) -> Iterator[Cause]:
        """Every step and every rule that could make an atom true, by what is static."""
        for operator in self.semantics.problem.domain.operators:
            for effect in (each for each in operator.effects if each.adds):
                for found in self._solutions(atom, effect.atom, operator.parameters, operator.body):
                    needed = (*_positive(operator.precondition), *_positive(effect.condition))
                    yield (
                        str(substitute_atom(operator.header, found)),
                        tuple(substitute_atom(each, found) for each in needed),
                    )
        for rule in self.semantics.problem.domain.deductive_operators:
            for each in (each for each in rule.consequences if each.implied):
                parameters = (*rule.parameters, *each.parameters)
                for found in self._solutions(atom, each.atom, parameters, (*rule.body, *each.body)):
                    trigger = substitute_atom(rule.trigger.atom, found)
                    yield str(atom), (trigger,) if rule.trigger.positive else ()

    def _solutions(
        self, atom: Atom, made: Atom, parameters: Iterable[Parameter], body: Body
    ) -> Iterator[Substitution]:
        """The values with which what is made is the atom, and the static body holds."""
        bound: dict[Variable, Term] | None = {} if made.name == atom.name else None
        for own, wanted in zip(made.arguments, atom.arguments, strict=False):
            if bound is not None and is_ground(wanted):
                bound = match(own, wanted, bound)
        if bound is None:
            return
        typed = tuple(
            Literal(Function(each.type, (each.variable,)))
            for each in parameters
            if each.type not in NUMERIC_TYPES and each.type in self.semantics.problem.domain.types
        )
        yield from solve((*typed, *self.semantics.body(body)), self.semantics.statics, bound)
