"""The verb `diagnose`: the cause of an exception by the cheapest tests, and closed cases."""

import sys
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from cellwright.engine.faces.cli.options.shared_options import (
    Seed,
    Target,
    TimeLimit,
    number_option,
)
from cellwright.engine.faces.cli.output import terminal_console
from cellwright.engine.faces.cli.output.answer_output import AnswerForm, VerbAnswer, give_answer
from cellwright.engine.faces.cli.process.exit_codes import GAVE_UP, INTERRUPTED
from cellwright.engine.faces.cli.process.progress_line import hushing_progress
from cellwright.engine.faces.cli.process.search_interruption import SearchInterruption
from cellwright.engine.faces.cli.wrong_options import make_misfit, refuse_idle
from cellwright.engine.formats import report
from cellwright.engine.formats.report import rich_parts
from cellwright.engine.model.noun_wording import count_noun
from cellwright.kb import store as kb_store
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.numbers import is_count

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cellwright.engine.model.troubleshooting import Action, CaseAdvice, CaseDiagnosis
    from cellwright.engine.pipelines.recovery.diagnosis_case import DiagnosisCase
    from cellwright.engine.stages.diagnosis.case_session import Answerer, CaseSession
    from cellwright.kb.store.case_store import Cases


class DiagnosisForm(StrEnum):
    """How a diagnosis is written. A picture can only show the whole tree."""

    TEXT = "text"
    JSON = "json"
    SVG = "svg"


class CaseGoal(StrEnum):
    """What a case should achieve."""

    ISOLATE = "isolate"
    REPAIR = "repair"


ExceptionName = Annotated[
    str, Option("--exception", help="the exception, by its name in faults.yaml")
]
Step = Annotated[
    str,
    Option(
        "--step",
        help="the step it interrupted: us_measure(us_probe, t3_746, m1), or its number_option in "
        "--plan",
    ),
]
Outcomes = Annotated[
    str, Option("--outcomes", help="scripted outcomes: look_at_spot=dry, tool_self_test=passed")
]
Hidden = Annotated[
    str,
    Option("--hidden", help="simulate: the causes that are really present, separated by commas"),
]
WholeTree = Annotated[bool, Option("--tree", help="print the whole decision tree")]
Explain = Annotated[bool, Option("--explain", help="say why this test is next")]
Objective = Annotated[
    CaseGoal | None,
    Option(
        "--objective",
        help="find the cause, or repair the fault; if not given, repair where only unsure tests "
        "tell causes apart",
    ),
]
Certainty = Annotated[
    float | None,
    Option(
        "--certainty",
        min=0,
        max=1,
        callback=number_option,
        help="the probability with which a cause counts as found; if not given, 1, or 0.95 where "
        "tests are not sure",
    ),
]
Recover = Annotated[
    bool, Option("--recover", help="then plan from the state found to the goals of the problem")
]
FailedPlan = Annotated[
    Path | None,
    Option("--plan", help="the plan that failed, in JSON: its repair is tried before a new plan"),
]
Done = Annotated[
    str,
    Option(
        "--done",
        help="the steps of the plan that are done, such as 1..4, 7; if not given, all before "
        "--step",
    ),
]
Holds = Annotated[str, Option("--holds", help="facts that are seen to hold, against the model")]
Gone = Annotated[str, Option("--gone", help="facts that are seen not to hold any more")]
Store = Annotated[
    str, Option("--store", help="keep closed cases in this file or database, and learn from them")
]
History = Annotated[bool, Option("--history", help="print the closed cases of the store")]
Age = Annotated[
    float | None,
    Option(
        "--age",
        min=0,
        max=1,
        callback=number_option,
        help="multiply the weights of closed cases by this number_option",
    ),
]
Reset = Annotated[bool, Option("--reset", help="forget the closed cases of this domain")]
Counts = Annotated[Path | None, Option("--import", help="JSON to add: {exception: {cause: count}}")]
Work = Annotated[
    int | None,
    Option(
        "--expansions",
        min=0,
        help="states that the exact search may expand; if not given, about a second's work",
    ),
]
Shown = Annotated[DiagnosisForm, Option("--format", help="how the answer is written")]


