"""Proofs by looking at all states: no cheaper plan exists; all orders of a plan are valid."""

from collections.abc import Iterator
from dataclasses import replace

from cellwright.engine.kernels.cancellation import Interrupted
from cellwright.engine.model.outcome import Counterexample, Found, OrderCheck
from cellwright.engine.model.workflow_replay import reach_stages_early
from cellwright.engine.pipelines.planning.plan_gate import accept_plan
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.planning.action_elimination import achieved_goal, eliminate_actions
from cellwright.engine.stages.planning.effect_variants import (
    TooManyVariants,
    unconditional_variants,
)
from cellwright.engine.stages.planning.improvement.exact_optimum import find_cheapest_plan
from cellwright.engine.stages.planning.improvement.plan_reordering import deorder_steps
from cellwright.engine.stages.planning.search_control import StateRoom
from cellwright.engine.stages.validation import validate_plan
from cellwright.engine.stages.validation.condition_solving import condition_holds
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.engine.stages.validation.step_changes import State
from cellwright.kb.model.plan_model import Plan, Step, StepId
from cellwright.kb.model.planning_problem import Problem

PROOF_ROOM = StateRoom(states=2_000_000, checks=400_000_000)


def prove_optimum(
    problem: Problem, outcome: Found, interrupted: Interrupted, room: StateRoom = PROOF_ROOM
) -> Found:
    """The same answer, or a cheaper one, with the proof that nothing is cheaper; as it is if
    that takes too long.
    """
    if outcome.optimal or outcome.plan.cost == 0:
        return replace(outcome, optimal=True)
    task = ground(problem)
    try:
        operators = unconditional_variants(task)
    except TooManyVariants:
        return outcome
    size, bound = len(task.atoms), outcome.plan.cost
    best = find_cheapest_plan(operators, size, task.initial, task.goals, bound, interrupted, room)
    if best is None:
        return outcome
    if best.steps is None:
        return replace(outcome, optimal=True)
    steps = reach_stages_early(task, best.steps)
    goals = achieved_goal(task, steps)
    plan = deorder_steps(task, eliminate_actions(task.initial, steps, goals), goals)
    return replace(outcome, plan=accept_plan(problem, plan), optimal=True)


Done = frozenset[StepId]
MAX_ORDER_STATES = 20_000  # states that are looked at; then the question is left open


def check_every_order(problem: Problem, plan: Plan, most: int = MAX_ORDER_STATES) -> OrderCheck:
    """Whether a plan is valid in every order that it allows; at most `most` states are looked
    at.
    """
    orders = _PlanOrders(problem, plan)
    failed = orders.follow()
    if failed is not None:
        return OrderCheck(False, failed)
    if orders.in_sequence() or not validate_plan(problem, plan):
        return OrderCheck(True)
    return orders.all(most)


class _PlanOrders:
    def __init__(self, problem: Problem, plan: Plan) -> None:
        self.problem, self.plan, self.semantics = problem, plan, Semantics(problem)
        self.steps = {step.id: step for step in plan.steps}

    def in_sequence(self) -> bool:
        """Whether the plan allows only one order."""
        before = self.plan.predecessors()
        return all(len(before[step.id]) == place for place, step in enumerate(self.plan.steps))

    def follow(self) -> Counterexample | None:
        """The order in which the steps are listed, if it fails; else None."""
        state, done = self.semantics.initial(), list[StepId]()
        for step in self.plan.steps:
            done.append(step.id)
            following = self._after(step, state)
            if following is None:
                return Counterexample(tuple(done), at_the_goal=False)
            state = following
        return None if self._reached(state) else Counterexample(tuple(done), at_the_goal=True)

    def all(self, most: int) -> OrderCheck:
        """The verdict over every order: breadth first over pairs of the steps done and the
        state reached.
        """
        start: tuple[Done, State] = (frozenset(), self.semantics.initial())
        ways: dict[tuple[Done, State], tuple[StepId, ...]] = {start: ()}
        waiting = [start]
        for done, state in waiting:
            if len(ways) > most:
                return OrderCheck(None)
            earlier_steps = ways[(done, state)]
            if len(done) == len(self.steps) and not self._reached(state):
                return OrderCheck(False, Counterexample(earlier_steps, at_the_goal=True))
            for step in self._ready(done):
                following = self._after(step, state)
                if following is None:
                    return OrderCheck(
                        False, Counterexample((*earlier_steps, step.id), at_the_goal=False)
                    )
                reached = (done | {step.id}, following)
                if reached not in ways:
                    ways[reached] = (*earlier_steps, step.id)
                    waiting.append(reached)
        return OrderCheck(True)

    def _ready(self, done: Done) -> Iterator[Step]:
        return (s for s in self.plan.steps if s.id not in done and done.issuperset(s.after))

    def _after(self, step: Step, state: State) -> State | None:
        """The state after a step; None if it cannot be done."""
        bound = self.semantics.binding(step.operator)
        if isinstance(bound, str):
            return None
        operator, bindings = bound
        facts = self.semantics.facts(state)
        if not condition_holds(operator.precondition, facts, bindings):
            return None
        change = self.semantics.change(operator, bindings, facts, state)
        return None if change.contradiction is not None else (state - change.ends) | change.adds

    def _reached(self, state: State) -> bool:
        return condition_holds(self.problem.goal, self.semantics.facts(state), {})
