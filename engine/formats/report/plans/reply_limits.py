"""After how long without a reply the steps of a plan are given up, where the domain says so."""

from collections.abc import Mapping

from cellwright.engine.formats.report.text_tables import join_ranges
from cellwright.engine.pipelines import execution
from cellwright.kb.model.domain_model import ReplyTimes
from cellwright.kb.model.plan_model import Plan
from cellwright.kb.model.planning_problem import Problem


def reply_limits(plan: Plan, problem: Problem) -> Mapping[int, int]:
    """The limit of each step in milliseconds; of none if the domain says nothing of limits."""
    operators = {operator.name: operator for operator in problem.domain.operators}
    says = problem.domain.reply_times != ReplyTimes()
    if not says and all(operator.timeout is None for operator in operators.values()):
        return {}
    limits = execution.ReplyLimits(problem)
    return {
        int(step.id): limits.of_step(step, operators.get(step.operator.name)) for step in plan.steps
    }


def reply_limits_text(limits: Mapping[int, int]) -> str:
    """The limits in one line: `1, 3..5 after 38 s; 2 after 20 min`; empty if there are none."""
    steps_of_limit: dict[int, list[int]] = {}
    for number, limit in sorted(limits.items()):
        steps_of_limit.setdefault(limit, []).append(number)
    said = [
        f"{join_ranges(numbers)} after {limit / 1000:g} s"
        for limit, numbers in sorted(steps_of_limit.items())
    ]
    return f"Given up without a reply: step {'; '.join(said)}." if said else ""
