"""The problem that is left when some steps of a plan are done."""

import dataclasses
from collections.abc import Collection, Iterable, Mapping, Sequence

from cellwright.engine.pipelines.simulation import Dynamics
from cellwright.engine.pipelines.simulation.faulty import history
from cellwright.engine.stages.macros.lifted.situation import Situation
from cellwright.engine.stages.macros.lifted.world import StepChange
from cellwright.kb.model.conditions import And, Condition, Literal, goal_parts
from cellwright.kb.model.plan import Plan, StepId
from cellwright.kb.model.problem import Chain, Problem
from cellwright.kb.model.workflow import advanced, begun, finished, holding, lasting
from cellwright.kb.terms import Atom, ordered


def stages_reached(
    chains: Sequence[Chain], start: Situation, changes: Iterable[StepChange]
) -> dict[str, int]:
    """How many stages of each chain are reached by steps from a situation on, each as soon as possible."""
    facts = start.facts
    reached = begun(chains, holding(facts))
    for change in changes:
        facts = change.applied(facts)
        reached, _ = advanced(chains, reached, change.events, holding(facts))
    return reached


def remaining(problem: Problem, reached: Mapping[str, int], observed: Iterable[Atom]) -> Problem:
    """The problem of what is left, from the observed state on.

    Chains lose the stages that are reached. What a finished chain must leave behind becomes a goal.
    """
    done = finished(problem.chains, reached)
    wanted = lasting(problem.chains, problem.domain)
    lasts: list[Condition] = [Literal(each) for name, own in wanted.items() if name in done for each in own]
    chains = tuple(
        dataclasses.replace(
            chain,
            stages=chain.stages[reached[chain.name] :],
            after=() if reached[chain.name] else tuple(name for name in chain.after if name not in done),
        )
        for chain in problem.chains
        if chain.name not in done
    )
    goal = And((*goal_parts(problem.goal), *lasts)) if lasts else problem.goal
    return dataclasses.replace(problem, initial=ordered(observed), complete=True, goal=goal, chains=chains)


def left_over(plan: Plan, done: Collection[StepId]) -> Plan:
    """The steps of a plan that are not done."""
    steps = (
        dataclasses.replace(step, after=tuple(each for each in step.after if each not in done))
        for step in plan.steps
        if step.id not in done
    )
    return Plan(tuple(steps))


def rest_of(problem: Problem, plan: Plan, done: Collection[StepId]) -> tuple[Problem, Plan]:
    """What is left of a problem after some steps of a plan for it if each did what it should; and the other steps."""
    state, _ = history(Dynamics(problem), plan, tuple(done))
    return remaining(problem, state.reached, state.facts), left_over(plan, done)
