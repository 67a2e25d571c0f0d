"""When the steps of a plan can run: earliest starts and the makespan.

Start times are a forecast; the orders between steps are what a plan promises.
"""

from kb.model.plan import Plan, StepId


def earliest_starts(plan: Plan) -> dict[StepId, int]:
    """When each step can start if every step starts as soon as those before it have ended, in the unit of the domain."""
    ends: dict[StepId, int] = {}
    starts: dict[StepId, int] = {}
    for step in plan.steps:
        starts[step.id] = max((ends[before] for before in step.after), default=0)
        ends[step.id] = starts[step.id] + step.duration
    return starts


def makespan(plan: Plan) -> int:
    """The end of the last step, every step starting as early as it may."""
    starts = earliest_starts(plan)
    return max((starts[step.id] + step.duration for step in plan.steps), default=0)
