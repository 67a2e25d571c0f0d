"""Workflows compiled into the task: each chain has a counter, advanced by operators that reach its stages.

An event happens only as the next stage of some chain. A fluent stage is reached where the fluent holds: an internal
operator without cost moves the counter then. To reach it as soon as possible is never worse, and plans do
(`cellwright.engine.model.replay`), so that it is no choice of the operators that add the fluent.
"""

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

from cellwright.engine.model.stages import reaching, stage_atom
from cellwright.engine.model.task import Bits, GroundOperator, bitset
from cellwright.engine.stages.grounding.goals import Counted
from cellwright.engine.stages.grounding.universe import Universe
from cellwright.kb.model.problem import Chain, Problem
from cellwright.kb.model.workflow import Holds, begun, lasting, reaches
from cellwright.kb.terms import Atom, is_ground, parts_of


def matching(stage: Atom, universe: Universe) -> list[int]:
    """The atoms that reach a fluent stage; `_` in the stage matches everything."""
    if is_ground(stage):
        return [universe.index[stage]] if stage in universe.index else []
    return [number for atom, number in universe.index.items() if reaches(atom, stage)]


@dataclass(frozen=True, slots=True)
class Advance:
    """The conditions and effects that an operator gets in addition when it reaches certain stages."""

    conditions: Bits = 0
    adds: Bits = 0
    deletes: Bits = 0

    def __or__(self, other: "Advance") -> "Advance":
        return Advance(
            self.conditions | other.conditions, self.adds | other.adds, self.deletes | other.deletes
        )


@dataclass(frozen=True, slots=True)
class Course:
    """A chain, the bit of each count of its stages, and the last bits of the chains that it waits for."""

    chain: Chain
    counters: tuple[Bits, ...]
    waits: Bits


class Workflow:
    """The chains of a problem over numbered atoms.

    The counters have numbers from `first` on, after the atoms of the universe.
    """

    def __init__(
        self, problem: Problem, universe: Universe, first: int, events: set[str], start: Holds
    ) -> None:
        self.events = events
        self.atoms: list[Atom] = []
        self.initial = self.goal = 0
        self.groups: list[Bits] = []
        self.courses: list[Course] = []
        self.reaching: list[GroundOperator] = []
        self._event_stages: dict[Atom, list[Advance]] = {}
        self._finished: dict[str, Bits] = {}
        self._lasting = lasting(problem.chains, problem.domain)
        self._domain, self.begun = problem.domain, begun(problem.chains, start)
        for chain in problem.chains:
            self._add(chain, self.begun[chain.name], universe, first)

    def _add(self, chain: Chain, count: int, universe: Universe, first: int) -> None:
        start = first + len(self.atoms)
        self.atoms.extend(stage_atom(chain, reached) for reached in range(len(chain.stages) + 1))
        counters = tuple(1 << (start + reached) for reached in range(len(chain.stages) + 1))
        self.initial |= counters[count]
        self.goal |= counters[-1] if chain.wanted else 0
        self.groups.append(sum(counters))
        self._finished[chain.name] = counters[-1]
        waits = 0
        for earlier in chain.after:
            waits |= self._finished[earlier]
        self.courses.append(Course(chain, counters, waits))
        for reached, stage in enumerate(chain.stages):
            needed = counters[reached] | (0 if reached else waits)
            advance = Advance(needed, counters[reached + 1], counters[reached])
            if stage.name in self.events:
                self._event_stages.setdefault(stage, []).append(advance)
            else:
                found = [matching(part, universe) for part in parts_of(stage)]
                self._reach(advance, chain, reached + 1, itertools.product(*found))
        if chain.name in self._lasting:
            for last in self._lasting[chain.name]:
                self.goal |= bitset(matching(last, universe))

    def counted(self, universe: Universe) -> Iterator[tuple[str, Counted]]:
        """Each chain that waits for no other one, with what has to hold at the end if it is cut after so many stages."""
        for course in self.courses:
            chain, ends = course.chain, [0]
            for number in range(1, len(chain.stages) + 1):
                cut = replace(chain, stages=chain.stages[:number], after=())
                atoms = (
                    n
                    for last in lasting([cut], self._domain).values()
                    for each in last
                    for n in matching(each, universe)
                )
                ends.append(bitset(atoms))
            yield chain.name, Counted(course.counters, self.begun[chain.name], tuple(ends))

    def _reach(self, advance: Advance, chain: Chain, count: int, choices: Iterable[tuple[int, ...]]) -> None:
        """The internal operators that move a chain to a count while all atoms of some choice hold."""
        name = reaching(chain, count)
        for atoms in choices:
            needed = advance.conditions | bitset(atoms)
            self.reaching.append(GroundOperator(name, needed, advance.adds, advance.deletes, cost=0))

    def advances(self, events: Sequence[Atom]) -> Iterator[Advance]:
        """The ways in which an operator with these events can move the counters; none if an event has no stage."""
        choices = [self._event_stages.get(event, []) for event in events]
        for combination in itertools.product(*choices):
            total = Advance()
            for advance in combination:
                total = total | advance
            if total.adds.bit_count() == len(combination) and self._one_each(total):
                yield total

    def stages_of(self, event: Atom) -> Sequence[Advance]:
        """How each stage that an event is, in whatever chain, moves the chain's counter."""
        return self._event_stages.get(event, ())

    def _one_each(self, advance: Advance) -> bool:
        """Whether the operator moves each counter at most once."""
        return all((group & advance.adds).bit_count() <= 1 for group in self.groups)
