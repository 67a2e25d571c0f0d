"""What is known to have changed in a world, as a problem to plan in, and as obstacles that may keep goals from being reached."""

from collections.abc import Collection
from dataclasses import dataclass

from cellwright.engine.model.cases import Revision
from cellwright.engine.pipelines.attainment import Obstacles
from cellwright.engine.pipelines.barring import barred
from cellwright.engine.pipelines.simulation import Dynamics, WorldState
from cellwright.engine.stages.validation.changes import State
from cellwright.kb.model.domain import Kind
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Atom, is_ground, ordered


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
        return self.obstacles(now).without(frozenset())

    def obstacles(self, now: tuple[Atom, ...]) -> Obstacles:
        """Everything that may keep a goal from being reached: losses, steps that are blocked, facts that were withdrawn."""
        lost = [(f"{name} is lost", name) for name in self.change.lost]
        blocked = [(why, why) for why in dict.fromkeys(why for _, why in self.change.blocked)]
        facts = [(why, atom) for atom, why in self._gone() if self._is_fact(atom)]
        gone = [(f"{atom} does not hold any more ({why})", atom) for why, atom in facts]
        names: tuple[str | Atom, ...] = (
            *(name for _, name in lost),
            *(why for _, why in blocked),
            *(atom for _, atom in gone),
        )

        def without(removed: frozenset[int]) -> Problem:
            out = {names[each] for each in removed}
            return self._problem(now, out)

        return Obstacles(tuple(said for said, _ in (*lost, *blocked, *gone)), without)

    def _problem(self, now: tuple[Atom, ...], out: Collection[str | Atom]) -> Problem:
        """The problem from a state on, without some of the obstacles."""
        lost = [name for name in self.change.lost if name not in out]
        blocked = [pattern for pattern, why in self.change.blocked if why not in out]
        back = [atom for atom, _ in self._gone() if atom in out]
        facts = self.dynamics.changed(WorldState(frozenset(now)), (), back).facts if back else now
        return barred(self.dynamics.problem.replace(ordered(facts)), lost, blocked)

    def _gone(self) -> tuple[tuple[Atom, str], ...]:
        """The facts that do not hold any more, also by deduction."""
        deduced = (
            (atom, "it follows from what is known now") for atom, holds in self.change.follows if not holds
        )
        return (*self.change.withdrawn, *deduced)

    def _is_fact(self, atom: Atom) -> bool:
        return is_ground(atom) and self.dynamics.problem.domain.predicates[atom.name].kind is Kind.FLUENT
