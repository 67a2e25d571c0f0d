"""How the work goes on after a diagnosis.

The plan that failed is revised before anything is planned anew. A kept sequence is updated by what was lost.
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
    """How the work goes on: the problem from the state as it is now known, and the answer for the original goals.

    `way` is `planned` if no plan had failed. Otherwise it says what became of the remaining steps: done (nothing is left to
    do), continued, repaired, or replanned (no repair was found, or a new plan is cheaper). `sequence` is the kept sequence
    after the update by what was lost.
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
    """A plan from the revised state to the goals of the problem, without the lost resources. Raises `InvalidInput`.

    `left` are the steps that were not done when a plan failed; they start from the problem's initial state. They are
    revised before anything is planned anew.
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
    """The problem that is left when the steps `done` have had their effects, and the plan of the other steps."""
    here = Situation.of(CellDomain(problem), Semantics(problem).initial())
    facts = here.facts
    changes = changes_of(here, [step for step in plan.steps if step.id in done])
    for change in changes:
        facts = change.applied(facts)
    reached = stages_reached(problem.chains, changes)
    steps = (
        replace(step, after=tuple(each for each in step.after if each not in done))
        for step in plan.steps
        if step.id not in done
    )
    return remaining(problem, reached, facts), Plan(tuple(steps))


def told(found: Recovery, problem: Problem, lost: Collection[str], store: str) -> Recovery:
    """The recovery with the kept sequence of the problem from `store`, after its update by what was lost."""
    if not lost:
        return found
    return replace(found, sequence=told_of_losses(store, problem.replace(found.problem.initial), lost))


def _without(problem: Problem, lost: Sequence[str]) -> Problem:
    """The problem without the operator instances that use a lost resource."""
    if not lost:
        return problem
    gone = [Function(name) for name in lost]
    kept = [each for each in problem.domain.operators if not set(gone) & set(each.resources)]
    operators = tuple(replace(each, body=(*each.body, *_spared(each, gone))) for each in kept)
    return replace(problem, domain=replace(problem.domain, operators=operators))


def _spared(operator: Operator, gone: Sequence[Function]) -> Iterator[Comparison]:
    """Conditions by which no variable resource of an operator is a lost one."""
    for resource in operator.resources:
        if isinstance(resource, Variable):
            yield from (Comparison(resource, "!=", each) for each in gone)
