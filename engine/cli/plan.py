"""`cellwright plan` and `cellwright validate`."""

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from engine.cli.answers import Answer, Form, give
from engine.cli.exits import FINDINGS, INTERRUPTED, exit_code
from engine.cli.options import Command, Expansions, Format, Goals, Seed, Stats, Target, TimeLimit

if TYPE_CHECKING:
    from rich.console import RenderableType

    from engine.model.outcome import Outcome
    from kb.model.problem import Problem


class PlanForm(StrEnum):
    """How a plan is written: as a table, as data, or as a picture of its partial order."""

    TEXT = "text"
    JSON = "json"
    DOT = "dot"
    SVG = "svg"


def plan(
    target: Target,
    goals: Goals = "",
    command: Command = "",
    format: Annotated[PlanForm, typer.Option("--format", help="how the plan is written")] = PlanForm.TEXT,
    stats: Stats = False,
    time_limit: TimeLimit = None,
    expansions: Expansions = 200_000,
    seed: Seed = 0,
) -> None:
    """Print a plan for TARGET."""
    form = Form.JSON if format is PlanForm.JSON else Form.TEXT
    give(
        lambda: _plan(Wanted(target, goals, command), format, stats, Work(time_limit, expansions, seed)), form
    )


@dataclass(frozen=True, slots=True)
class Wanted:
    """What is to be planned: a target, and goals or words in place of its own."""

    target: str
    goals: str = ""
    command: str = ""


@dataclass(frozen=True, slots=True)
class Work:
    """How long the search may take: seconds, expansions; and its seed."""

    seconds: float | None
    expansions: int
    seed: int


def _plan(wanted: Wanted, form: PlanForm, stats: bool, work: Work) -> Answer:
    from engine import pipeline
    from engine.cli.interruption import Interruption
    from engine.planning import Limits
    from engine.report import json

    with Interruption(work.seconds) as interrupted:
        problem = pipeline.problem_of(wanted.target, wanted.goals, wanted.command)
        outcome = pipeline.plan(problem, Limits(expansions=work.expansions, interrupted=interrupted))
    content = json.outcome(outcome, problem)
    if stats:
        content["statistics"] = json.statistics(outcome.statistics)
    return Answer(
        json.status(outcome),
        content,
        text=lambda: _text(outcome, problem, stats),
        code=INTERRUPTED if interrupted.heard else exit_code(outcome),
        raw=_picture(outcome, form),
    )


def _text(outcome: "Outcome", problem: "Problem", stats: bool) -> "RenderableType":
    from rich.console import Group

    from engine.report import text

    parts = [text.outcome(outcome, problem)]
    return Group(*parts, text.statistics(outcome.statistics)) if stats else parts[0]


def _picture(outcome: "Outcome", form: PlanForm) -> str | None:
    """The plan as DOT or SVG, if it was asked for and there is one."""
    from engine.model.outcome import Found

    if not isinstance(outcome, Found):
        return None
    if form is PlanForm.DOT:
        from engine.report import dot

        return dot.plan(outcome.plan)
    if form is PlanForm.SVG:
        from engine.report import svg

        return svg.plan(outcome.plan)
    return None


def validate(
    file: Annotated[Path, typer.Argument(help="a plan, as `cellwright plan --format json` writes it")],
    problem: Annotated[
        str, typer.Option(help="check it against this problem instead of the one it carries")
    ] = "",
    format: Format = Form.TEXT,
) -> None:
    """Check the plan in FILE with the independent checker."""
    give(lambda: _validate(file, problem), format)


def _validate(file: Path, target: str) -> Answer:
    from rich.text import Text

    from engine import pipeline
    from kb.loader import load_plan

    own, plan = load_plan(file)
    problem = pipeline.problem_of(target) if target else own
    found = pipeline.check_plan(problem, plan, str(file))
    said = f"valid: {len(plan.steps)} steps, cost {plan.cost}, {len(plan.links)} causal links"
    content = {"steps": len(plan.steps), "cost": plan.cost, "links": len(plan.links)}
    if found:
        return Answer("invalid", content, code=FINDINGS, diagnostics=tuple(found))
    return Answer("valid", content, text=lambda: Text(said))
