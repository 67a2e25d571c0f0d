"""When the steps of a plan can run: earliest starts, the makespan, and what is done to each object in which order.

Start times are a forecast; the orders between steps are what a plan promises.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from kb.model.plan import GOAL, Plan, StepId
from kb.model.problem import Chain, Problem
from kb.terms import Atom, Function, Number, Term, Text

STAGE = "_stage"


def stage_atom(chain: Chain, reached: int) -> Atom:
    """The fluent that says how many stages of a chain are reached."""
    return Function(STAGE, (Text(chain.name), Number(reached)))


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


@dataclass(frozen=True, slots=True)
class Happening:
    """A stage that a step reaches: from `start` for `duration`."""

    stage: Atom
    step: StepId
    start: int
    duration: int


@dataclass(frozen=True, slots=True)
class History:
    """What a plan does to one object: the stages of its chain, in order. `names` are texts that statics give it."""

    subject: Term | None
    chain: str
    names: Mapping[str, str]
    happenings: tuple[Happening, ...]


def histories(problem: Problem, plan: Plan) -> tuple[History, ...]:
    """One history per chain of the workflow, read from the causal links of its stages."""
    producers = {link.condition: link.producer for link in plan.links if link.condition.name == STAGE}
    steps = {step.id: step for step in plan.steps}
    starts = earliest_starts(plan)
    found = []
    for chain in problem.chains:
        reached = [(stage, producers.get(stage_atom(chain, n))) for n, stage in enumerate(chain.stages, 1)]
        happenings = tuple(
            Happening(stage, step, starts[step], steps[step].duration)
            for stage, step in reached
            if step is not None and step in steps
        )
        found.append(History(chain.subject, chain.name, _names(problem, chain.subject), happenings))
    return tuple(found)


def _names(problem: Problem, subject: Term | None) -> dict[str, str]:
    """Texts that binary static facts of the problem give to an object, by predicate."""
    return {
        fact.name: fact.arguments[1].value
        for fact in problem.statics
        if len(fact.arguments) == 2 and fact.arguments[0] == subject and isinstance(fact.arguments[1], Text)
    }


def purposes(problem: Problem, plan: Plan) -> dict[StepId, dict[str, list[str]]]:
    """For each step what it achieves, and for which steps ("goal" for the goal): why it is there."""
    say = wording(problem)
    found: dict[StepId, dict[str, list[str]]] = {}
    for link in plan.links:
        consumer = "goal" if link.consumer == GOAL else str(link.consumer)
        consumers = found.setdefault(link.producer, {}).setdefault(say(link.condition), [])
        if consumer not in consumers:
            consumers.append(consumer)
    return found


def wording(problem: Problem | None) -> Callable[[Atom], str]:
    """How conditions are said: stages of the problem's workflow as their own atoms, `not p` for `not(p)`."""
    chains = problem.chains if problem else ()
    stages = {stage_atom(c, n): str(stage) for c in chains for n, stage in enumerate(c.stages, 1)}
    stages |= {stage_atom(chain, 0): f"before {chain.stages[0]}" for chain in chains if chain.stages}

    def say(condition: Atom) -> str:
        return stages.get(condition) or plainly(condition)

    return say


def plainly(condition: Atom) -> str:
    """A condition as people write it: `not p` for `not(p)`."""
    negative = condition.name == "not" and len(condition.arguments) == 1
    return f"not {condition.arguments[0]}" if negative else str(condition)
