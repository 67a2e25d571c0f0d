"""`cellwright diagnose`: find what is behind an exception with the cheapest tests."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from engine.cli.answers import Answer, Form, give
from engine.cli.exits import GAVE_UP
from engine.cli.options import Expansions, Seed, Target, TimeLimit, number

if TYPE_CHECKING:
    from engine.diagnosis.session import Answer as Answerer
    from engine.diagnosis.session import Session
    from engine.model.diagnosis import Action, Advice
    from engine.model.faults import Diagnosis
    from engine.troubleshooting import Desk
    from kb.store.cases import Cases


class DiagnosisForm(StrEnum):
    """How a diagnosis is written; a picture is made of the whole tree alone."""

    TEXT = "text"
    JSON = "json"
    SVG = "svg"


class Goal(StrEnum):
    """What a case is for."""

    ISOLATE = "isolate"
    REPAIR = "repair"


def diagnose(
    target: Target,
    exception: Annotated[str, typer.Option(help="the exception, by its name in faults.yaml")] = "",
    step: Annotated[str, typer.Option(help="the step it interrupted: us_measure(us_probe, t3_746, m1)")] = "",
    outcomes: Annotated[
        str, typer.Option(help="scripted outcomes: look_at_spot=dry, tool_self_test=passed")
    ] = "",
    hidden: Annotated[
        str, typer.Option(help="simulate: the causes that are really there, with commas between")
    ] = "",
    tree: Annotated[bool, typer.Option("--tree", help="print the whole decision tree")] = False,
    explain: Annotated[bool, typer.Option("--explain", help="say why this test is next")] = False,
    objective: Annotated[Goal, typer.Option(help="find the cause, or get rid of the trouble")] = Goal.ISOLATE,
    recover: Annotated[
        bool, typer.Option("--recover", help="plan on from what was found to the problem's goals")
    ] = False,
    plan: Annotated[
        Path | None, typer.Option(help="the plan that failed, in JSON: it is revised before planning anew")
    ] = None,
    done: Annotated[
        str, typer.Option(help="its steps that are done, such as 1..4, 7; else those before --step")
    ] = "",
    store: Annotated[str, typer.Option(help="learn: keep closed cases in this file or database")] = "",
    history: Annotated[bool, typer.Option("--history", help="print the closed cases of the store")] = False,
    age: Annotated[
        float | None, typer.Option(min=0, max=1, callback=number, help="let closed cases count so much less")
    ] = None,
    reset: Annotated[bool, typer.Option("--reset", help="forget the closed cases of this domain")] = False,
    import_: Annotated[
        Path | None, typer.Option("--import", help="JSON to add: {exception: {cause: count}}")
    ] = None,
    format: Annotated[DiagnosisForm, typer.Option("--format", help="how the answer is written")] = (
        DiagnosisForm.TEXT
    ),
    expansions: Expansions = 200_000,
    time_limit: TimeLimit = None,
    seed: Seed = 0,
) -> None:
    """Find what is behind an exception of TARGET: ask for outcomes, take them from a list, or print the whole tree."""
    form = Form.JSON if format is DiagnosisForm.JSON else Form.TEXT
    if history or reset or age is not None or import_ is not None:
        give(lambda: _kept(target, store, history, reset, age, import_), form)
    if not exception:
        raise typer.BadParameter("--exception names what happened")
    if done and plan is None:
        raise typer.BadParameter("--done counts the steps of a plan: give --plan")

    def make() -> Answer:
        from engine.cli.interruption import Interruption
        from engine.troubleshooting import desk
        from engine.troubleshooting.given import Failed

        failed = Failed(plan, step, done) if plan else None
        with Interruption(time_limit) as interrupted:
            found = desk(target, exception, step, objective.value, store, expansions, interrupted, failed)
            if tree:
                return _tree(found, format is DiagnosisForm.SVG)
            if explain and not (outcomes or hidden):
                return _explained(found.session)
            return _case(found, _answerer(found, outcomes, hidden, seed, explain), recover, store)

    give(make, form)


def _tree(found: "Desk", picture: bool) -> Answer:
    from engine.model.diagnosis import expected_cost
    from engine.report import diagnosis as report
    from engine.report.decision_svg import decision_tree

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
    """What to do first, and what beginning with each other action would cost."""
    from rich.console import Group
    from rich.text import Text

    from engine.report import diagnosis as report

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


def _answerer(found: "Desk", outcomes: str, hidden: str, seed: int, explain: bool) -> "Answerer":
    from engine.diagnosis.world import HiddenWorld
    from engine.troubleshooting.given import hidden_hypothesis, scripted

    if outcomes:
        return scripted(found.model, outcomes)
    if hidden:
        import random

        world = HiddenWorld(found.model, hidden_hypothesis(found.model, hidden), random.Random(seed))
        return lambda action, _advice: world.respond(action)
    return _asking(found, explain)


def _asking(found: "Desk", explain: bool) -> "Answerer":
    """Ask the person at the terminal; an empty line, or the end of the input, ends the case."""
    import sys

    from rich.console import Console

    from engine.report import diagnosis as report

    console = Console(stderr=True)

    def ask(action: "Action", advice: "Advice") -> str | None:
        session = found.session
        if advice.action is None:
            console.print(found.session.diagnosis().question_text, markup=False)
        elif explain:
            console.print(report.reasons(session.case.problem, advice, _compared(session, advice)))
        else:
            console.print(report.belief([(str(h), p) for h, p in session.belief()]))
        says = found.says(action.name)
        choices = ", ".join(f"{n} {outcome}" for n, outcome in enumerate(action.outcomes, 1))
        while True:
            console.print(f"{action.name}: {says}\n  {choices}: ", end="", markup=False, highlight=False)
            said = sys.stdin.readline()
            if not said.strip():
                return None
            if said.strip() in action.outcomes:
                return said.strip()
            if said.strip().isdigit() and 1 <= int(said) <= len(action.outcomes):
                return action.outcomes[int(said) - 1]

    return ask


def _case(found: "Desk", answer: "Answerer", recover: bool, store: str) -> Answer:
    from rich.console import Group

    from engine.diagnosis.session import run
    from engine.report import diagnosis as report
    from engine.report import recovery

    made = run(found.session, answer)
    if store:
        found.keep(made, store)
    certain, change = found.certainties(made), found.revision(made)
    content: dict[str, Any] = report.case_entry(made, certain, change)
    shown = [report.case(found.model, made, certain, change)]
    if recover:
        went_on = found.recover(change, store)
        content["recovery"] = recovery.entry(went_on)
        shown.append(recovery.text(went_on))
    return Answer(_status(made), content, lambda: Group(*shown), 0 if made.finished else GAVE_UP)


def _status(made: "Diagnosis") -> str:
    return "cured" if made.cured else "isolated" if made.isolated else "open"


def _kept(
    target: str, store: str, history: bool, reset: bool, age: float | None, given: Path | None
) -> Answer:
    from engine.troubleshooting import fault_model
    from engine.troubleshooting.given import imported
    from kb.diagnostics import Diagnostic, InvalidInput, Source
    from kb.store.cases import Cases

    if not store:
        raise InvalidInput([Diagnostic(Source("--store"), "K401", "which store?", "give --store FILE")])
    model = fault_model(target)
    with Cases(store) as cases:
        said = []
        if reset:
            said.append(f"{cases.reset(model.domain)} cases forgotten")
        if age is not None:
            cases.age(model.domain, age)
            said.append(f"cases count for {age:g} of what they did")
        if given is not None:
            added = imported(model, given)
            cases.add(added)
            said.append(f"{len(added)} counts imported")
        return _history(model.domain, cases, said, history)


def _history(domain: str, cases: "Cases", said: list[str], listed: bool) -> Answer:
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    from engine.report.diagnosis import number

    table = Table("exception", "cause", "counts for", "cost", "tests", box=None, header_style="bold")
    found = cases.history(domain)
    for each in found if listed else ():
        row = (each.exception, " and ".join(each.causes), number(each.weight), number(each.cost))
        table.add_row(*row, str(len(each.observations)))
    content = {
        "cases": [
            {"exception": e.exception, "causes": list(e.causes), "weight": e.weight, "cost": e.cost}
            for e in found
        ]
    }
    parts: list[Any] = [*map(Text, said), *([table] if listed else [])]
    return Answer("ok", content, lambda: Group(*parts))
