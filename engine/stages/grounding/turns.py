"""Stages of fluents that stay, as measurements do: an operator makes them true in their turn or not at all.

An operator that completes such a stage needs that a chain waits for it, or that it does not complete the stage: it holds
already, or another part of it does not. Each way is a condition of its own.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from cellwright.engine.kernels.bits import indices
from cellwright.engine.model.task import Bits, bitset
from cellwright.engine.stages.grounding.closure import Deduction
from cellwright.engine.stages.grounding.derived import Rules
from cellwright.engine.stages.grounding.universe import Universe
from cellwright.engine.stages.grounding.workflow import Advance, Course, Workflow, matching
from cellwright.kb.model.domain import Domain, Operator
from cellwright.kb.model.workflow import late_stages, reaches
from cellwright.kb.terms import Atom, Function, Number, parts_of

Signed = tuple[int, ...]
ConditionalChange = tuple[
    Signed, Bits, Bits
]  # the conditions of a conditional effect, what it adds and what it deletes


@dataclass
class Turns:
    """Which atoms wait for their turn. `rules` gets the derived atoms for those that operators add under conditions."""

    domain: Domain
    workflow: Workflow
    universe: Universe
    initial: Bits
    deduction: Deduction
    changes: Mapping[tuple[str, Signed], Sequence[ConditionalChange]]
    rules: Rules
    held: Bits = 0  # the atoms that complete a stage whose turn may be to come
    _stages: dict[int, list[tuple[Course, int]]] = field(default_factory=dict)
    _late: dict[int, list[Atom]] = field(default_factory=dict)
    _allowed: dict[tuple[int, Signed], int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._courses = {course.chain.name: course for course in self.workflow.courses}
        chains = [course.chain for course in self.workflow.courses]
        for stage in late_stages(chains, self.domain):
            for atom in self._atoms_of(stage):
                self._late.setdefault(atom, []).append(stage)
        self.held = bitset(self._late) & ~self.initial
        self.names = {self.universe.atoms[atom].name for atom in indices(self.held)}
        for course in self.workflow.courses if self.held else ():
            for number, stage in enumerate(course.chain.stages):
                for atom in self._atoms_of(stage):
                    self._stages.setdefault(atom, []).append((course, number))
        for operator, arguments in self.changes if self.held else ():
            for atom, conditions in self._conditional(operator, arguments):
                self._allow(atom, conditions)

    def _atoms_of(self, stage: Atom) -> list[int]:
        return list(dict.fromkeys(n for part in parts_of(stage) for n in matching(part, self.universe)))

    def concerns(self, operator: Operator) -> bool:
        """Whether instances of an operator may add an atom that waits for its turn."""
        if not self.held:
            return False
        implied = {
            c.atom.name for each in self.domain.deductive_operators for c in each.consequences if c.implied
        }
        return bool(self.names & (implied | {effect.atom.name for effect in operator.effects if effect.adds}))

    def conditions(self, operator: str, arguments: Signed) -> list[int]:
        """What an instance needs in addition because of what it adds under conditions."""
        if not self.held:
            return []
        return list(dict.fromkeys(self._allowed[each] for each in self._conditional(operator, arguments)))

    def _conditional(self, operator: str, arguments: Signed) -> Iterator[tuple[int, Signed]]:
        """The atoms that wait for their turn and that an instance adds under conditions, with these."""
        for conditions, adds, _ in self.changes.get((operator, arguments), ()):
            before = bitset(each for each in conditions if 0 <= each < len(self.universe.atoms))
            added, _ = self.deduction.close(adds, before)
            yield from ((atom, conditions) for atom in indices(added & self.held))

    def _allow(self, atom: int, conditions: Signed) -> None:
        if (atom, conditions) in self._allowed:
            return
        name = Function("_turn", (self.universe.atoms[atom], Number(len(self._allowed))))
        number = self._allowed[atom, conditions] = self.universe.derive(name)
        self.rules[number] = [*((~each,) for each in conditions), *self._ways(atom, 1 << atom, Advance())]

    def ways(self, adds: Bits, advance: Advance) -> list[Signed]:
        """The conditions, as signed atoms, of which one must hold so that an operator may add some atoms."""
        choices = [self._ways(atom, adds, advance) for atom in indices(adds & self.held)]
        return [tuple(dict.fromkeys(itertools.chain(*each))) for each in itertools.product(*choices)]

    def _ways(self, atom: int, adds: Bits, advance: Advance) -> list[Signed]:
        """Those for one atom: it serves a stage that a chain waits for, or completes none."""
        found = [way for place in self._stages.get(atom, ()) for way in self._in_turn(*place, adds, advance)]
        apart = itertools.product(*(self._apart(stage, atom) for stage in self._late[atom]))
        return list(dict.fromkeys([*found, *(tuple(itertools.chain(*each)) for each in apart)]))

    def _in_turn(self, course: Course, stage: int, adds: Bits, advance: Advance) -> Iterator[Signed]:
        """When a chain waits for a stage as a step ends, which may reach the stages before this one as well."""
        own = self._come_to(course, stage, adds, advance)
        if stage or not course.waits:
            yield from own
            return
        awaited = [self._courses[name] for name in course.chain.after]
        ends = (self._come_to(each, len(each.chain.stages), adds, advance) for each in awaited)
        yield from (tuple(itertools.chain(*way)) for way in itertools.product(own, *ends))

    def _come_to(self, course: Course, count: int, adds: Bits, advance: Advance) -> Iterator[Signed]:
        """When a chain has reached so many stages as a step ends."""
        if advance.adds & course.counters[count]:
            yield ()
            return
        yield tuple(indices(course.counters[count]))
        if count and self._reaches(course.chain.stages[count - 1], adds):
            yield from self._in_turn(course, count - 1, adds, advance)

    def _reaches(self, stage: Atom, adds: Bits) -> bool:
        return all(bitset(matching(part, self.universe)) & adds for part in parts_of(stage))

    def _apart(self, stage: Atom, atom: int) -> Iterator[Signed]:
        """The ways in which an atom does not complete a stage."""
        own = [part for part in parts_of(stage) if reaches(self.universe.atoms[atom], part)]
        for part in parts_of(stage):
            if part not in own:
                yield tuple(~each for each in matching(part, self.universe))
        yield from itertools.product(*(matching(part, self.universe) for part in own))