def diagnose_target(
    target: Target,
    exception: ExceptionName = "",
    step: Step = "",
    outcomes: Outcomes = "",
    hidden: Hidden = "",
    tree: WholeTree = False,
    explain: Explain = False,
    objective: Objective = None,
    certainty: Certainty = None,
    recover: Recover = False,
    plan: FailedPlan = None,
    done: Done = "",
    holds: Holds = "",
    gone: Gone = "",
    store: Store = "",
    history: History = False,
    age: Age = None,
    reset: Reset = False,
    counts: Counts = None,
    format: Shown = DiagnosisForm.TEXT,
    expansions: Work = None,
    time_limit: TimeLimit = None,
    seed: Seed = 0,
) -> None:
    """Find the cause of an exception of TARGET: ask for outcomes, read them from a list, or
    print the whole tree.
    """
    form = AnswerForm.JSON if format is DiagnosisForm.JSON else AnswerForm.TEXT
    asked = DiagnosisRequest(
        target,
        exception,
        step,
        objective,
        plan,
        done,
        (holds, gone),
        store,
        expansions,
        time_limit,
        certainty,
    )
    manner = DiagnosisManner(
        tree, explain, outcomes, hidden, recover, seed, format is DiagnosisForm.SVG
    )
    if history or reset or age is not None or counts is not None:
        _refuse_case(asked, manner)

        give_answer(lambda: manage_closed_cases(target, store, history, reset, age, counts), form)
    _refuse_idle(asked, manner)
    give_answer(lambda: _diagnose_target(asked, manner), form)


@dataclass(frozen=True, slots=True)
class DiagnosisRequest:
    """The case: what happened and where, and the limits of the search."""

    target: str
    exception: str
    step: str
    objective: CaseGoal | None
    plan: Path | None
    done: str
    seen: tuple[str, str]
    store: str
    expansions: int | None
    seconds: float | None
    certainty: float | None


@dataclass(frozen=True, slots=True)
class DiagnosisManner:
    """How the case is worked through, and what is shown of it."""

    tree: bool
    explain: bool
    outcomes: str
    hidden: str
    recover: bool
    seed: int
    picture: bool


def _refuse_case(asked: DiagnosisRequest, manner: DiagnosisManner) -> None:
    """Refuse the options that belong to an open case."""
    case = {
        "--exception": asked.exception,
        "--step": asked.step,
        "--plan": asked.plan,
        "--done": asked.done,
    }
    case |= dict(zip(("--holds", "--gone"), asked.seen, strict=True))
    how = {"--outcomes": manner.outcomes, "--hidden": manner.hidden, "--tree": manner.tree}
    rest = {
        "--explain": manner.explain,
        "--recover": manner.recover,
        "--format svg": manner.picture,
    }
    refuse_idle(
        {**case, **how, **rest},
        "on closed cases: --history, --age, --reset and --import open no new case",
    )


def _refuse_idle(asked: DiagnosisRequest, manner: DiagnosisManner) -> None:
    if not asked.exception:
        raise make_misfit("give --exception: it names what happened")
    if asked.done and asked.plan is None:
        raise make_misfit("--done needs a plan: give --plan")
    if manner.picture and not manner.tree:
        raise make_misfit("a picture shows the whole tree: give --tree")
    answered = {"--outcomes": manner.outcomes, "--hidden": manner.hidden}
    if manner.tree:
        refuse_idle(
            {**answered, "--explain": manner.explain}, "with --tree, which shows every outcome"
        )
    if manner.explain:
        refuse_idle(answered, "with --explain, which is about the first test")
    if manner.tree or manner.explain:
        why = "before the case is closed: leave out --tree and --explain"
        refuse_idle({"--recover": manner.recover}, why)
    if manner.outcomes:
        refuse_idle({"--hidden": manner.hidden}, "with --outcomes, which gives the answers")


def _diagnose_target(asked: DiagnosisRequest, manner: DiagnosisManner) -> VerbAnswer:
    from cellwright.engine.pipelines.recovery.case_input import FailedPlan, ObservedFacts
    from cellwright.engine.pipelines.recovery.diagnosis_case import open_diagnosis_case

    failed = FailedPlan(asked.plan, asked.step, asked.done) if asked.plan else None
    objective, store = asked.objective.value if asked.objective else None, asked.store
    with SearchInterruption(asked.seconds) as interrupted:
        fault_case = open_diagnosis_case(
            asked.target,
            asked.exception,
            asked.step,
            objective,
            store,
            asked.expansions,
            interrupted,
            failed,
            ObservedFacts(*asked.seen),
            asked.certainty,
        )
        answer = _case_answer(fault_case, manner, interrupted, store)
    return replace(answer, code=INTERRUPTED) if interrupted.heard else answer


