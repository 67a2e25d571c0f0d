"""`cellwright diagnose`: find the cause of an exception with the cheapest tests."""

from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cellwright.engine.faces.cli.answers import Answer, Form, give
from cellwright.engine.faces.cli.declared import Option, misfit
from cellwright.engine.faces.cli.exits import GAVE_UP, INTERRUPTED
from cellwright.engine.faces.cli.idle import refuse_idle
from cellwright.engine.faces.cli.options import Seed, Target, TimeLimit, number

if TYPE_CHECKING:
    from cellwright.engine.faces.cli.interruption import Interruption
    from cellwright.engine.model.cases import Diagnosis
    from cellwright.engine.model.troubleshooting import Advice
    from cellwright.engine.pipelines.troubleshooting import Desk
    from cellwright.engine.stages.diagnosis.session import Answerer, Session


class DiagnosisForm(StrEnum):
    """How a diagnosis is written. A picture can only show the whole tree."""

    TEXT = "text"
    JSON = "json"
    SVG = "svg"


class Goal(StrEnum):
    """What a case should achieve."""

    ISOLATE = "isolate"
    REPAIR = "repair"


ExceptionName = Annotated[str, Option("--exception", help="the exception, by its name in faults.yaml")]
Step = Annotated[
    str,
    Option(
        "--step", help="the step it interrupted: us_measure(us_probe, t3_746, m1), or its number in --plan"
    ),
]
Outcomes = Annotated[
    str, Option("--outcomes", help="scripted outcomes: look_at_spot=dry, tool_self_test=passed")
]
Hidden = Annotated[
    str, Option("--hidden", help="simulate: the causes that are really present, separated by commas")
]
WholeTree = Annotated[bool, Option("--tree", help="print the whole decision tree")]
Explain = Annotated[bool, Option("--explain", help="say why this test is next")]
Objective = Annotated[Goal, Option("--objective", help="find the cause, or repair the fault")]
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
        "--done", help="the steps of the plan that are done, such as 1..4, 7; if not given, all before --step"
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
        "--age", min=0, max=1, callback=number, help="multiply the weights of closed cases by this number"
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


