"""Steps of a plan that could be left out, by trying."""

import itertools
from collections.abc import Sequence
from dataclasses import replace

from cellwright.engine.stages.validation import plan_findings
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.kb.model.plan_model import Plan, Step
from cellwright.kb.model.planning_problem import Problem


def needless(problem: Problem, plan: Plan, most: int) -> tuple[str, ...]:
    """The first set of at most so many steps without which the checker accepts the others, one
    after another; else nothing.

    The plan itself has to be accepted in this way.
    """
    semantics, steps = Semantics(problem), plan.steps
    assert not plan_findings(semantics, one_by_one(steps))
    for count in range(1, most + 1):
        for chosen in itertools.combinations(steps, count):
            rest = [step for step in steps if step not in chosen]
            if not plan_findings(semantics, one_by_one(rest)):
                return tuple(str(step.operator) for step in chosen)
    return ()


def one_by_one(steps: Sequence[Step]) -> Plan:
    """The steps in their order, each after the one before it."""
    return Plan(
        tuple(
            replace(step, id=n, after=(n - 1,) if n > 1 else ()) for n, step in enumerate(steps, 1)
        )
    )
