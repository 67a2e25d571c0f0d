"""The problem that remains when steps are done, and after what has changed in the world."""

import dataclasses
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

from cellwright.engine.model.troubleshooting import Revision
from cellwright.engine.pipelines.planning.goal_selection import Obstacles
from cellwright.engine.pipelines.planning.restrictions import forbid_steps
from cellwright.engine.pipelines.recovery import Dynamics, WorldState
from cellwright.engine.pipelines.recovery.world_model import plan_history
from cellwright.engine.stages.lifted.cell_domain import Situation, StepChange
from cellwright.engine.stages.validation.step_changes import State
from cellwright.kb.model.conditions import And, Condition, Literal, goal_parts
from cellwright.kb.model.domain_model import Kind
from cellwright.kb.model.plan_model import Plan, StepId
from cellwright.kb.model.planning_problem import (
    Chain,
    Problem,
    advance_chains,
    final_stages,
    finished_chains,
    initial_progress,
    stage_holds,
)
from cellwright.kb.terms import Atom, is_ground, sort_naturally


def stages_reached(
    chains: Sequence[Chain], start: Situation, changes: Iterable[StepChange]
) -> dict[str, int]:
    """How many stages of each chain are reached by steps from a situation on, each as soon as
    possible.
    """
    facts = start.facts
    reached = initial_progress(chains, stage_holds(facts))
    for change in changes:
        facts = change.applied(facts)
        reached, _ = advance_chains(chains, reached, change.events, stage_holds(facts))
    return reached


def remaining_problem(
    problem: Problem, reached: Mapping[str, int], observed: Iterable[Atom]
) -> Problem:
    """The problem of what is left, from the observed state on.

    Chains lose the stages that are reached. What a finished chain must leave behind becomes a goal.
    """
    done = finished_chains(problem.chains, reached)
    lasting_atoms = final_stages(problem.chains, problem.domain)
    lasts: list[Condition] = [
        Literal(atom) for name, own in lasting_atoms.items() if name in done for atom in own
    ]
    chains = tuple(
        dataclasses.replace(
            chain,
            stages=chain.stages[reached[chain.name] :],
            after=()
            if reached[chain.name]
            else tuple(name for name in chain.after if name not in done),
        )
        for chain in problem.chains
        if chain.name not in done
    )
    goal = And((*goal_parts(problem.goal), *lasts)) if lasts else problem.goal
    return dataclasses.replace(
        problem, initial=sort_naturally(observed), complete=True, goal=goal, chains=chains
    )


def left_over(plan: Plan, done: Collection[StepId]) -> Plan:
    """The steps of a plan that are not done."""
    steps = (
        dataclasses.replace(
            step, after=tuple(earlier for earlier in step.after if earlier not in done)
        )
        for step in plan.steps
        if step.id not in done
    )
    return Plan(tuple(steps))


def rest_after_steps(
    problem: Problem, plan: Plan, done: Collection[StepId]
) -> tuple[Problem, Plan]:
    """What is left of a problem after some steps of a plan for it if each did what it should;
    and the other steps.
    """
    state, _ = plan_history(Dynamics(problem), plan, tuple(done))
    return remaining_problem(problem, state.reached, state.facts), left_over(plan, done)


@dataclass(frozen=True)
class KnownChanges:
    """A revision, and what each part of it keeps from being planned."""

    dynamics: Dynamics
    change: Revision

    def state(self) -> State:
        """The initial state of the problem after the revision, with what follows."""
        gone, new = (
            [atom for atom, _ in changed]
            for changed in (self.change.withdrawn, self.change.asserted)
        )
        return self.dynamics.changed(WorldState(self.dynamics.semantics.initial()), gone, new).facts

    def planned_in(self, now: tuple[Atom, ...]) -> Problem:
        """The problem from a state on, without the steps that are not to be taken."""
        return self.obstacles(now).without(frozenset())

    def obstacles(self, now: tuple[Atom, ...]) -> Obstacles:
        """Everything that may keep a goal from being reached: losses, steps that are blocked,
        facts that were withdrawn.
        """
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
            out = {names[name] for name in removed}
            return self._problem(now, out)

        return Obstacles(tuple(text for text, _ in (*lost, *blocked, *gone)), without)

    def _problem(self, now: tuple[Atom, ...], out: Collection[str | Atom]) -> Problem:
        """The problem from a state on, without some of the obstacles."""
        lost = [name for name in self.change.lost if name not in out]
        blocked = [pattern for pattern, why in self.change.blocked if why not in out]
        back = [atom for atom, _ in self._gone() if atom in out]
        facts = self.dynamics.changed(WorldState(frozenset(now)), (), back).facts if back else now
        return forbid_steps(self.dynamics.problem.replace(sort_naturally(facts)), lost, blocked)

    def _gone(self) -> tuple[tuple[Atom, str], ...]:
        """The facts that do not hold any more, also by deduction."""
        deduced = (
            (atom, "it follows from what is known now")
            for atom, holds in self.change.follows
            if not holds
        )
        return (*self.change.withdrawn, *deduced)

    def _is_fact(self, atom: Atom) -> bool:
        return (
            is_ground(atom)
            and self.dynamics.problem.domain.predicates[atom.name].kind is Kind.FLUENT
        )
