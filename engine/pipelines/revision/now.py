"""A plan revised for what is observed now, as it is given in words: steps done, facts, and what is lost."""

from engine.model.cases import Revision as Change
from engine.pipelines.barring import barred
from engine.pipelines.revision.changes import Changes
from engine.pipelines.revision.course import Course
from engine.pipelines.revision.observing import expected, following, observed, read_done, read_facts
from engine.pipelines.revision.remaining import rest_of
from engine.pipelines.revision.revise import PlanRevision, revise
from engine.pipelines.simulation import Dynamics
from engine.stages.planning import Limits
from kb.diagnostics import InvalidInput, Source, unknown_name
from kb.model.plan import Plan
from kb.model.problem import Problem
from kb.terms import Atom

Words = tuple[str, str, str, str]
"""The texts of --done, --holds, --gone and --lost."""


def revised_now(
    problem: Problem, plan: Plan, said: Words, limits: Limits = Limits(), both: bool = False
) -> tuple[PlanRevision, tuple[tuple[Atom, bool], ...]]:
    """The revised plan, and the facts that follow from what is said. Raises `InvalidInput`."""
    done, holds, gone, lost = said
    steps = read_done(done, plan)
    present, absent = read_facts(holds, problem.domain, "--holds"), read_facts(gone, problem.domain, "--gone")
    losses = _resources(lost, problem)
    rest, left = rest_of(problem, plan, steps)
    here = Course.of(barred(rest, losses), left)
    state = observed(here, expected(here, ()), present, absent)
    withdrawn = tuple((atom, "it is observed to be gone") for atom in absent if atom in rest.initial)
    changes = Changes(Dynamics(rest), Change(withdrawn=withdrawn, lost=losses))
    found = revise(
        here, (), state, limits, both, obstacles=changes.obstacles(state), free=changes.free(state)
    )
    return found, following(rest.initial, state, (*present, *absent))


def _resources(text: str, problem: Problem) -> tuple[str, ...]:
    """Names of objects or of resources. Raises `InvalidInput`."""
    resources = {str(each) for operator in problem.domain.operators for each in operator.resources}
    known = {*problem.domain.objects, *problem.objects, *resources}
    names = tuple(name.strip() for name in text.split(",") if name.strip())
    wrong = [
        unknown_name("resource", name, sorted(known), Source("--lost")) for name in names if name not in known
    ]
    if wrong:
        raise InvalidInput(wrong)
    return names
