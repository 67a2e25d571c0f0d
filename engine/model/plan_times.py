"""The times of a plan: earliest starts, makespan, bottleneck, and the history of each object."""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from cellwright.engine.model.workflow_replay import STAGE_FLUENT, stage_atom
from cellwright.kb.model.plan_model import INITIAL_STEP, Plan, Step, StepId
from cellwright.kb.model.planning_problem import Chain, Problem
from cellwright.kb.terms import Atom, Term, Text


@dataclass(frozen=True, slots=True)
class TimeShare:
    """How long the steps of one operator last together."""

    operator: str
    steps: int
    time: int


@dataclass(frozen=True, slots=True)
class Bottleneck:
    """The steps that make up a makespan, by operator, the longest first.

    `resource` holds them all and never rests; without one they are a chain, with `waiting` between
    its steps.
    """

    resource: Term | None
    shares: tuple[TimeShare, ...]
    waiting: int = 0


def find_bottleneck(plan: Plan, starts: Mapping[StepId, int]) -> Bottleneck:
    """What bounds the makespan of a plan whose steps start at `starts`."""
    ends = {step.id: starts[step.id] + step.duration for step in plan.steps}
    last = max(ends.values(), default=0)
    loads: Counter[Term] = Counter()
    for step in plan.steps:
        for resource in step.resources:
            loads[resource] += step.duration
    busiest = min(
        loads, key=lambda busy_resource: (-loads[busy_resource], str(busy_resource)), default=None
    )
    if busiest is not None and loads[busiest] == last:
        return Bottleneck(
            busiest, _time_shares(step for step in plan.steps if busiest in step.resources)
        )
    chain = _waiting_chain(plan, ends)
    return Bottleneck(None, _time_shares(chain), last - sum(step.duration for step in chain))


def _waiting_chain(plan: Plan, ends: Mapping[StepId, int]) -> list[Step]:
    """The steps from the last one back, each with the one that it waits for longest."""
    steps = {step.id: step for step in plan.steps}
    chain: list[Step] = []
    at = max(ends, key=lambda last_step: (ends[last_step], -last_step), default=None)
    while at is not None:
        chain.append(steps[at])
        at = max(
            steps[at].after, key=lambda waited_step: (ends[waited_step], -waited_step), default=None
        )
    return chain[::-1]


def _time_shares(steps: Iterable[Step]) -> tuple[TimeShare, ...]:
    times, counts = Counter[str](), Counter[str]()
    for step in steps:
        times[step.operator.name] += step.duration
        counts[step.operator.name] += 1
    shares = (TimeShare(name, counts[name], time) for name, time in times.items() if time)
    return tuple(sorted(shares, key=lambda time_share: (-time_share.time, time_share.operator)))


def earliest_starts(plan: Plan) -> dict[StepId, int]:
    """The start of each step if it begins as soon as those before it end, in the domain's time
    unit.
    """
    ends: dict[StepId, int] = {}
    starts: dict[StepId, int] = {}
    for step in plan.steps:
        starts[step.id] = max((ends[before] for before in step.after), default=0)
        ends[step.id] = starts[step.id] + step.duration
    return starts


def plan_makespan(plan: Plan, starts: Mapping[StepId, int] | None = None) -> int:
    """The end of the last step; without `starts`, if every step starts as early as possible."""
    starts = earliest_starts(plan) if starts is None else starts
    return max((starts[step.id] + step.duration for step in plan.steps), default=0)


@dataclass(frozen=True, slots=True)
class Happening:
    """A stage of a chain, and the step that reaches it, from `start` for `duration`."""

    stage: Atom
    step: StepId
    start: int
    duration: int


@dataclass(frozen=True, slots=True)
class History:
    """What a plan does to one object: the stages of its chain, in order.

    `names` are texts that static facts give it.
    """

    subject: Term | None
    chain: str
    names: Mapping[str, str]
    happenings: tuple[Happening, ...]


def object_histories(
    problem: Problem, plan: Plan, starts: Mapping[StepId, int] | None = None
) -> tuple[History, ...]:
    """One history per chain of the workflow, read from the causal links of its stages.

    `starts` says when each step starts; None: as early as it can.
    """
    steps = {step.id: step for step in plan.steps}
    starts = earliest_starts(plan) if starts is None else starts
    histories_found = []
    for chain in problem.chains:
        reached = steps_reaching(plan, chain)
        happenings = tuple(
            Happening(stage, step, starts[step], steps[step].duration)
            for n, stage in enumerate(chain.stages, 1)
            if (step := reached.get(n)) in steps
        )
        histories_found.append(
            History(chain.subject, chain.name, _object_texts(problem, chain.subject), happenings)
        )
    return tuple(histories_found)


def steps_reaching(plan: Plan, chain: Chain) -> dict[int, StepId]:
    """The steps that reach the stages of a chain, by the number of stages reached then, read from
    causal links.

    A step that reaches several stages provides the last of them. What held from the start, or was
    left to the end, is nobody's.
    """
    producers = {
        link.condition: link.producer for link in plan.links if link.condition.name == STAGE_FLUENT
    }
    reaching_steps: dict[int, StepId] = {}
    step: StepId | None = None
    for number in range(len(chain.stages), 0, -1):
        step = producers.get(stage_atom(chain, number), step)
        if step is not None and step != INITIAL_STEP:
            reaching_steps[number] = step
    return reaching_steps


def _object_texts(problem: Problem, subject: Term | None) -> dict[str, str]:
    """The texts that binary static facts of the problem give to an object, by predicate."""
    return {
        fact.name: fact.arguments[1].value
        for fact in problem.statics
        if len(fact.arguments) == 2
        and fact.arguments[0] == subject
        and isinstance(fact.arguments[1], Text)
    }
