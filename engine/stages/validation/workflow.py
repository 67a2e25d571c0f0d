"""The stages of a workflow, followed along one order of the steps."""

import itertools
from collections.abc import Iterator, Sequence

from kb.model.domain import Domain, Kind
from kb.model.plan import StepId
from kb.model.problem import Chain, superseded
from kb.terms import Atom, is_ground, match

Counters = tuple[int, ...]


Trail = tuple[tuple[StepId, ...], ...]  # for each chain the steps that reached its stages


class Stages:
    """How far each chain has come. An event may belong to several chains, so every possible reading is kept."""

    def __init__(self, domain: Domain, chains: Sequence[Chain]) -> None:
        self.chains = chains
        self.kinds = {name: predicate.kind for name, predicate in domain.predicates.items()}
        self.readings: dict[Counters, Trail] = {tuple(0 for _ in chains): tuple(() for _ in chains)}

    def step(self, step: StepId, events: Sequence[Atom], adds: frozenset[Atom]) -> Atom | None:
        """Move on by what a step did; the event that no chain expects now, if there is one."""
        moved: dict[Counters, Trail] = {}
        for reading, trail in self.readings.items():
            for each in self._events(reading, events):
                after = self._fluents(reading, each, adds)
                moved.setdefault(after, _extended(trail, reading, after, step))
        if not moved:
            return events[0]
        self.readings = moved
        return None

    def _events(self, reading: Counters, events: Sequence[Atom]) -> Iterator[Counters]:
        if not events:
            yield reading
            return
        for index, chain in enumerate(self.chains):
            if self._next(reading, index) == events[0] and self._may_start(reading, chain, index):
                yield from self._events(_advanced(reading, index), events[1:])

    def _fluents(self, before: Counters, reading: Counters, adds: frozenset[Atom]) -> Counters:
        for index, chain in enumerate(self.chains):
            if (
                reading[index] == before[index]
                and _reached(self._next(before, index), adds)
                and self._may_start(before, chain, index)
            ):
                reading = _advanced(reading, index)
        return reading

    def _next(self, reading: Counters, index: int) -> Atom | None:
        stages = self.chains[index].stages
        return stages[reading[index]] if reading[index] < len(stages) else None

    def _may_start(self, reading: Counters, chain: Chain, index: int) -> bool:
        if reading[index]:
            return True
        done = {each.name for i, each in enumerate(self.chains) if reading[i] == len(each.stages)}
        return all(name in done for name in chain.after)

    def missing(self, state: frozenset[Atom]) -> list[str]:
        """The stages that the most advanced reading has not reached, and last fluents that no longer hold."""
        best = max(self.readings, key=sum)
        found = [
            f"{chain.stages[n]} of {chain.name}"
            for chain, n in zip(self.chains, best, strict=True)
            if n < len(chain.stages)
        ]
        for chain in (each for each in self.chains if each.name not in superseded(self.chains)):
            last = chain.stages[-1]
            if self.kinds[last.name] is Kind.FLUENT and is_ground(last) and last not in state:
                found.append(f"{last} at the end")
        return found

    def orders(self) -> Iterator[tuple[StepId, StepId, str]]:
        """Pairs of steps that must be ordered, and why: stages of one chain, and chains after others."""
        trail = self.readings[max(self.readings, key=sum)]
        steps = dict(zip((chain.name for chain in self.chains), trail, strict=True))
        for chain in self.chains:
            for earlier, later in itertools.pairwise(steps[chain.name]):
                yield earlier, later, f"they reach stages of {chain.name}"
            for name in chain.after:
                if steps[name] and steps[chain.name]:
                    yield steps[name][-1], steps[chain.name][0], f"{chain.name} comes after {name}"


def _reached(stage: Atom | None, adds: frozenset[Atom]) -> bool:
    """Whether what a step adds reaches a fluent stage; `_` in it stands for anything."""
    return stage is not None and any(match(stage, atom, {}) is not None for atom in adds)


def _extended(trail: Trail, before: Counters, after: Counters, step: StepId) -> Trail:
    return tuple((*t, step) if a > b else t for t, b, a in zip(trail, before, after, strict=True))


def _advanced(reading: Counters, index: int) -> Counters:
    return (*reading[:index], reading[index] + 1, *reading[index + 1 :])
