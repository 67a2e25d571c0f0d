"""Read the texts that describe a case: the interrupted step, scripted outcomes, hidden causes, counts to import."""

import json
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

from engine.model.cases import Hypothesis
from engine.pipelines import planning
from engine.pipelines.revision.observing import read_steps
from engine.pipelines.troubleshooting.recovery import rest_of
from engine.stages.diagnosis.knowledge import CURED, NOT_CURED
from engine.stages.diagnosis.session import QUESTION, Answerer
from kb.asp import AspError, ground_term
from kb.diagnostics import Diagnostic, InvalidInput, Source, unknown_name
from kb.files import read_file
from kb.loader import Loaded
from kb.loader.plan import load_plan
from kb.model.faults import FaultModel, Interruption
from kb.model.plan import Plan, StepId
from kb.model.problem import Problem
from kb.store.cases import ClosedCase
from kb.terms import Function, Term

STEP = Source("--step")


@dataclass(frozen=True, slots=True)
class Failed:
    """The plan that failed, as texts: its file, the step that was interrupted, and the steps done (`1..4, 7`).

    If `done` is empty, the steps listed before the interrupted step are done.
    """

    file: Path
    step: str = ""
    done: str = ""


def left_of(loaded: Loaded, failed: Failed) -> tuple[Problem, Plan]:
    """The problem that was left when its plan failed, and the steps that were left. Raises `InvalidInput`."""
    problem, plan = load_plan(failed.file)
    where = Source(str(failed.file))
    if loaded.problem is None or (problem.domain.name, problem.name) != (
        loaded.domain.name,
        loaded.problem.name,
    ):
        hint = "give the problem as the target, and a plan for it"
        raise InvalidInput(
            [Diagnostic(where, "K412", f"this is a plan for another problem, {problem.name}", hint)]
        )
    if wrong := planning.check_plan(problem, plan):
        raise InvalidInput(wrong)
    done = {*_done(plan, failed)}
    return rest_of(problem, plan, done)


def _done(plan: Plan, failed: Failed) -> list[StepId]:
    if failed.done:
        return _whole(plan, read_steps(failed.done, [step.id for step in plan.steps]))
    try:
        wanted = str(ground_term(failed.step)) if failed.step else ""
    except AspError:
        wanted = failed.step
    for number, step in enumerate(plan.steps):
        if str(step.operator) == wanted:
            return [each.id for each in plan.steps[:number]]
    hint = "name a step of the plan with --step, or the steps that are done with --done"
    raise InvalidInput([Diagnostic(STEP, "K410", "which step of the plan was interrupted?", hint)])


def _whole(plan: Plan, done: list[StepId]) -> list[StepId]:
    """The steps `done`, after a check that they include every step before them. Raises `InvalidInput`."""
    before = plan.predecessors()
    for step in done:
        if missing := before[step] - set(done):
            said = f"step {step} cannot be done before step {min(missing)}"
            raise InvalidInput([Diagnostic(Source("--done"), "K411", said, "name every step that is done")])
    return done


def read_step(text: str, loaded: Loaded, exception: Interruption) -> Function | None:
    """The step that an exception interrupted; None if the text is empty. Raises `InvalidInput` for any other step."""
    if not text:
        return None
    hint = f"write it as in a plan: {exception.operator or 'move(arm, table)'}"
    try:
        found = ground_term(text)
    except AspError as error:
        raise InvalidInput([Diagnostic(STEP, "K107", str(error), hint)]) from None
    if not isinstance(found, Function):
        raise InvalidInput([Diagnostic(STEP, "K107", "this is not a step", hint)])
    pattern = exception.operator
    if pattern is None or (found.name, len(found.arguments)) != (pattern.name, len(pattern.arguments)):
        message = f"{exception.name} does not interrupt {found}"
        raise InvalidInput([Diagnostic(STEP, "K906", message, hint)])
    known = {**loaded.domain.objects, **(loaded.problem.objects if loaded.problem else {})}
    constants = {name for each in loaded.domain.types.values() for name in each.constants}
    if loaded.problem is not None:
        _require_known(found.arguments, {*known, *constants}, [*loaded.domain.functions])
    return found


def _require_known(terms: Collection[Term], objects: Collection[str], functions: Collection[str]) -> None:
    for term in terms:
        if isinstance(term, Function) and term.name not in functions and term.name not in objects:
            raise InvalidInput([unknown_name("object", term.name, sorted(objects), STEP)])
        if isinstance(term, Function):
            _require_known(term.arguments, objects, functions)


def scripted(model: FaultModel, text: str) -> Answerer:
    """An answer for each test in a list `test=outcome, ...`. The case ends at any other test. Raises `InvalidInput`."""
    known = {**model.tests, **model.repairs}
    given: dict[str, str] = {}
    for part in filter(None, (each.strip() for each in text.split(","))):
        name, _, outcome = (each.strip() for each in part.partition("="))
        if name == QUESTION:
            given[name] = outcome
            continue
        if name not in known:
            raise InvalidInput([unknown_name("test or repair", name, known, Source("--outcomes"))])
        possible = model.tests[name].outcomes if name in model.tests else (CURED, NOT_CURED)
        if outcome not in possible:
            raise InvalidInput([unknown_name("outcome", outcome, possible, Source("--outcomes"))])
        given[name] = outcome
    return lambda action, _advice: given.get(action.name)


def hidden_hypothesis(model: FaultModel, text: str) -> Hypothesis:
    """The hidden causes of a simulated case, from their names with commas. Raises `InvalidInput`."""
    causes = tuple(each.strip() for each in text.split(",") if each.strip())
    for cause in causes:
        if cause not in model.causes:
            raise InvalidInput([unknown_name("cause", cause, model.causes, Source("--hidden"))])
    return Hypothesis(causes)


def imported(model: FaultModel, path: Path) -> list[ClosedCase]:
    """The counts in a JSON file {exception: {cause: count}}, as weighted closed cases. Raises `InvalidInput`."""
    try:
        given = json.loads(read_file(path).text)
        pairs = [(e, c, float(n)) for e, causes in given.items() for c, n in causes.items()]
    except (ValueError, AttributeError, TypeError, RecursionError) as error:
        hint = "write it as {exception: {cause: count}}"
        raise InvalidInput(
            [Diagnostic(Source(str(path)), "K413", f"the file does not hold counts: {error}", hint)]
        ) from None
    for exception, cause, _ in pairs:
        if exception not in model.exceptions:
            raise InvalidInput([unknown_name("exception", exception, model.exceptions, Source(str(path)))])
        if cause not in model.exceptions[exception].counts:
            known = model.exceptions[exception].counts
            raise InvalidInput([unknown_name("cause", cause, known, Source(str(path)))])
    return [ClosedCase(model.domain, e, (c,), weight=n) for e, c, n in pairs if n > 0]
