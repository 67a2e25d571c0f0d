"""Follows the stages of a workflow along one order of the steps."""

import itertools
from collections.abc import Iterator, Mapping, Sequence

from engine.stages.validation.datalog import Facts
from kb.model.domain import Domain
from kb.model.plan import StepId
from kb.model.problem import Chain
from kb.model.workflow import lasting, next_stages, reaches
from kb.terms import Atom

Counters = tuple[int, ...]


Trail = tuple[tuple[StepId, ...], ...]  # for each chain, the steps that reached its stages


class ChainProgress:
    """How far each chain has come.

    An event may belong to several chains, so all possible readings are kept.
    """

    def __init__(self, domain: Domain, chains: Sequence[Chain]) -> None:
        self.domain, self.chains = domain, chains
        self.readings: dict[Counters, Trail] = {tuple(0 for _ in chains): tuple(() for _ in chains)}

    def step(self, step: StepId, events: Sequence[Atom], adds: frozenset[Atom]) -> Atom | None:
        """Advance by what a step did. Returns an event that no chain expects now; None if there is none."""
        moved: dict[Counters, Trail] = {}
        for reading, trail in self.readings.items():
            waiting = self._waiting(reading)
            reached = {index for index, stage in waiting.items() if any(reaches(a, stage) for a in adds)}
            for chosen in _chains_of(events, waiting):
                after = tuple(n + (i in reached or i in chosen) for i, n in enumerate(reading))
                moved.setdefault(after, _extended(trail, reading, after, step))
        if not moved:
            return events[0]
        self.readings = moved
        return None

    def _waiting(self, reading: Counters) -> dict[int, Atom]:
        """The next stage of each chain that may advance."""
        reached = dict(zip((chain.name for chain in self.chains), reading, strict=True))
        stages = next_stages(self.chains, reached)
        return {i: stages[chain.name] for i, chain in enumerate(self.chains) if chain.name in stages}

    def missing(self, state: Facts) -> list[str]:
        """The stages that the most advanced reading has not reached, and last fluents that no longer hold."""
        best = max(self.readings, key=sum)
        found = [
            f"{chain.stages[n]} of {chain.name}"
            for chain, n in zip(self.chains, best, strict=True)
            if n < len(chain.stages)
        ]
        wanted = lasting(self.chains, self.domain).values()
        return [*found, *(f"{last} at the end" for last in wanted if last not in state)]

    def orders(self) -> Iterator[tuple[StepId, StepId, str]]:
        """Pairs of steps that must be ordered, and why: stages of one chain, or of chains that follow each
        other.
        """
        trail = self.readings[max(self.readings, key=sum)]
        steps = dict(zip((chain.name for chain in self.chains), trail, strict=True))
        for chain in self.chains:
            for earlier, later in itertools.pairwise(steps[chain.name]):
                yield earlier, later, f"they reach stages of {chain.name}"
            for name in chain.after:
                if steps[name] and steps[chain.name]:
                    yield steps[name][-1], steps[chain.name][0], f"{chain.name} comes after {name}"


def _chains_of(events: Sequence[Atom], waiting: Mapping[int, Atom]) -> Iterator[frozenset[int]]:
    """Every way to assign the events to chains that wait for them, at most one event to a chain."""
    if not events:
        yield frozenset()
        return
    for index, stage in waiting.items():
        if reaches(events[0], stage):
            rest = {other: each for other, each in waiting.items() if other != index}
            yield from (frozenset({index}) | chosen for chosen in _chains_of(events[1:], rest))


def _extended(trail: Trail, before: Counters, after: Counters, step: StepId) -> Trail:
    return tuple((*t, step) if a > b else t for t, b, a in zip(trail, before, after, strict=True))
