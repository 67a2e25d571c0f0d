"""Symbolic world of a run: facts that hold and workflow stages reached, moved on by steps."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

from cellwright.engine.pipelines.recovery.world_model import Move, StepAchievement, WorldState
from cellwright.engine.stages.lifted.cell_domain import StepChange
from cellwright.kb.model.plan_model import StepId
from cellwright.kb.model.planning_problem import (
    Chain,
    Listed,
    Problem,
    advance_chains,
    initial_progress,
    reached_as,
    stage_holds,
)
from cellwright.kb.terms import Atom, Function, stage_parts


@dataclass
class SymbolicWorld:
    """The facts and the stages reached, of the problem as it was when the run began.

    Steps move it on.
    """

    chains: Sequence[Chain]
    facts: set[Atom]
    reached: dict[str, int] = field(default_factory=dict)

    @classmethod
    def of(cls, problem: Problem, facts: Iterable[Atom]) -> "SymbolicWorld":
        """The world in which a problem begins."""
        known_facts = set(facts)
        reached = (
            dict(initial_progress(problem.chains, stage_holds(Listed(known_facts))))
            if problem.chains
            else {}
        )
        return cls(problem.chains, known_facts, reached)

    @property
    def state(self) -> WorldState:
        """The world as a value."""
        return WorldState(frozenset(self.facts), dict(self.reached))

    def apply(self, change: StepChange) -> tuple[Move, ...]:
        """Take in what a step changed; the stages that were reached with it."""
        self.facts -= set(change.ends)
        self.facts |= set(change.adds)
        if not self.chains:
            return ()
        before = self.reached
        self.reached, _ = advance_chains(
            self.chains, before, change.events, stage_holds(Listed(self.facts))
        )
        return tuple(self._moves(before, change.events))

    def become(self, state: WorldState) -> tuple[tuple[Atom, ...], tuple[Atom, ...]]:
        """Take another state for true; the facts that are new, and those that hold no more."""
        new, gone = state.facts - self.facts, self.facts - state.facts
        self.facts, self.reached = set(state.facts), dict(state.reached)
        return tuple(sorted(new, key=str)), tuple(sorted(gone, key=str))

    def _moves(self, before: dict[str, int], events: Sequence[Atom]) -> Iterator[Move]:
        for chain in self.chains:
            for number in range(before[chain.name], self.reached[chain.name]):
                stage = chain.stages[number]
                names = {part.name for part in stage_parts(stage)}
                named = [atom for atom in (*events, *self.facts) if atom.name in names]
                yield chain.name, number + 1, reached_as(stage, named)


def achievement_of(
    step: int, action: Function, added: Iterable[Atom], moved: Iterable[Move]
) -> StepAchievement:
    """What a step has achieved, as diagnosis wants it."""
    return StepAchievement(StepId(step), action, tuple(added), tuple(moved))
