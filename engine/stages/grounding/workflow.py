"""Workflows compiled into the task: each chain has a counter, advanced by operators that reach its stages.

An event happens only as the next stage of a chain. An operator that adds the fluent of a stage may reach this
stage if the counter stands just before it. To reach a stage as soon as possible is never worse. So it is
enough that each operator has the choice to reach it, and no conditional effects are needed.
"""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from engine.model.stages import stage_atom
from engine.model.task import Bits, ConditionalEffect, bitset, indices
from engine.stages.grounding.universe import Universe
from kb.model.problem import Chain, Problem
from kb.model.workflow import lasting, reaches
from kb.terms import Atom, is_ground


def _matching(stage: Atom, universe: Universe) -> list[int]:
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


class Workflow:
    """The chains of a problem over numbered atoms.

    The counters have numbers from `first` on, after the atoms of the universe.
    """

    def __init__(self, problem: Problem, universe: Universe, first: int, events: set[str]) -> None:
        self.events = events
        self.atoms: list[Atom] = []
        self.initial = self.goal = 0
        self.groups: list[Bits] = []
        self._event_stages: dict[Atom, list[Advance]] = {}
        self._fluent_stages: dict[int, list[Advance]] = {}
        self._finished: dict[str, Bits] = {}
        self._lasting = lasting(problem.chains, problem.domain)
        for chain in problem.chains:
            self._add(chain, universe, first)
        self.reaching = bitset(list(self._fluent_stages))  # the atoms that reach a fluent stage

    def _add(self, chain: Chain, universe: Universe, first: int) -> None:
        start = first + len(self.atoms)
        self.atoms.extend(stage_atom(chain, reached) for reached in range(len(chain.stages) + 1))
        counters = [1 << (start + reached) for reached in range(len(chain.stages) + 1)]
        self.initial |= counters[0]
        self.goal |= counters[-1]
        self.groups.append(sum(counters))
        self._finished[chain.name] = counters[-1]
        waits = 0
        for earlier in chain.after:
            waits |= self._finished[earlier]
        for reached, stage in enumerate(chain.stages):
            advance = Advance(
                counters[reached] | (0 if reached else waits), counters[reached + 1], counters[reached]
            )
            if stage.name in self.events:
                self._event_stages.setdefault(stage, []).append(advance)
            else:
                reaching = _matching(stage, universe)
                for atom in reaching:
                    self._fluent_stages.setdefault(atom, []).append(advance)
                if reached + 1 == len(chain.stages) and chain.name in self._lasting:
                    self.goal |= bitset(reaching)

    def advances(
        self, events: Sequence[Atom], added: Bits, effects: Sequence[ConditionalEffect] = ()
    ) -> Iterator[Advance]:
        """The ways in which an operator with these events, adds and effects can move the counters.

        There is no way if an event belongs to no stage. A conditional effect moves a counter only where its
        condition holds.
        """
        sources = [(0, added), *((each.condition, each.adds) for each in effects)]
        if not events and not any(adds & self.reaching for _, adds in sources):
            yield Advance()
            return
        choices: list[list[Advance]] = [self._event_stages.get(event, []) for event in events]
        for condition, adds in sources:
            reached = (each for atom in indices(adds) for each in self._fluent_stages.get(atom, ()))
            choices.extend([Advance(), each | Advance(condition)] for each in reached)
        for combination in itertools.product(*choices):
            total = Advance()
            for advance in combination:
                total = total | advance
            if total.adds.bit_count() == sum(
                advance.adds.bit_count() for advance in combination
            ) and self._one_each(total):
                yield total

    def _one_each(self, advance: Advance) -> bool:
        """Whether the operator moves each counter at most once."""
        return all((group & advance.adds).bit_count() <= 1 for group in self.groups)
