"""What a plan does to each object, in which order, and when."""

from collections.abc import Mapping
from dataclasses import dataclass

from engine.model.forecast import earliest_starts
from engine.model.stages import STAGE, stage_atom
from kb.model.plan import Plan, StepId
from kb.model.problem import Problem
from kb.terms import Atom, Term, Text


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
    producers = {link.condition: link.producer for link in plan.links if link.condition.name == STAGE}
    steps = {step.id: step for step in plan.steps}
    starts = earliest_starts(plan) if starts is None else starts
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
    """The texts that binary static facts of the problem give to an object, by predicate."""
    return {
        fact.name: fact.arguments[1].value
        for fact in problem.statics
        if len(fact.arguments) == 2 and fact.arguments[0] == subject and isinstance(fact.arguments[1], Text)
    }
