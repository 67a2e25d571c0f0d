"""How it goes on after a diagnosis: the plan that failed is revised before anything is planned anew, and what was lost is
passed on to the sequence that is kept.
"""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace

from engine.model.cases import Revision
from engine.model.outcome import Outcome
from engine.pipelines import planning
from engine.pipelines.inspection.keeping import told_of_losses
from engine.pipelines.inspection.progress import Progress
from engine.pipelines.revision import Course, remaining, revise
from engine.pipelines.revision.remaining import stages_reached
from engine.stages.diagnosis.revision import revised
from engine.stages.macros.lifted.execution import changes_of
from engine.stages.macros.lifted.situation import Situation
from engine.stages.macros.lifted.world import CellDomain
from engine.stages.planning import Limits
from engine.stages.validation.semantics import Semantics
from kb.model.conditions import Comparison
from kb.model.domain import Operator
from kb.model.plan import Plan, Step, StepId
from kb.model.problem import Problem
from kb.terms import Function, Variable


@dataclass(frozen=True, slots=True)
class Recovery:
    """How the case goes on: the state as it is now known, and the answer for the original goals.

    `way` is `planned` where no plan had failed, else what became of its remaining steps: done (nothing is left to do),
    continued, repaired, or replanned where no repair was found or a new plan is cheaper. `sequence` is the kept sequence
    after it was told what was lost.
    """

    problem: Problem
    outcome: Outcome
    way: str = "planned"
    kept: tuple[Step, ...] = ()
    dropped: tuple[Step, ...] = ()
    added: tuple[Step, ...] = ()
    sequence: Progress | None = None


def recover(
    problem: Problem, change: Revision, limits: Limits = Limits(), left: Plan | None = None
) -> Recovery:
    """From the revised state to the goals that the failed plan had. What was lost is no longer there to be used.

    `left` are the steps that were not done when the plan failed, from the problem's initial state on: they are revised
    before anything is planned anew. Raises `InvalidInput`.
    """
    state = tuple(sorted(Semantics(problem).initial(), key=str))
    usable = _without(problem, change.lost)
    now = revised(state, change)
    if left is None:
        seen = usable.replace(now)
        return Recovery(seen, planning.plan(seen, limits))
    found = revise(Course.of(usable.replace(state), left), (), now, limits)
    return Recovery(found.problem, found.outcome, found.way, found.kept, found.dropped, found.added)


def rest_of(problem: Problem, plan: Plan, done: Collection[StepId]) -> tuple[Problem, Plan]:
    """What is left of a problem after some steps of a plan for it, had each done what it should, and the other steps."""
    here = Situation.of(CellDomain(problem), Semantics(problem).initial())
    facts = here.facts
    changes = changes_of(here, [step for step in plan.steps if step.id in done])
    for change in changes:
        facts = change.applied(facts)
    reached = stages_reached(problem.chains, here, changes)
    steps = (
        replace(step, after=tuple(each for each in step.after if each not in done))
        for step in plan.steps
        if step.id not in done
    )
    return remaining(problem, reached, facts), Plan(tuple(steps))


def told(found: Recovery, problem: Problem, lost: Collection[str], store: str) -> Recovery:
    """The recovery with the sequence that a store keeps of the problem, after it was told what was lost."""
    if not lost:
        return found
    return replace(found, sequence=told_of_losses(store, problem.replace(found.problem.initial), lost))


def _without(problem: Problem, lost: Sequence[str]) -> Problem:
    """The problem without the steps that would use a lost resource."""
    if not lost:
        return problem
    gone = [Function(name) for name in lost]
    kept = [each for each in problem.domain.operators if not set(gone) & set(each.resources)]
    operators = tuple(replace(each, body=(*each.body, *_spared(each, gone))) for each in kept)
    return replace(problem, domain=replace(problem.domain, operators=operators))


def _spared(operator: Operator, gone: Sequence[Function]) -> Iterator[Comparison]:
    """That no resource of an operator is one that was lost."""
    for resource in operator.resources:
        if isinstance(resource, Variable):
            yield from (Comparison(resource, "!=", each) for each in gone)
