"""A world that steps move on: the facts that hold, and how far the workflow is."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

from cellwright.engine.pipelines.simulation.dynamics import Move, WorldState
from cellwright.engine.pipelines.simulation.faulty import Achievement
from cellwright.engine.stages.macros.lifted.world import StepChange
from cellwright.kb.model.plan import StepId
from cellwright.kb.model.problem import Chain, Problem
from cellwright.kb.model.workflow import Listed, advanced, begun, holding, reached_as
from cellwright.kb.terms import Atom, Function, parts_of


@dataclass
class SymbolicWorld:
    """The facts and the stages reached, of the problem as it was when the run began. Steps move it on."""

    chains: Sequence[Chain]
    facts: set[Atom]
    reached: dict[str, int] = field(default_factory=dict)

    @classmethod
    def of(cls, problem: Problem, facts: Iterable[Atom]) -> "SymbolicWorld":
        """The world in which a problem begins."""
        known = set(facts)
        reached = dict(begun(problem.chains, holding(Listed(known)))) if problem.chains else {}
        return cls(problem.chains, known, reached)

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
        self.reached, _ = advanced(self.chains, before, change.events, holding(Listed(self.facts)))
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
                names = {part.name for part in parts_of(stage)}
                named = [each for each in (*events, *self.facts) if each.name in names]
                yield chain.name, number + 1, reached_as(stage, named)


def achievement(step: int, action: Function, added: Iterable[Atom], moved: Iterable[Move]) -> Achievement:
    """What a step has achieved, as diagnosis wants it."""
    return Achievement(StepId(step), action, tuple(added), tuple(moved))
