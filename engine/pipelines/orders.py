"""Is a partially ordered plan valid in every order that it allows?

The checker asks for more: unordered steps must not disturb each other even when they overlap in time. It refuses a plan
for which it cannot show that. Here only the orders count. A plan that the checker accepts is valid. For any other plan all
orders are tried together, step by step. Two orders that have done the same steps and reached the same state are followed as
one, because they continue in the same way.
"""

from collections.abc import Iterator

from cellwright.engine.model.order import Counterexample, Verdict
from cellwright.engine.stages.validation import validate
from cellwright.engine.stages.validation.changes import State
from cellwright.engine.stages.validation.datalog import holds
from cellwright.engine.stages.validation.semantics import Semantics
from cellwright.kb.model.plan import Plan, Step, StepId
from cellwright.kb.model.problem import Problem

Done = frozenset[StepId]
MOST = 20_000  # states that are looked at; then the question is left open


def every_order(problem: Problem, plan: Plan, most: int = MOST) -> Verdict:
    """Whether a plan is valid in every order that it allows; at most `most` states are looked at."""
    orders = _Orders(problem, plan)
    failed = orders.follow()
    if failed is not None:
        return Verdict(False, failed)
    if orders.in_sequence() or not validate(problem, plan):
        return Verdict(True)
    return orders.all(most)


class _Orders:
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

    def all(self, most: int) -> Verdict:
        """The verdict over every order: breadth first over pairs of the steps done and the state reached."""
        start: tuple[Done, State] = (frozenset(), self.semantics.initial())
        ways: dict[tuple[Done, State], tuple[StepId, ...]] = {start: ()}
        waiting = [start]
        for done, state in waiting:
            if len(ways) > most:
                return Verdict(None)
            way = ways[(done, state)]
            if len(done) == len(self.steps) and not self._reached(state):
                return Verdict(False, Counterexample(way, at_the_goal=True))
            for step in self._ready(done):
                following = self._after(step, state)
                if following is None:
                    return Verdict(False, Counterexample((*way, step.id), at_the_goal=False))
                reached = (done | {step.id}, following)
                if reached not in ways:
                    ways[reached] = (*way, step.id)
                    waiting.append(reached)
        return Verdict(True)

    def _ready(self, done: Done) -> Iterator[Step]:
        return (s for s in self.plan.steps if s.id not in done and done.issuperset(s.after))

    def _after(self, step: Step, state: State) -> State | None:
        """The state after a step; None if it cannot be done."""
        bound = self.semantics.binding(step.operator)
        if isinstance(bound, str):
            return None
        operator, bindings = bound
        facts = self.semantics.facts(state)
        if not holds(operator.precondition, facts, bindings):
            return None
        change = self.semantics.change(operator, bindings, facts, state)
        return None if change.contradiction is not None else (state - change.ends) | change.adds

    def _reached(self, state: State) -> bool:
        return holds(self.problem.goal, self.semantics.facts(state), {})
