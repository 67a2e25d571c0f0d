"""What is known to have changed in a world, as a problem to plan in, and as obstacles that may keep goals from being reached."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass

from engine.model.cases import Revision
from engine.pipelines.attainment import Obstacle
from engine.pipelines.barring import barred
from engine.pipelines.simulation import Dynamics, WorldState
from engine.stages.validation.changes import State
from kb.model.domain import Kind
from kb.model.problem import Problem
from kb.terms import Atom, is_ground, ordered


@dataclass(frozen=True)
class Changes:
    """A revision, and what each part of it keeps from being planned."""

    dynamics: Dynamics
    change: Revision

    def state(self) -> State:
        """The initial state of the problem after the revision, with what follows."""
        gone, new = ([atom for atom, _ in each] for each in (self.change.withdrawn, self.change.asserted))
        return self.dynamics.changed(WorldState(self.dynamics.semantics.initial()), gone, new).facts

    def planned_in(self, now: tuple[Atom, ...]) -> Problem:
        """The problem from a state on, without the steps that are not to be taken."""
        return self._problem(now, self.change.lost, [pattern for pattern, _ in self.change.blocked])

    def free(self, now: tuple[Atom, ...]) -> Problem:
        """The problem as if nothing had been lost, blocked or withdrawn."""
        facts = [atom for atom, _ in self.change.withdrawn if self._is_fact(atom)]
        return self._problem(ordered(self._with(now, *facts)), (), ())

    def obstacles(self, now: tuple[Atom, ...]) -> list[Obstacle]:
        """Everything that may keep a goal from being reached, each with the problem without it."""
        return [*self._lost(now), *self._blocked(now), *self._withdrawn(now)]

    def _lost(self, now: tuple[Atom, ...]) -> Iterator[Obstacle]:
        blocked = [pattern for pattern, _ in self.change.blocked]
        for name in self.change.lost:
            others = [each for each in self.change.lost if each != name]
            yield Obstacle(f"{name} is lost", self._problem(now, others, blocked))

    def _blocked(self, now: tuple[Atom, ...]) -> Iterator[Obstacle]:
        for why in dict.fromkeys(why for _, why in self.change.blocked):
            others = [pattern for pattern, reason in self.change.blocked if reason != why]
            yield Obstacle(why, self._problem(now, self.change.lost, others))

    def _withdrawn(self, now: tuple[Atom, ...]) -> Iterator[Obstacle]:
        blocked = [pattern for pattern, _ in self.change.blocked]
        for atom, why in self.change.withdrawn:
            if self._is_fact(atom):
                there = self._problem(ordered(self._with(now, atom)), self.change.lost, blocked)
                yield Obstacle(f"{atom} does not hold any more ({why})", there)

    def _is_fact(self, atom: Atom) -> bool:
        return is_ground(atom) and self.dynamics.problem.domain.predicates[atom.name].kind is Kind.FLUENT

    def _with(self, now: tuple[Atom, ...], *facts: Atom) -> State:
        return self.dynamics.changed(WorldState(frozenset(now)), (), facts).facts

    def _problem(self, now: tuple[Atom, ...], lost: Collection[str], blocked: Collection[Atom]) -> Problem:
        return barred(self.dynamics.problem.replace(now), lost, blocked)
