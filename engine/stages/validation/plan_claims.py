"""Claims of a plan file beside the plan (start times, sums, histories), computed again."""

from collections.abc import Iterator, Mapping

from cellwright.engine.model.plan_times import object_histories
from cellwright.kb.model.plan_model import Claims, Happened, Plan, Step, StepId
from cellwright.kb.model.planning_problem import Problem

Times = Mapping[StepId, int]


def false_claims(problem: Problem, plan: Plan, claims: Claims) -> Iterator[str]:
    """What is claimed of a valid plan and is not so."""
    starts = claimed_starts(plan, claims)
    yield from _report_early_starts(plan, starts)
    last = last_end(plan, starts)
    for claimed in dict.fromkeys((claims.makespan, claims.told)):
        if claimed not in (None, last):
            yield f"the makespan is {last}, not {claimed}"
    if claims.bound is not None and claims.bound > last:
        yield f"the makespan is {last}, so it is less than its lower bound {claims.bound}"
    if claims.cost not in (None, plan.cost):
        yield f"the cost is {plan.cost}, not {claims.cost}"
    if claims.histories and claims.histories != (
        done := _computed_histories(problem, plan, starts)
    ):
        wrong = [history for history in claims.histories if history not in done]
        yield (
            f"the history of {wrong[0].chain} has no {_history_text(wrong[0])}"
            if wrong
            else "a history lacks a stage"
        )


def claimed_starts(plan: Plan, claims: Claims) -> dict[StepId, int]:
    """The start of each step: as claimed, else as soon as those before it have ended."""
    starts: dict[StepId, int] = {}
    ends: dict[StepId, int] = {}
    for step in plan.steps:
        soonest = max((ends[before] for before in step.after), default=0)
        starts[step.id] = claims.starts.get(step.id, soonest)
        ends[step.id] = starts[step.id] + step.duration
    return starts


def last_end(plan: Plan, starts: Times) -> int:
    """The end of the last step."""
    return max((starts[step.id] + step.duration for step in plan.steps), default=0)


def _report_early_starts(plan: Plan, starts: Times) -> Iterator[str]:
    """Steps that start before what they wait for has ended."""
    steps_by_id: dict[StepId, Step] = {step.id: step for step in plan.steps}
    for step in plan.steps:
        start = starts[step.id]
        if start < 0:
            yield f"step {step.id} {step.operator} starts at {start}, before 0"
        for before in step.after:
            end = starts[before] + steps_by_id[before].duration
            if start < end:
                yield (
                    f"step {step.id} {step.operator} starts at {start}, but step {before} ends "
                    f"at {end}"
                )


def _computed_histories(problem: Problem, plan: Plan, starts: Times) -> tuple[Happened, ...]:
    return tuple(
        Happened(
            history.chain, str(happening.stage), happening.step, happening.start, happening.duration
        )
        for history in object_histories(problem, plan, starts)
        for happening in history.happenings
    )


def _history_text(line: Happened) -> str:
    return f"{line.stage} by step {line.step} from {line.start} for {line.duration}"