def diagnose(
    target: Target,
    exception: ExceptionName = "",
    step: Step = "",
    outcomes: Outcomes = "",
    hidden: Hidden = "",
    tree: WholeTree = False,
    explain: Explain = False,
    objective: Objective = Goal.ISOLATE,
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
    """Find the cause of an exception of TARGET: ask for outcomes, read them from a list, or print the whole tree."""
    form = Form.JSON if format is DiagnosisForm.JSON else Form.TEXT
    asked = Asked(
        target, exception, step, objective, plan, done, (holds, gone), store, expansions, time_limit
    )
    manner = Manner(tree, explain, outcomes, hidden, recover, seed, format is DiagnosisForm.SVG)
    if history or reset or age is not None or counts is not None:
        _refuse_case(asked, manner)
        from cellwright.engine.faces.cli.closed_cases import kept

        give(lambda: kept(target, store, history, reset, age, counts), form)
    _refuse_idle(asked, manner)
    give(lambda: _diagnosed(asked, manner), form)


@dataclass(frozen=True, slots=True)
class Asked:
    """The case: what happened and where, and the limits of the search."""

    target: str
    exception: str
    step: str
    objective: Goal
    plan: Path | None
    done: str
    seen: tuple[str, str]
    store: str
    expansions: int | None
    seconds: float | None


@dataclass(frozen=True, slots=True)
class Manner:
    """How the case is worked through, and what is shown of it."""

    tree: bool
    explain: bool
    outcomes: str
    hidden: str
    recover: bool
    seed: int
    picture: bool


def _refuse_case(asked: Asked, manner: Manner) -> None:
    """Refuse the options that belong to an open case."""
    case = {"--exception": asked.exception, "--step": asked.step, "--plan": asked.plan, "--done": asked.done}
    case |= dict(zip(("--holds", "--gone"), asked.seen, strict=True))
    how = {"--outcomes": manner.outcomes, "--hidden": manner.hidden, "--tree": manner.tree}
    rest = {"--explain": manner.explain, "--recover": manner.recover, "--format svg": manner.picture}
    refuse_idle(
        {**case, **how, **rest}, "on closed cases: --history, --age, --reset and --import open no new case"
    )


def _refuse_idle(asked: Asked, manner: Manner) -> None:
    if not asked.exception:
        raise misfit("give --exception: it names what happened")
    if asked.done and asked.plan is None:
        raise misfit("--done needs a plan: give --plan")
    if manner.picture and not manner.tree:
        raise misfit("a picture shows the whole tree: give --tree")
    answered = {"--outcomes": manner.outcomes, "--hidden": manner.hidden}
    if manner.tree:
        refuse_idle({**answered, "--explain": manner.explain}, "with --tree, which shows every outcome")
    if manner.explain:
        refuse_idle(answered, "with --explain, which is about the first test")
    if manner.tree or manner.explain:
        why = "before the case is closed: leave out --tree and --explain"
        refuse_idle({"--recover": manner.recover}, why)
    if manner.outcomes:
        refuse_idle({"--hidden": manner.hidden}, "with --outcomes, which gives the answers")


def _diagnosed(asked: Asked, manner: Manner) -> Answer:
    from cellwright.engine.faces.cli.interruption import Interruption
    from cellwright.engine.pipelines.troubleshooting import desk
    from cellwright.engine.pipelines.troubleshooting.given import Failed, Seen

    failed = Failed(asked.plan, asked.step, asked.done) if asked.plan else None
    objective, store = asked.objective.value, asked.store
    with Interruption(asked.seconds) as interrupted:
        found = desk(
            asked.target,
            asked.exception,
            asked.step,
            objective,
            store,
            asked.expansions,
            interrupted,
            failed,
            Seen(*asked.seen),
        )
        answer = _answered(found, manner, interrupted, store)
    return replace(answer, code=INTERRUPTED) if interrupted.heard else answer


def _answered(found: "Desk", manner: Manner, interrupted: "Interruption", store: str) -> Answer:
    if manner.tree:
        return _tree(found, manner.picture)
    if manner.explain:
        return _explained(found.session)
    return _case(found, _answerer(found, manner, interrupted), manner.recover, store)


def _tree(found: "Desk", picture: bool) -> Answer:
    from cellwright.engine.formats.report import diagnosis as report
    from cellwright.engine.formats.report.decision_svg import decision_tree
    from cellwright.engine.model.troubleshooting import expected_cost

    selector, problem = found.session.selector, found.session.case.problem
    advice, made = found.session.advice(), selector.tree(found.session.standing)
    cost = expected_cost(made)
    content = {
        "expected cost": round(cost, 6),
        "bound": round(advice.bound, 6),
        "tree": report.tree_entry(problem, made),
    }
    raw = decision_tree(problem, made, cost) if picture else None
    status = "optimal" if advice.optimal else "found"
    return Answer(status, content, lambda: report.tree(problem, made, cost, advice.bound), raw=raw)


def _explained(session: "Session") -> Answer:
    """The best first action, and the expected costs with each other action first."""
    from rich.console import Group
    from rich.text import Text

    from cellwright.engine.formats.report import diagnosis as report

    problem, advice = session.case.problem, session.advice()
    compared = _compared(session, advice)
    content = report.advice_entry(problem, advice) | {
        "alternatives": {problem.actions[a].name: round(c, 6) for a, c, _ in compared if a != advice.action}
    }
    believed = report.belief([(str(h), p) for h, p in session.belief()])
    table = report.reasons(problem, advice, compared)
    return Answer("ok", content, lambda: Group(believed, Text(""), table))


def _compared(session: "Session", advice: "Advice") -> tuple[tuple[int, float, bool], ...]:
    chosen = () if advice.action is None else (advice.action,)
    return session.selector.compare(session.standing, (*chosen, *(a for a, _ in advice.runners_up)))


def _answerer(found: "Desk", manner: Manner, interrupted: "Interruption") -> "Answerer":
    from cellwright.engine.pipelines.troubleshooting.given import hidden_hypothesis, scripted
    from cellwright.engine.stages.diagnosis.world import HiddenWorld

    if manner.outcomes:
        return scripted(found.model, manner.outcomes)
    if manner.hidden:
        import random

        hypothesis = hidden_hypothesis(found.model, manner.hidden)
        world = HiddenWorld(found.model, hypothesis, random.Random(manner.seed))
        return lambda action, _advice: world.respond(action)
    from cellwright.engine.faces.cli.asking import asking

    return asking(found, interrupted)


def _case(found: "Desk", answer: "Answerer", recover: bool, store: str) -> Answer:
    from rich.console import Group

    from cellwright.engine.faces.cli.closed_cases import lost_case
    from cellwright.engine.formats.report import diagnosis as report
    from cellwright.engine.formats.report import recovery
    from cellwright.engine.stages.diagnosis.session import run

    made = run(found.session, answer)
    lost = lost_case(found, made, store)
    certain, change = found.certainties(made), found.revision(made)
    content: dict[str, Any] = report.case_entry(made, certain, change)
    shown = [report.case(found.model, made, certain, change)]
    if recover:
        went_on = found.recover(made, store)
        content["recovery"] = recovery.entry(went_on)
        shown.append(recovery.text(went_on))
    return Answer(_status(made), content, lambda: Group(*shown), 0 if made.finished else GAVE_UP, lost)


def _status(made: "Diagnosis") -> str:
    return "cured" if made.cured else "isolated" if made.isolated else "open"
