"""What bounds the makespan of a plan: a resource that never rests, or a chain of steps that wait for one another."""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from cellwright.kb.model.plan import Plan, Step, StepId
from cellwright.kb.terms import Term


@dataclass(frozen=True, slots=True)
class Share:
    """How long the steps of one operator last together."""

    operator: str
    steps: int
    time: int


@dataclass(frozen=True, slots=True)
class Bottleneck:
    """The steps that make up a makespan, by operator, the longest first.

    `resource` holds them all and never rests; without one they are a chain, with `waiting` between its steps.
    """

    resource: Term | None
    shares: tuple[Share, ...]
    waiting: int = 0


def bottleneck(plan: Plan, starts: Mapping[StepId, int]) -> Bottleneck:
    """What bounds the makespan of a plan whose steps start at `starts`."""
    ends = {step.id: starts[step.id] + step.duration for step in plan.steps}
    last = max(ends.values(), default=0)
    loads: Counter[Term] = Counter()
    for step in plan.steps:
        for resource in step.resources:
            loads[resource] += step.duration
    busiest = min(loads, key=lambda each: (-loads[each], str(each)), default=None)
    if busiest is not None and loads[busiest] == last:
        return Bottleneck(busiest, _shares(step for step in plan.steps if busiest in step.resources))
    chain = _chain(plan, ends)
    return Bottleneck(None, _shares(chain), last - sum(step.duration for step in chain))


def _chain(plan: Plan, ends: Mapping[StepId, int]) -> list[Step]:
    """The steps from the last one back, each with the one that it waits for longest."""
    steps = {step.id: step for step in plan.steps}
    chain: list[Step] = []
    at = max(ends, key=lambda each: (ends[each], -each), default=None)
    while at is not None:
        chain.append(steps[at])
        at = max(steps[at].after, key=lambda each: (ends[each], -each), default=None)
    return chain[::-1]


def _shares(steps: Iterable[Step]) -> tuple[Share, ...]:
    times, counts = Counter[str](), Counter[str]()
    for step in steps:
        times[step.operator.name] += step.duration
        counts[step.operator.name] += 1
    found = (Share(name, counts[name], time) for name, time in times.items() if time)
    return tuple(sorted(found, key=lambda each: (-each.time, each.operator)))
