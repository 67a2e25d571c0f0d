"""The times of a plan: the earliest start of each step, and the makespan.

Start times are a forecast. A plan promises only the order between its steps.
"""

from collections.abc import Mapping

from cellwright.kb.model.plan import Plan, StepId


def earliest_starts(plan: Plan) -> dict[StepId, int]:
    """The start of each step if it begins as soon as those before it end, in the domain's time unit."""
    ends: dict[StepId, int] = {}
    starts: dict[StepId, int] = {}
    for step in plan.steps:
        starts[step.id] = max((ends[before] for before in step.after), default=0)
        ends[step.id] = starts[step.id] + step.duration
    return starts


def makespan(plan: Plan, starts: Mapping[StepId, int] | None = None) -> int:
    """The end of the last step; without `starts`, if every step starts as early as possible."""
    starts = earliest_starts(plan) if starts is None else starts
    return max((starts[step.id] + step.duration for step in plan.steps), default=0)
