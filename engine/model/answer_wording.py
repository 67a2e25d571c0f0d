"""Words of answers about plans: the purposes and conditions of their steps."""

from collections.abc import Callable

from cellwright.engine.model.workflow_replay import stage_atom
from cellwright.kb.model.plan_model import GOAL_STEP, Plan, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom


def step_purposes(problem: Problem, plan: Plan) -> dict[StepId, dict[str, list[str]]]:
    """For each step, what it achieves and for which steps ("goal" for the goal).

    This is why the step is in the plan.
    """
    say = condition_wording(problem)
    purposes_by_step: dict[StepId, dict[str, list[str]]] = {}
    for link in plan.links:
        consumer = "goal" if link.consumer == GOAL_STEP else str(link.consumer)
        consumers = purposes_by_step.setdefault(link.producer, {}).setdefault(
            say(link.condition), []
        )
        if consumer not in consumers:
            consumers.append(consumer)
    return purposes_by_step


def condition_wording(problem: Problem | None) -> Callable[[Atom], str]:
    """The wording of each condition: a stage of the workflow as its own atom, `not p` for
    `not(p)`.
    """
    chains = problem.chains if problem else ()
    stages = {stage_atom(c, n): str(stage) for c in chains for n, stage in enumerate(c.stages, 1)}
    stages |= {
        stage_atom(chain, 0): f"before {chain.stages[0]}" for chain in chains if chain.stages
    }

    def say(condition: Atom) -> str:
        return stages.get(condition) or plain_condition(condition)

    return say


def plain_condition(condition: Atom) -> str:
    """A condition as people write it: `not p` for `not(p)`."""
    negative = condition.name == "not" and len(condition.arguments) == 1
    return f"not {condition.arguments[0]}" if negative else str(condition)
