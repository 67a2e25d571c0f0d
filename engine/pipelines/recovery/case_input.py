"""Input of a case as texts: interrupted step, steps done, observed facts, scripted outcomes."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from cellwright.engine.model.troubleshooting import Action, CaseAdvice, CaseHypothesis, Observation
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.pipelines.recovery import Dynamics, StepAchievement, WorldState
from cellwright.engine.pipelines.recovery.observations import (
    correct_state,
    following_facts,
    read_done,
    read_facts,
)
from cellwright.engine.pipelines.recovery.remaining_problem import left_over, remaining_problem
from cellwright.engine.pipelines.recovery.world_model import plan_history
from cellwright.engine.stages.diagnosis.case_session import QUESTION, Answerer
from cellwright.engine.stages.diagnosis.fault_problems import CURED, NOT_CURED
from cellwright.kb.asp import AspError, ground_term
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, nearest_hint, unknown_name
from cellwright.kb.files import read_file
from cellwright.kb.json_text import parse_json
from cellwright.kb.loader import Loaded
from cellwright.kb.model.fault_model import FaultModel, Interruption
from cellwright.kb.model.plan_model import Plan, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.numbers import NumberError, read_decimal
from cellwright.kb.store.case_store import ClosedCase
from cellwright.kb.terms import Atom, Function, Term, sort_naturally

STEP_OPTION, OUTCOMES = Source("--step"), Source("--outcomes")


@dataclass(frozen=True, slots=True)
class FailedPlan:
    """The plan that failed, as texts: its file, the step that was interrupted, and the steps done
    (`1..4, 7`).

    If `done` is empty, the steps listed before the interrupted step are done.
    """

    file: Path
    step: str = ""
    done: str = ""


@dataclass(frozen=True, slots=True)
class ObservedFacts:
    """What was observed of the world when the exception was noticed, as it is given: facts that
    hold, and facts that do not.
    """

    holds: str = ""
    gone: str = ""


@dataclass(frozen=True, slots=True)
class ExceptionMoment:
    """When an exception was noticed: the problem, the steps done, and the state in which the
    interrupted step began.

    `rest` is what was left of the problem then, and `left` are the steps that were left of the
    plan, if one had been made. `assumed` are facts that the step needs though nothing said that
    they held; `follows` is what follows from the facts that were observed.
    """

    problem: Problem
    rest: Problem
    before: WorldState
    done: tuple[StepAchievement, ...] = ()
    left: Plan | None = None
    assumed: tuple[tuple[Atom, str], ...] = ()
    follows: tuple[tuple[Atom, bool], ...] = ()


def loaded_moment(
    loaded: Loaded,
    step: Function | None,
    failed: FailedPlan | None,
    seen: ObservedFacts = ObservedFacts(),
) -> ExceptionMoment | None:
    """The moment of an exception; None for a domain alone. Raises `InvalidInput`."""
    if failed is None:
        if loaded.problem is None and seen != ObservedFacts():
            hint = "give a problem as the target"
            raise InvalidInput(
                [Diagnostic(Source("--holds"), "K404", "a domain has no state", hint)]
            )
        return exception_moment(loaded.problem, step, seen=seen) if loaded.problem else None
    problem, plan = checked_plan.plan_in(failed.file)
    where = Source(str(failed.file))
    named = (
        problem.name if loaded.problem is None else loaded.problem.name
    )  # a domain, and a plan of a command
    if (problem.domain.name, problem.name) != (loaded.domain.name, named):
        hint = "give the plan's own problem as the target, or its domain"
        raise InvalidInput(
            [Diagnostic(where, "K412", f"this is a plan for another problem, {problem.name}", hint)]
        )
    if wrong := checked_plan.check_plan(problem, plan):
        raise InvalidInput(wrong)
    return exception_moment(problem, step, plan, _steps_done(plan, failed), seen)


def exception_moment(
    problem: Problem,
    step: Function | None,
    plan: Plan | None = None,
    done: Sequence[StepId] = (),
    seen: ObservedFacts = ObservedFacts(),
) -> ExceptionMoment:
    """The moment when a step was interrupted, after the steps of a plan that are done.

    Raises `InvalidInput`.
    """
    dynamics = Dynamics(problem)
    if step is not None and isinstance(why := dynamics.semantics.binding(step), str):
        raise InvalidInput([Diagnostic(STEP_OPTION, "K906", f"there is no step {step}: {why}", "")])
    expected, achieved = plan_history(dynamics, plan or Plan(()), done)
    holds, gone = (
        read_facts(text, problem.domain, option)
        for text, option in ((seen.holds, "--holds"), (seen.gone, "--gone"))
    )
    facts = frozenset(correct_state(dynamics, expected.facts, holds, gone))
    state = replace(expected, facts=facts)
    before = dynamics.presupposed(step, state) if step is not None else state
    assumed = tuple(
        (atom, f"{step} was under way") for atom in sort_naturally(before.facts - facts)
    )
    rest = remaining_problem(problem, before.reached, before.facts)
    follows = following_facts(expected.facts, facts, (*holds, *gone))
    rest_plan = left_over(plan, done) if plan else None
    return ExceptionMoment(problem, rest, before, achieved, rest_plan, assumed, follows)


def number_steps(failed: FailedPlan) -> tuple[FailedPlan, str]:
    """The step that is named by its number in the plan, as it is written there, and the steps
    before it as done unless they are given.

    Raises `InvalidInput`.
    """
    _, plan = checked_plan.plan_in(failed.file)
    ids = [step.id for step in plan.steps]
    if int(failed.step) not in ids:
        hint = f"its steps are {ids[0]} to {ids[-1]}" if ids else "it has no steps"
        raise InvalidInput(
            [Diagnostic(STEP_OPTION, "K410", f"the plan has no step {failed.step}", hint)]
        )
    place = ids.index(StepId(int(failed.step)))
    step = str(plan.steps[place].operator)
    return FailedPlan(failed.file, step, failed.done or ", ".join(map(str, ids[:place]))), step


def _steps_done(plan: Plan, failed: FailedPlan) -> list[StepId]:
    if failed.done:
        return read_done(failed.done, plan)
    try:
        step_name = str(ground_term(failed.step)) if failed.step else ""
    except AspError:
        step_name = failed.step
    for number, step in enumerate(plan.steps):
        if str(step.operator) == step_name:
            return [step.id for step in plan.steps[:number]]
    if not failed.step:
        hint = "name a step of the plan with --step, or the steps that are done with --done"
        raise InvalidInput(
            [Diagnostic(STEP_OPTION, "K410", "which step of the plan was interrupted?", hint)]
        )
    hint = nearest_hint(step_name, [str(step.operator) for step in plan.steps])
    hint = hint or "name one of its steps, or the steps that are done with --done"
    raise InvalidInput([Diagnostic(STEP_OPTION, "K410", f"the plan has no step {step_name}", hint)])


def read_step(text: str, loaded: Loaded, exception: Interruption) -> Function | None:
    """The step that an exception interrupted; None if the text is empty. Raises `InvalidInput`
    for any other step.
    """
    if not text:
        return None
    hint = (
        f"write it as in a plan: {exception.operator or 'move(arm, table)'}; with --plan, its "
        "number will do"
    )
    try:
        step = ground_term(text)
    except AspError as error:
        raise InvalidInput([Diagnostic(STEP_OPTION, "K107", str(error), hint)]) from None
    if not isinstance(step, Function):
        raise InvalidInput([Diagnostic(STEP_OPTION, "K107", "this is not a step", hint)])
    pattern = exception.operator
    if pattern is None or (step.name, len(step.arguments)) != (
        pattern.name,
        len(pattern.arguments),
    ):
        message = f"{exception.name} does not interrupt {step}"
        raise InvalidInput([Diagnostic(STEP_OPTION, "K906", message, hint)])
    known_objects = {**loaded.domain.objects, **(loaded.problem.objects if loaded.problem else {})}
    constants = {
        name for type_entry in loaded.domain.types.values() for name in type_entry.constants
    }
    if loaded.problem is not None:
        _require_known(step.arguments, {*known_objects, *constants}, [*loaded.domain.functions])
    return step


def _require_known(
    terms: Collection[Term], objects: Collection[str], functions: Collection[str]
) -> None:
    for term in terms:
        if isinstance(term, Function) and term.name not in functions and term.name not in objects:
            raise InvalidInput([unknown_name("object", term.name, sorted(objects), STEP_OPTION)])
        if isinstance(term, Function):
            _require_known(term.arguments, objects, functions)


@dataclass(frozen=True, slots=True)
class Scripted:
    """Outcomes that were seen, in their order, and the answer to the question of a safe stop.

    It is an `Answerer`.
    """

    seen: tuple[Observation, ...]
    answer: str | None = None

    def __call__(self, action: Action, _: CaseAdvice) -> str | None:
        """The answer to a question; the case ends at a test for which no outcome was given."""
        return self.answer if action.name == QUESTION else None


def seen_before(answer: Answerer) -> tuple[Observation, ...]:
    """The outcomes that were seen before anything is asked: those of a list."""
    return answer.seen if isinstance(answer, Scripted) else ()


def scripted_answerer(model: FaultModel, text: str) -> Scripted:
    """The outcomes in a list `test=outcome, ...`. Raises `InvalidInput`."""
    known_actions = {**model.tests, **model.repairs}
    seen: list[Observation] = []
    answer: str | None = None
    for part in filter(None, (part_text.strip() for part_text in text.split(","))):
        name, _, outcome = (half.strip() for half in part.partition("="))
        if name == QUESTION:
            answer = outcome
            continue
        if name not in known_actions:
            raise InvalidInput([unknown_name("test or repair", name, known_actions, OUTCOMES)])
        possible = model.tests[name].outcomes if name in model.tests else (CURED, NOT_CURED)
        if outcome not in possible:
            raise InvalidInput([unknown_name("outcome", outcome, possible, OUTCOMES)])
        seen.append(Observation(name, outcome))
    if wrong := list(_contradictions(model, seen)):
        raise InvalidInput(wrong)
    cures = [each for each in seen if each.outcome == CURED and each.action in model.repairs]
    return Scripted((*(each for each in seen if each not in cures), *cures), answer)


def _contradictions(model: FaultModel, seen: Sequence[Observation]) -> Iterator[Diagnostic]:
    """Errors for a test that shows several outcomes though it always shows the same, and for
    several cures.
    """
    for name in dict.fromkeys(each.action for each in seen):
        shown = [each.outcome for each in seen if each.action == name]
        most = model.tests[name].repeats if name in model.tests else 1
        if len(set(shown)) > 1 and len(shown) > most:
            said = f"'{name}' shows {' and '.join(dict.fromkeys(shown))}"
            often = (
                f"{most} independent outcomes"
                if most > 1
                else "the same outcome whenever it is repeated"
            )
            hint = "leave one out; `repeats` of a test says how often its outcomes are independent"
            yield Diagnostic(OUTCOMES, "K907", f"{said}, and it has {often}", hint)
    cures = dict.fromkeys(
        each.action for each in seen if each.outcome == CURED and each.action in model.repairs
    )
    if len(cures) > 1:
        yield Diagnostic(
            OUTCOMES,
            "K907",
            f"{' and '.join(cures)} have both put it right",
            "name the one that did",
        )


def hidden_hypothesis(model: FaultModel, text: str) -> CaseHypothesis:
    """The hidden causes of a simulated case, from their names with commas.

    Raises `InvalidInput`.
    """
    causes = tuple(cause.strip() for cause in text.split(",") if cause.strip())
    for cause in causes:
        if cause not in model.causes:
            raise InvalidInput([unknown_name("cause", cause, model.causes, Source("--hidden"))])
    return CaseHypothesis(causes)


def import_counts(model: FaultModel, path: Path) -> list[ClosedCase]:
    """The counts in a JSON file {exception: {cause: count}}, as weighted closed cases.

    Raises `InvalidInput`.
    """
    try:
        content = parse_json(read_file(path).text)
        pairs = [
            (e, c, read_decimal(str(n))) for e, causes in content.items() for c, n in causes.items()
        ]
    except NumberError as error:
        raise InvalidInput(
            [Diagnostic(Source(str(path)), "K413", f"a count {error}", "count cases")]
        ) from None
    except (ValueError, AttributeError, TypeError) as error:
        hint = "write it as {exception: {cause: count}}"
        raise InvalidInput(
            [Diagnostic(Source(str(path)), "K413", f"the file does not hold counts: {error}", hint)]
        ) from None
    for exception, cause, _ in pairs:
        if exception not in model.exceptions:
            raise InvalidInput(
                [unknown_name("exception", exception, model.exceptions, Source(str(path)))]
            )
        if cause not in model.exceptions[exception].counts:
            known_counts = model.exceptions[exception].counts
            raise InvalidInput([unknown_name("cause", cause, known_counts, Source(str(path)))])
    return [ClosedCase(model.domain, e, (c,), weight=n) for e, c, n in pairs if n > 0]
