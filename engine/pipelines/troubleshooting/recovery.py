"""How it goes on after a diagnosis: the plan that failed is revised before anything is planned anew, and what was lost is
passed on to the sequence that is kept.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace

from engine.model.cases import Revision
from engine.model.outcome import Outcome
from engine.pipelines.attainment import GivenUp, Obstacle
from engine.pipelines.barring import barred
from engine.pipelines.inspection.keeping import told_of_losses
from engine.pipelines.inspection.progress import Progress
from engine.pipelines.revision import Course, planned_anew, revise
from engine.pipelines.revision.remaining import left_over, remaining
from engine.pipelines.simulation import Dynamics, WorldState
from engine.pipelines.simulation.faulty import history
from engine.stages.planning import Limits
from engine.stages.validation.semantics import State
from kb.model.plan import Plan, Step, StepId
from kb.model.problem import Problem
from kb.terms import Atom, is_ground, ordered


@dataclass(frozen=True, slots=True)
class Recovery:
    """How the case goes on: the state as it is now known, and the answer for the original goals.

    `way` is `planned` where no plan had failed, else what became of its remaining steps: done (nothing is left to do),
    continued, repaired, or replanned where no repair was found or a new plan is cheaper. `given_up` are the goals that
    cannot be reached any more: the answer is for the others. `sequence` is the kept sequence
    after it was told what was lost.
    """

    problem: Problem
    outcome: Outcome
    way: str = "planned"
    kept: tuple[Step, ...] = ()
    dropped: tuple[Step, ...] = ()
    added: tuple[Step, ...] = ()
    given_up: tuple[GivenUp, ...] = ()
    sequence: Progress | None = None


def recover(
    problem: Problem,
    change: Revision,
    limits: Limits = Limits(),
    left: Plan | None = None,
    believed: State | None = None,
    executable: bool = True,
) -> Recovery:
    """From the revised state to the goals that the failed plan had, or to those that can still be reached.

    What was lost is not used, and what is blocked is not tried. `left` are the steps that were not done when the plan
    failed, from the problem's initial state on: they are revised before anything is planned anew, if they are still
    `executable` there. `believed` is the state now; without it, it is what `change` makes of the initial state. Raises
    `InvalidInput`.
    """
    dynamics = Dynamics(problem)
    changes = _Changes(dynamics, change)
    now = ordered(changes.state() if believed is None else believed)
    here, obstacles, free = changes.planned_in(now), changes.obstacles(now), changes.free(now)
    if left is None or not executable:
        found = planned_anew(here, left, limits, obstacles, free)
        way = "planned" if left is None else found.way
        return Recovery(
            found.problem, found.outcome, way, found.kept, found.dropped, found.added, found.given_up
        )
    course = Course.of(replace(here, initial=ordered(dynamics.semantics.initial())), left)
    found = revise(course, (), now, limits, obstacles=obstacles, free=free)
    return Recovery(
        found.problem, found.outcome, found.way, found.kept, found.dropped, found.added, found.given_up
    )


@dataclass(frozen=True)
class _Changes:
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
        facts = [atom for atom, _ in self.change.withdrawn if is_ground(atom)]
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
            if is_ground(atom) and atom.name in self.dynamics.problem.domain.predicates:
                there = self._problem(ordered(self._with(now, atom)), self.change.lost, blocked)
                yield Obstacle(f"{atom} does not hold any more ({why})", there)

    def _with(self, now: tuple[Atom, ...], *facts: Atom) -> State:
        return self.dynamics.changed(WorldState(frozenset(now)), (), facts).facts

    def _problem(self, now: tuple[Atom, ...], lost: Collection[str], blocked: Collection[Atom]) -> Problem:
        return barred(self.dynamics.problem.replace(now), lost, blocked)


def rest_of(problem: Problem, plan: Plan, done: Collection[StepId]) -> tuple[Problem, Plan]:
    """What is left of a problem after some steps of a plan for it, had each done what it should, and the other steps."""
    state, _ = history(Dynamics(problem), plan, tuple(done))
    return remaining(problem, state.reached, state.facts), left_over(plan, done)


def told(found: Recovery, problem: Problem, lost: Collection[str], store: str) -> Recovery:
    """The recovery with the sequence that a store keeps of the problem, after it was told what was lost."""
    if not lost:
        return found
    return replace(found, sequence=told_of_losses(store, problem.replace(found.problem.initial), lost))
