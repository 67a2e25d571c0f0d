"""What a plan does to each object, in which order, and when."""

from collections.abc import Mapping
from dataclasses import dataclass

from cellwright.engine.model.forecast import earliest_starts
from cellwright.engine.model.stages import STAGE, stage_atom
from cellwright.kb.model.plan import START, Plan, StepId
from cellwright.kb.model.problem import Chain, Problem
from cellwright.kb.terms import Atom, Term, Text


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


def histories(
    problem: Problem, plan: Plan, starts: Mapping[StepId, int] | None = None
) -> tuple[History, ...]:
    """One history per chain of the workflow, read from the causal links of its stages.

    `starts` says when each step starts; None: as early as it can.
    """
    steps = {step.id: step for step in plan.steps}
    starts = earliest_starts(plan) if starts is None else starts
    found = []
    for chain in problem.chains:
        reached = reached_by(plan, chain)
        happenings = tuple(
            Happening(stage, step, starts[step], steps[step].duration)
            for n, stage in enumerate(chain.stages, 1)
            if (step := reached.get(n)) in steps
        )
        found.append(History(chain.subject, chain.name, _names(problem, chain.subject), happenings))
    return tuple(found)


def reached_by(plan: Plan, chain: Chain) -> dict[int, StepId]:
    """The steps that reach the stages of a chain, by the number of stages reached then, read from causal links.

    A step that reaches several stages provides the last of them. What held from the start, or was left to the end, is
    nobody's.
    """
    producers = {link.condition: link.producer for link in plan.links if link.condition.name == STAGE}
    found: dict[int, StepId] = {}
    step: StepId | None = None
    for number in range(len(chain.stages), 0, -1):
        step = producers.get(stage_atom(chain, number), step)
        if step is not None and step != START:
            found[number] = step
    return found


def _names(problem: Problem, subject: Term | None) -> dict[str, str]:
    """The texts that binary static facts of the problem give to an object, by predicate."""
    return {
        fact.name: fact.arguments[1].value
        for fact in problem.statics
        if len(fact.arguments) == 2 and fact.arguments[0] == subject and isinstance(fact.arguments[1], Text)
    }
