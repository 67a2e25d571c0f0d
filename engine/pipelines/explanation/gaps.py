"""What nothing in a domain can make true, on the way back from a goal that is out of reach: an operator is missing there."""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, field

from cellwright.engine.pipelines.explanation.causes import causes, plain
from cellwright.engine.pipelines.explanation.space import Space
from cellwright.engine.stages.validation.semantics import Semantics
from cellwright.kb.model.conditions import Literal
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Atom, parts_of

MOST_INSTANCES, MOST_ATOMS = 200, 300


def gaps(problem: Problem, space: Space) -> Iterator[str]:
    """A sentence for each fact that a way to the goals needs, that does not hold and that no operator makes true."""
    seeking = _Seeking(Semantics(problem), space)
    asked = (each.atom for each in plain(problem.goal) if isinstance(each, Literal) and each.positive)
    stages = (stage for chain in problem.chains if chain.wanted for stage in chain.stages)
    wanted = (part for stage in stages for part in parts_of(stage))
    for atom in (*asked, *wanted):
        yield from seeking.back_from(atom, "the goal")


@dataclass
class _Seeking:
    semantics: Semantics
    space: Space
    seen: set[Atom] = field(default_factory=set)

    def back_from(self, atom: Atom, user: str) -> Iterator[str]:
        """The gaps behind an atom that `user` needs; nothing if it is within reach."""
        if atom in self.seen or len(self.seen) > MOST_ATOMS or not self.space.misses(atom):
            return
        self.seen.add(atom)
        found = list(itertools.islice(causes(self.semantics, atom), MOST_INSTANCES))
        if not found:
            yield f"no operator makes {atom} true, and {user} needs it"
        for cause in found:
            for each in cause.atoms:
                yield from self.back_from(each, cause.name)
