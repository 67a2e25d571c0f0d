"""A plan revised for what is observed now, as it is given in words: steps done, facts, and what is lost."""

from collections.abc import Collection, Iterable, Iterator

from cellwright.engine.model.cases import Revision as Believed
from cellwright.engine.pipelines.barring import barred
from cellwright.engine.pipelines.revision.changes import Changes
from cellwright.engine.pipelines.revision.course import Course
from cellwright.engine.pipelines.revision.observing import (
    expected,
    following,
    observed,
    read_done,
    read_facts,
)
from cellwright.engine.pipelines.revision.remaining import rest_of
from cellwright.engine.pipelines.revision.revise import PlanRevision, Sequencer, no_sequence, revise
from cellwright.engine.pipelines.simulation import Dynamics
from cellwright.engine.stages.planning import Limits
from cellwright.kb.asp import AspError, ground_term
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, unknown_name
from cellwright.kb.model.plan import Plan
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Atom, Function, Number, Term, is_ground

LOST = Source("--lost")
Words = tuple[str, str, str, str]
"""The texts of --done, --holds, --gone and --lost."""


def revised_now(
    problem: Problem,
    plan: Plan,
    said: Words,
    limits: Limits = Limits(),
    both: bool = False,
    sequencer: Sequencer = no_sequence,
) -> tuple[PlanRevision, tuple[tuple[Atom, bool], ...]]:
    """The revised plan, and the facts that follow from what is said; see `revise`. Raises `InvalidInput`."""
    done, holds, gone, lost = said
    steps = read_done(done, plan)
    present, absent = read_facts(holds, problem.domain, "--holds"), read_facts(gone, problem.domain, "--gone")
    losses = _resources(lost, problem)
    rest, left = rest_of(problem, plan, steps)
    here = Course.of(barred(rest, losses), left)
    state = observed(here, expected(here, ()), present, absent)
    withdrawn = tuple((atom, "it is observed to be gone") for atom in absent if atom in rest.initial)
    follows = following(rest.initial, state, (*present, *absent))
    changes = Changes(Dynamics(rest), Believed(withdrawn=withdrawn, lost=losses, follows=follows))
    found = revise(here, (), state, limits, both, changes.obstacles(state), sequencer)
    return found, follows


def _resources(text: str, problem: Problem) -> tuple[str, ...]:
    """Names of objects or of resources, or terms such as `slot(freezer, 1)`. Raises `InvalidInput`."""
    resources = {str(each) for o in problem.domain.operators for each in o.resources if is_ground(each)}
    known = {*problem.domain.objects, *problem.objects, *resources}
    try:
        listed = ground_term(f"lost({text})") if text.strip() else Function("lost")
    except AspError as error:
        hint = "write names and terms, separated by commas: mars_gripper, slot(freezer, 1)"
        raise InvalidInput([Diagnostic(LOST, "K107", f"'{text}' is not a list: {error}", hint)]) from None
    terms = listed.arguments if isinstance(listed, Function) else ()
    names = [*_unknown(terms, problem, known), *(str(each) for each in terms if isinstance(each, Number))]
    wrong = [unknown_name("resource", name, sorted(known), LOST) for name in names]
    if wrong:
        raise InvalidInput(wrong)
    return tuple(map(str, terms))


def _unknown(terms: Iterable[Term], problem: Problem, known: Collection[str]) -> Iterator[str]:
    """The names in some terms that nothing of the problem has."""
    for each in terms:
        if isinstance(each, Function) and each.arguments and each.name in problem.domain.functions:
            yield from _unknown(each.arguments, problem, known)
        elif not isinstance(each, Number) and str(each) not in known:
            yield str(each)
