"""Plans with times as text and data: start and duration of each step, makespan, and its lower
bound.
"""

from collections.abc import Callable
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from cellwright.engine.model.noun_wording import count_noun
from cellwright.engine.model.temporal import NoPlanInTime, PlannedInTime
from cellwright.kb.model.durative import TimedPlan, decimals
from cellwright.kb.terms import Function

Naming = Callable[[Function], str]  # how an instance of an action is written


def status(outcome: PlannedInTime | NoPlanInTime) -> str:
    """The status word for an outcome."""
    if isinstance(outcome, PlannedInTime):
        return "optimal" if outcome.optimal else "found"
    if outcome.proved:
        return "infeasible"
    return "stopped" if outcome.limit == "time" else "gave up"


def document(outcome: PlannedInTime | NoPlanInTime, named: Naming, stats: bool) -> dict[str, Any]:
    """The outcome as data. Times are numbers in the unit of the task."""
    if isinstance(outcome, NoPlanInTime):
        return {"reason": outcome.reason}
    content: dict[str, Any] = plan_data(outcome.plan, named)
    content |= {"bound": float(outcome.bound), "optimal": outcome.optimal}
    if stats:
        content["statistics"] = {"counts": dict(outcome.counts)}
    return content


def plan_data(plan: TimedPlan, named: Naming) -> dict[str, Any]:
    """A plan as data."""
    steps = [
        {"start": float(step.start), "action": named(step.action), "duration": float(step.duration)}
        for step in plan.steps
    ]
    return {"makespan": float(plan.makespan), "steps": steps}


def text(outcome: PlannedInTime | NoPlanInTime, named: Naming, stats: bool) -> RenderableType:
    """The outcome as people read it."""
    if isinstance(outcome, NoPlanInTime):
        return Text(f"{'no plan exists' if outcome.proved else 'no plan found'}: {outcome.reason}")
    plan = outcome.plan
    width = max((len(decimals(step.start)) for step in plan.steps), default=0)
    lines = [
        f"{decimals(step.start):>{width}}: {named(step.action)} [{decimals(step.duration)}]"
        for step in plan.steps
    ]
    lines.append(
        f"{count_noun(len(plan.steps), 'step')}, makespan "
        f"{decimals(plan.makespan)}{_proof(outcome)}"
    )
    if stats:
        lines.append(", ".join(f"{name} {count}" for name, count in outcome.counts.items()))
    return Group(*map(Text, lines))


def _proof(outcome: PlannedInTime) -> str:
    """What is proved about the makespan, over all plans."""
    if outcome.optimal:
        return ", the shortest possible"
    return f"; no plan takes less than {decimals(outcome.bound)}"


def verdict(plan: TimedPlan) -> tuple[str, dict[str, Any]]:
    """What is said of a plan that is right, as text and data."""
    said = f"valid: {count_noun(len(plan.steps), 'step')}, makespan {decimals(plan.makespan)}"
    return said, {"steps": len(plan.steps), "makespan": float(plan.makespan)}
