"""Progress of workflow chains: follows their stages along one order of the steps."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from cellwright.engine.stages.validation.checker_facts import CheckerFacts
from cellwright.kb.model.domain_model import Domain
from cellwright.kb.model.plan_model import INITIAL_STEP, StepId
from cellwright.kb.model.planning_problem import (
    Chain,
    final_stages,
    initial_progress,
    late_stages,
    next_stages,
    reaches_stage,
    settle_chains,
    stage_holds,
    stages_in_turn,
    those_reaching,
    too_early,
)
from cellwright.kb.terms import Atom, stage_parts

Counters = tuple[int, ...]


@dataclass(frozen=True, slots=True)
class ReachedStage:
    """A stage that is reached once a step has ended, or at the start.

    `held` are the atoms of it that held already and that the step does not add; empty if the step
    itself reaches the whole stage, by an event or by what it adds.
    """

    stage: Atom
    step: StepId
    held: tuple[Atom, ...] = ()


Trail = tuple[tuple[ReachedStage, ...], ...]  # for each chain the stages reached


class ChainProgress:
    """How far each chain has come.

    An event may belong to several chains, so all possible readings are kept.
    """

    def __init__(self, domain: Domain, chains: Sequence[Chain], state: CheckerFacts) -> None:
        self.domain, self.chains, self.state = domain, chains, state
        self.late = late_stages(chains, domain)
        self.made = {stage: INITIAL_STEP for stage in self.late if stage_holds(state)(stage)}
        self.again: list[tuple[StepId, StepId, str]] = []
        counts = initial_progress(chains, stage_holds(state))
        start = tuple(
            tuple(ReachedStage(s, INITIAL_STEP) for s in c.stages[: counts[c.name]]) for c in chains
        )
        self.readings: dict[Counters, Trail] = {tuple(map(len, start)): start}

    def step(
        self, step: StepId, events: Sequence[Atom], adds: frozenset[Atom], state: CheckerFacts
    ) -> Atom | None:
        """Move on by what a step did, to a state.

        Returns the event that no chain expects now, or the stage that is reached before its turn,
        if there is one.
        """
        if not self.chains and not events:
            self.state = state
            return None
        moved: dict[Counters, Trail] = {}
        early: Atom | None = None
        for reading, trail in self.readings.items():
            for chosen in _chains_of(events, self._waiting(reading)):
                counts = [count + (index in chosen) for index, count in enumerate(reading)]
                after = self._settled(counts, state)
                if (fault := self._early(adds, reading, after)) is not None:
                    early = fault
                    continue
                longer = tuple(
                    (*own, *self._new(chain, range(before, now), step, (*events, *adds), state))
                    for chain, own, before, now in zip(
                        self.chains, trail, reading, after, strict=True
                    )
                )
                moved.setdefault(after, longer)
        if not moved:
            return early or events[0]
        self._note(step, adds, state)
        self.readings, self.state = moved, state
        return None

    def _note(self, step: StepId, adds: frozenset[Atom], state: CheckerFacts) -> None:
        """Note the step that makes a stage hold that stays, and those that add it again: they
        come after that step.
        """
        for stage in self.late:
            if any(reaches_stage(atom, part) for atom in adds for part in stage_parts(stage)):
                if stage in self.made:
                    self.again.append((self.made[stage], step, f"{stage} is reached in its turn"))
                elif stage_holds(state)(stage):
                    self.made[stage] = step

    def _early(self, adds: frozenset[Atom], before: Counters, after: Counters) -> Atom | None:
        """The stage that stays and that a step makes true too early in a reading."""
        if not self.late:
            return None
        names = [chain.name for chain in self.chains]
        counts = (dict(zip(names, state_counts, strict=True)) for state_counts in (before, after))
        return too_early(
            self.late, adds, stage_holds(self.state), stages_in_turn(self.chains, *counts)
        )

    def _settled(self, counts: Sequence[int], state: CheckerFacts) -> Counters:
        names = [chain.name for chain in self.chains]
        settled_counts = settle_chains(
            self.chains, dict(zip(names, counts, strict=True)), stage_holds(state)
        )
        return tuple(settled_counts[name] for name in names)

    def _new(
        self, chain: Chain, numbers: range, step: StepId, done: Sequence[Atom], state: CheckerFacts
    ) -> Iterator[ReachedStage]:
        for number in numbers:
            parts = stage_parts(chain.stages[number])
            own = [part for part in parts if any(reaches_stage(atom, part) for atom in done)]
            stage_atoms = (
                atom for part in parts if part not in own for atom in those_reaching(part, state)
            )
            yield ReachedStage(chain.stages[number], step, tuple(stage_atoms))

    def _waiting(self, reading: Counters) -> dict[int, Atom]:
        """The next stage of each chain that may advance."""
        reached = dict(zip((chain.name for chain in self.chains), reading, strict=True))
        stages = next_stages(self.chains, reached)
        return {
            i: stages[chain.name] for i, chain in enumerate(self.chains) if chain.name in stages
        }

    def missing(self) -> list[str]:
        """The stages that the most advanced reading has not reached, and last fluents that no
        longer hold.
        """
        missing_stages = [
            f"{chain.stages[n]} of {chain.name}"
            for chain, n in zip(self.chains, self._best(), strict=True)
            if chain.wanted and n < len(chain.stages)
        ]
        lasting_stages = (
            last for own in final_stages(self.chains, self.domain).values() for last in own
        )
        return [
            *missing_stages,
            *(f"{last} at the end" for last in lasting_stages if last not in self.state),
        ]

    def reached(self) -> dict[str, tuple[ReachedStage, ...]]:
        """For each chain the stages for which an order matters, in the most advanced reading.

        Those that held before their step and hold at the end are left out if nothing waits for
        them: they are reached in every order.
        """
        reached_by_chain: dict[str, tuple[ReachedStage, ...]] = {}
        awaited: set[str] = set()
        for chain, own in zip(reversed(self.chains), reversed(self.trail()), strict=True):
            while own and chain.name not in awaited and self._holds_at_last(own[-1]):
                own = own[:-1]
            reached_by_chain[chain.name] = own
            if own:
                awaited.update(chain.after)
        return reached_by_chain

    def trail(self) -> Trail:
        """The stages that each chain has reached, in their order, in the most advanced reading."""
        return self.readings[self._best()]

    def _best(self) -> Counters:
        """The most advanced reading: first of what is wanted, then of all."""
        wanted_chains = [chain.wanted for chain in self.chains]
        return max(
            self.readings,
            key=lambda counts: (sum(itertools.compress(counts, wanted_chains)), sum(counts)),
        )

    def steps_of(self, name: str) -> tuple[StepId, ...]:
        """The steps with which a chain has reached its stages, in their order, in the most
        advanced reading.
        """
        place = next(n for n, chain in enumerate(self.chains) if chain.name == name)
        return tuple(reached_stage.step for reached_stage in self.trail()[place])

    def _holds_at_last(self, reached: ReachedStage) -> bool:
        return bool(reached.held) and stage_holds(self.state)(reached.stage)

    def orders(self) -> Iterator[tuple[StepId, StepId, str]]:
        """Pairs of steps that must be ordered, and why: stages of one chain, and chains after
        others.
        """
        steps = {
            name: [
                reached_stage.step
                for reached_stage in reached
                if reached_stage.step != INITIAL_STEP
            ]
            for name, reached in self.reached().items()
        }
        for chain in self.chains:
            for earlier, later in itertools.pairwise(steps[chain.name]):
                yield earlier, later, f"they reach stages of {chain.name}"
            for name in chain.after:
                if steps[name] and steps[chain.name]:
                    yield steps[name][-1], steps[chain.name][0], f"{chain.name} comes after {name}"
        yield from (pair for pair in self.again if pair[0] != INITIAL_STEP)


def _chains_of(events: Sequence[Atom], waiting: Mapping[int, Atom]) -> Iterator[frozenset[int]]:
    """Every way to assign the events to chains that wait for them, at most one event to a chain."""
    if not events:
        yield frozenset()
        return
    for index, stage in waiting.items():
        if reaches_stage(events[0], stage):
            rest = {
                other_index: waiting_chain
                for other_index, waiting_chain in waiting.items()
                if other_index != index
            }
            yield from (frozenset({index}) | chosen for chosen in _chains_of(events[1:], rest))