def _case_answer(
    found: "DiagnosisCase", manner: DiagnosisManner, interrupted: "SearchInterruption", store: str
) -> VerbAnswer:
    if manner.tree:
        return _tree_answer(found, manner.picture)
    if manner.explain:
        return _explain_advice(found.session)
    return _work_case(found, _choose_answerer(found, manner, interrupted), manner.recover, store)


def _tree_answer(found: "DiagnosisCase", picture: bool) -> VerbAnswer:
    from cellwright.engine.model.troubleshooting import expected_cost

    selector, problem = found.session.selector, found.session.case.problem
    advice, whole_tree = found.session.advice(), selector.tree(found.session.standing)
    cost = expected_cost(whole_tree)
    content = {
        "expected cost": round(cost, 6),
        "bound": round(advice.bound, 6),
        "tree": report.tree_entry(problem, whole_tree),
    }
    raw = report.decision_tree_svg(problem, whole_tree, cost) if picture else None
    status = "optimal" if advice.optimal else "found"
    return VerbAnswer(
        status,
        content,
        lambda: report.decision_tree_text(problem, whole_tree, cost, advice.bound),
        raw=raw,
    )


def _explain_advice(session: "CaseSession") -> VerbAnswer:
    """The best first action, and the expected costs with each other action first."""
    problem, advice = session.case.problem, session.advice()
    compared = _compare_actions(session, advice)
    content = report.advice_entry(problem, advice) | {
        "alternatives": {
            problem.actions[a].name: round(c, 6) for a, c, _ in compared if a != advice.action
        }
    }
    believed = report.belief_table([(str(h), p) for h, p in session.belief()])
    table = report.advice_reasons(problem, advice, compared)
    return VerbAnswer("ok", content, lambda: rich_parts.Group(believed, rich_parts.Text(""), table))


def _compare_actions(
    session: "CaseSession", advice: "CaseAdvice"
) -> tuple[tuple[int, float, bool], ...]:
    chosen = () if advice.action is None else (advice.action,)
    return session.selector.compare(session.standing, (*chosen, *(a for a, _ in advice.runners_up)))


def _choose_answerer(
    found: "DiagnosisCase", manner: DiagnosisManner, interrupted: "SearchInterruption"
) -> "Answerer":
    from cellwright.engine.pipelines.recovery.case_input import hidden_hypothesis, scripted_answerer
    from cellwright.engine.stages.diagnosis.hidden_cause import HiddenWorld

    if manner.outcomes:
        return scripted_answerer(found.model, manner.outcomes)
    if manner.hidden:
        import random

        hypothesis = hidden_hypothesis(found.model, manner.hidden)
        world = HiddenWorld(found.model, hypothesis, random.Random(manner.seed))
        return lambda action, _advice: world.respond(action)

    return ask_at_terminal(found, interrupted)


def _work_case(found: "DiagnosisCase", answer: "Answerer", recover: bool, store: str) -> VerbAnswer:
    from cellwright.engine.pipelines.recovery.case_input import seen_before
    from cellwright.engine.stages.diagnosis.case_session import run_session

    diagnosis = run_session(found.session, answer, seen_before(answer))
    lost = lost_case(found, diagnosis, store)
    went_on = found.recover(diagnosis, store) if recover else None
    certain, change = found.certainties(diagnosis), found.revision_after(diagnosis, went_on)
    content: dict[str, Any] = report.case_entry(diagnosis, certain, change)
    shown = [report.case_text(found.model, diagnosis, certain, change)]
    if went_on is not None:
        content["recovery"] = report.recovery_entry(went_on)
        shown.append(report.recovery_text(went_on))
    return VerbAnswer(
        _case_status(diagnosis),
        content,
        lambda: rich_parts.Group(*shown),
        0 if diagnosis.finished else GAVE_UP,
        lost,
    )


def _case_status(made: "CaseDiagnosis") -> str:
    return "cured" if made.cured else "isolated" if made.isolated else "open"


