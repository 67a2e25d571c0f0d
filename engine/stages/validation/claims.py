"""What a plan file says beside the plan: start times, sums and histories. All of it is computed again."""

from collections.abc import Iterator, Mapping

from cellwright.engine.model.histories import histories
from cellwright.kb.model.plan import Claims, Happened, Plan, Step, StepId
from cellwright.kb.model.problem import Problem

Times = Mapping[StepId, int]


def false_claims(problem: Problem, plan: Plan, claims: Claims) -> Iterator[str]:
    """What is claimed of a valid plan and is not so."""
    starts = times(plan, claims)
    yield from _early(plan, starts)
    last = makespan(plan, starts)
    for claimed in dict.fromkeys((claims.makespan, claims.told)):
        if claimed not in (None, last):
            yield f"the makespan is {last}, not {claimed}"
    if claims.bound is not None and claims.bound > last:
        yield f"the makespan is {last}, so it is less than its lower bound {claims.bound}"
    if claims.cost not in (None, plan.cost):
        yield f"the cost is {plan.cost}, not {claims.cost}"
    if claims.histories and claims.histories != (done := _happened(problem, plan, starts)):
        wrong = [each for each in claims.histories if each not in done]
        yield (
            f"the history of {wrong[0].chain} has no {_said(wrong[0])}"
            if wrong
            else "a history lacks a stage"
        )


def times(plan: Plan, claims: Claims) -> dict[StepId, int]:
    """The start of each step: as claimed, else as soon as those before it have ended."""
    starts: dict[StepId, int] = {}
    ends: dict[StepId, int] = {}
    for step in plan.steps:
        soonest = max((ends[before] for before in step.after), default=0)
        starts[step.id] = claims.starts.get(step.id, soonest)
        ends[step.id] = starts[step.id] + step.duration
    return starts


def makespan(plan: Plan, starts: Times) -> int:
    """The end of the last step."""
    return max((starts[step.id] + step.duration for step in plan.steps), default=0)


def _early(plan: Plan, starts: Times) -> Iterator[str]:
    """Steps that start before what they wait for has ended."""
    known: dict[StepId, Step] = {step.id: step for step in plan.steps}
    for step in plan.steps:
        start = starts[step.id]
        if start < 0:
            yield f"step {step.id} {step.operator} starts at {start}, before 0"
        for before in step.after:
            end = starts[before] + known[before].duration
            if start < end:
                yield f"step {step.id} {step.operator} starts at {start}, but step {before} ends at {end}"


def _happened(problem: Problem, plan: Plan, starts: Times) -> tuple[Happened, ...]:
    return tuple(
        Happened(history.chain, str(each.stage), each.step, each.start, each.duration)
        for history in histories(problem, plan, starts)
        for each in history.happenings
    )


def _said(line: Happened) -> str:
    return f"{line.stage} by step {line.step} from {line.start} for {line.duration}"
