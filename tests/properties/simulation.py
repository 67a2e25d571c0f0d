"""What a plan can come to, plainly: every order and every overlap of its steps is carried out, one
event after another.

A step starts when those before it have ended and its precondition holds, which must last until it
ends; then its effects come. While it lasts it holds its resources alone (language, Meaning 8 and
9).
"""

from collections.abc import Iterator
from dataclasses import dataclass

from cellwright.engine.stages.validation.condition_solving import condition_holds
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.engine.stages.validation.step_changes import State
from cellwright.kb.model.plan_model import GOAL_STEP, INITIAL_STEP, CausalLink, Plan, Step, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Function, substitute_term


@dataclass(frozen=True)
class Moment:
    """The state of the world, and the steps that last and that have ended."""

    state: State
    running: frozenset[StepId] = frozenset()
    ended: frozenset[StepId] = frozenset()


class Simulation:
    """Everything that a plan allows."""

    def __init__(self, problem: Problem, plan: Plan) -> None:
        self.problem, self.plan = problem, plan
        self.semantics = Semantics(problem)
        self.steps = {step.id: step for step in plan.steps}

    def fails(self) -> str:
        """What goes wrong in some order or overlap; nothing if the plan does what it claims in
        all of them.
        """
        first = Moment(self.semantics.initial())
        seen, waiting = {first}, [first]
        while waiting:
            now = waiting.pop()
            if wrong := self._wrong(now):
                return wrong
            for later in self._following(now):
                if later not in seen:
                    seen.add(later)
                    waiting.append(later)
        return ""

    def _following(self, now: Moment) -> Iterator[Moment]:
        for step in self.plan.steps:
            if step.id in now.running:
                rest = now.running - {step.id}
                yield Moment(self._after(step, now.state), rest, now.ended | {step.id})
            elif step.id not in now.ended and now.ended.issuperset(step.after):
                yield Moment(now.state, now.running | {step.id}, now.ended)

    def _after(self, step: Step, state: State) -> State:
        operator, bindings = self._bound(step)
        change = self.semantics.change(operator, bindings, self.semantics.facts(state), state)
        return (state - change.ends) | change.adds

    def _bound(self, step: Step):  # type: ignore[no-untyped-def]
        operator = self.semantics.operators[step.operator.name]
        return operator, dict(zip(operator.variables, step.operator.arguments, strict=True))

    def _wrong(self, now: Moment) -> str:
        facts = self.semantics.facts(now.state)
        held = [resource for each in now.running for resource in set(self.steps[each].resources)]
        if len(held) > len(set(held)):
            return f"two steps hold the same: {held}"
        for each in now.running:
            operator, bindings = self._bound(self.steps[each])
            if not condition_holds(operator.precondition, facts, bindings):
                return f"the precondition of step {each} does not hold while it lasts"
            if {substitute_term(r, bindings) for r in operator.resources} - set(
                self.steps[each].resources
            ):
                return f"step {each} does not hold what it needs"
        if len(now.ended) == len(self.steps) and not condition_holds(self.problem.goal, facts, {}):
            return "the goal does not hold at the end"
        return next(
            (f"{link} is broken" for link in self.plan.links if self._broken(link, now)), ""
        )

    def _broken(self, link: CausalLink, now: Moment) -> bool:
        """Whether a link's condition is false although its producer has ended and its consumer
        has not.
        """
        begun = link.consumer in now.running
        whole = link.consumer == GOAL_STEP and len(now.ended) == len(self.steps)
        if link.producer not in now.ended and link.producer != INITIAL_STEP:
            return begun or whole
        negative = link.condition.name == "not"
        atom = link.condition.arguments[0] if negative else link.condition
        assert isinstance(atom, Function)
        return link.consumer not in now.ended and (atom in now.state) == negative