def ask_at_terminal(found: "DiagnosisCase", interrupted: "SearchInterruption") -> "Answerer":
    """A function that asks the person at the terminal.

    An empty line, Ctrl-C or the end of the input ends the case.
    """
    console = terminal_console.make_console(stderr=True)

    def ask(action: "Action", advice: "CaseAdvice") -> str | None:
        with hushing_progress():
            return asked(action, advice)

    def asked(action: "Action", advice: "CaseAdvice") -> str | None:
        session = found.session
        if advice.action is None:
            console.print(found.session.diagnosis().question_text, markup=False)
        else:
            console.print(report.belief_table([(str(h), p) for h, p in session.belief()]))
        prepared = session.prepared.steps if session.prepared and advice.action is not None else ()
        if prepared:
            steps = "; ".join(str(step.operator) for step in prepared)
            console.print(f"first: {steps}", markup=False, highlight=False)
        says = found.says(action.name)
        choices = ", ".join(f"{n} {outcome}" for n, outcome in enumerate(action.outcomes, 1))
        while True:
            console.print(
                f"{action.name}: {says}\n  {choices}: ", end="", markup=False, highlight=False
            )
            answer_line = _typed_line(interrupted)
            if not answer_line:
                return None
            if (meant := _meant_outcome(answer_line, action.outcomes)) is not None:
                return meant

    return ask


def _meant_outcome(said: str, outcomes: "Sequence[str]") -> str | None:
    """The outcome that is named by its text or its number; None if none is."""
    if said in outcomes:
        return said
    return outcomes[int(said) - 1] if is_count(said) and 1 <= int(said) <= len(outcomes) else None


def _typed_line(interrupted: "SearchInterruption") -> str:
    """What is typed in a line, without spaces around it; nothing at Ctrl-C and at the end of
    the input.
    """
    try:
        with interrupted.while_waiting():
            return sys.stdin.readline().strip()
    except KeyboardInterrupt:
        return ""


def manage_closed_cases(
    target: str, store: str, history: bool, reset: bool, age: float | None, given: Path | None
) -> VerbAnswer:
    """Forget, age or add closed cases of a domain, in this order, then list them.

    Raises `InvalidInput`.
    """
    from cellwright.engine.pipelines.recovery.case_input import import_counts
    from cellwright.engine.pipelines.recovery.diagnosis_case import fault_model

    if not store:
        raise InvalidInput(
            [Diagnostic(Source("--store"), "K409", "no store is given", "give --store FILE")]
        )
    model = fault_model(target)
    with kb_store.Cases(store) as cases:
        done_lines = []
        if reset:
            done_lines.append(f"{cases.reset(model.domain)} cases forgotten")
        if age is not None:
            cases.discount(model.domain, age)
            done_lines.append(f"the weights of cases are multiplied by {age:g}")
        if given is not None:
            added = import_counts(model, given)
            cases.add(added)
            done_lines.append(f"{count_noun(len(added), 'count')} imported")
        return _case_history(model.domain, cases, done_lines, history)


def lost_case(
    found: "DiagnosisCase", made: "CaseDiagnosis", store: str
) -> "tuple[Diagnostic, ...]":
    """Keep a closed case, if there is a store; warnings if that fails, because the answer
    matters more.
    """
    try:
        if store:
            found.keep(made, store)
    except InvalidInput as error:
        return tuple(replace(diagnostic, warning=True) for diagnostic in error.diagnostics)
    return ()


def _case_history(domain: str, cases: "Cases", said: list[str], listed: bool) -> VerbAnswer:
    history_entries = cases.history(domain)
    rows = [
        (
            e.exception,
            " and ".join(e.causes),
            report.cost_text(e.weight),
            report.cost_text(e.cost),
            str(len(e.observations)),
        )
        for e in history_entries
    ]
    table = report.TextTable(("exception", "cause", "counts for", "cost", "tests"), rows)
    content = {
        "cases": [
            {"exception": e.exception, "causes": list(e.causes), "weight": e.weight, "cost": e.cost}
            for e in history_entries
        ]
    }
    parts: list[Any] = [*map(rich_parts.Text, said), *([table] if listed else [])]
    return VerbAnswer("ok", content, lambda: rich_parts.Group(*parts))
