"""`cellwright plan` and `cellwright validate`."""

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from engine.faces.cli.answers import Answer, Form, give
from engine.faces.cli.exits import FINDINGS, INTERRUPTED, exit_code
from engine.faces.cli.options import (
    Anytime,
    Command,
    Expansions,
    Format,
    Goals,
    Ground,
    Library,
    MemoryLimit,
    Pddl,
    Race,
    Seed,
    Stats,
    Strategy,
    Target,
    TimeLimit,
    refuse_idle,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rich.console import RenderableType

    from engine.formats.interop.pddl import PddlProblem
    from engine.model.outcome import Outcome
    from kb.model.plan import Plan
    from kb.model.problem import Problem


class PlanForm(StrEnum):
    """How a plan is written: as a table, as data, as a picture of its partial order, or in the format of PDDL planners."""

    TEXT = "text"
    JSON = "json"
    DOT = "dot"
    SVG = "svg"
    IPC = "ipc"


def plan(
    target: Target,
    task: Annotated[Path | None, typer.Argument(help="with --pddl: the PDDL problem")] = None,
    pddl: Pddl = False,
    goals: Goals = "",
    command: Command = "",
    format: Annotated[PlanForm, typer.Option("--format", help="how the plan is written")] = PlanForm.TEXT,
    stats: Stats = False,
    time_limit: TimeLimit = None,
    expansions: Expansions = 1_000_000,
    strategy: Strategy = "auto",
    race: Race = False,
    anytime: Anytime = False,
    memory_limit: MemoryLimit = None,
    seed: Seed = 0,
    store: Library = "",
    folded: Annotated[
        bool,
        typer.Option("--folded", help="with --store: print the MACROPs in the plan instead of its steps"),
    ] = False,
) -> None:
    """Print a plan for TARGET, or, with --pddl, for the PDDL domain TARGET and the PDDL problem TASK."""
    if pddl != (task is not None):
        raise typer.BadParameter("--pddl takes a domain and a problem; without it there is one target")
    if pddl:
        refuse_idle(
            {"--goals": goals, "--command": command}, "with --pddl: the PDDL problem has its own goals"
        )
    if race and strategy != "auto":
        refuse_idle({"--strategy": strategy}, "with --race, which runs all of them: leave one of the two out")
    _refuse_unseen(format, stats, folded, store)
    form = Form.JSON if format is PlanForm.JSON else Form.TEXT
    wanted = PlanRequest(target, goals, command, task)
    work = SearchOptions(
        time_limit, memory_limit, expansions, seed, "race" if race else strategy, anytime, store, folded
    )
    give(lambda: _plan(wanted, format, stats, work), form)


def _refuse_unseen(form: PlanForm, stats: bool, folded: bool, store: str) -> None:
    """Refuse options that the form of the answer cannot show."""
    if folded and not store:
        raise typer.BadParameter("--folded needs a library of MACROPs: give --store")
    if form is not PlanForm.TEXT:
        refuse_idle({"--folded": folded}, f"on {form}, only on text")
    if form not in (PlanForm.TEXT, PlanForm.JSON):
        refuse_idle({"--stats": stats}, f"on {form}, only on text and json")


@dataclass(frozen=True, slots=True)
class PlanRequest:
    """What is to be planned: a target, and goals or a command that replace its own."""

    target: str
    goals: str = ""
    command: str = ""
    pddl: Path | None = None


@dataclass(frozen=True, slots=True)
class SearchOptions:
    """The limits of the search (seconds, megabytes, expansions), and how it searches."""

    seconds: float | None
    megabytes: int | None
    expansions: int
    seed: int
    strategy: str
    anytime: bool = False
    store: str = ""
    folded: bool = False


def _read_task(wanted: "PlanRequest") -> "PddlProblem | None":
    if not wanted.pddl:
        return None
    from engine.formats.interop.pddl import read_pddl

    return read_pddl(Path(wanted.target), wanted.pddl)


def _plan(wanted: PlanRequest, form: PlanForm, stats: bool, work: SearchOptions) -> Answer:
    from engine.faces.cli.interruption import Interruption, limit_memory
    from engine.faces.cli.origin import planned
    from engine.formats.report import json
    from engine.pipelines import planning
    from engine.stages.planning import Limits

    _require_strategy(work.strategy)
    limit_memory(work.megabytes)
    with Interruption(work.seconds) as interrupted:
        task = _read_task(wanted)
        problem = task.problem if task else planning.problem_of(wanted.target, wanted.goals, wanted.command)
        limits = Limits(
            work.expansions,
            interrupted=interrupted,
            thorough=work.anytime,
            strategy=work.strategy,
            seed=work.seed,
            improved=interrupted.tell if work.anytime else lambda _: None,
        )
        outcome, origin = planned(problem, limits, work.store, work.folded)
    return Answer(
        json.status(outcome),
        _document(outcome, problem, origin, stats) if form is PlanForm.JSON else {},
        text=lambda: _text(outcome, problem, stats, origin, work.folded),
        code=INTERRUPTED if interrupted.heard else exit_code(outcome),
        raw=_ipc(outcome, task) if form is PlanForm.IPC else _picture(outcome, problem, form),
    )


def _document(
    outcome: "Outcome", problem: "Problem", origin: "Mapping[str, Any]", stats: bool
) -> dict[str, Any]:
    """The outcome as data, with its statistics if they were asked for."""
    from engine.formats.report import json

    content = {**json.outcome(outcome, problem), **origin}
    return {**content, "statistics": json.statistics(outcome.statistics)} if stats else content


def _require_strategy(name: str) -> None:
    from engine.stages.planning import RACE, STRATEGIES
    from kb.diagnostics import Diagnostic, InvalidInput, Source, nearest

    if name not in (*STRATEGIES, RACE):
        hint = nearest(name, list(STRATEGIES)) or f"one of {', '.join(STRATEGIES)}"
        raise InvalidInput([Diagnostic(Source("--strategy"), "K406", f"no strategy '{name}'", hint)])


def _ipc(outcome: "Outcome", task: "PddlProblem | None") -> str | None:
    """The plan in the format of the planning competitions."""
    from engine.formats.interop.pddl.plans import write_plan
    from engine.model.outcome import Found
    from kb.diagnostics import Diagnostic, InvalidInput, Source

    if task is None:
        raise InvalidInput(
            [Diagnostic(Source("--format"), "K409", "ipc is a format for PDDL tasks", "give --pddl")]
        )
    return write_plan(task, outcome.plan) if isinstance(outcome, Found) else None


def _text(
    outcome: "Outcome", problem: "Problem", stats: bool, origin: "Mapping[str, Any]", folded: bool
) -> "RenderableType":
    from rich.console import Group

    from engine.faces.cli.origin import origin_text
    from engine.formats.report import text

    parts = [text.outcome(outcome, problem), *origin_text(origin)]
    if folded and origin.get("source", {}).get("parts"):
        parts = parts[1:]
    return Group(*parts, *([text.statistics(outcome.statistics)] if stats else []))


def _picture(outcome: "Outcome", problem: "Problem", form: PlanForm) -> str | None:
    """The plan as DOT or SVG, if there is a plan and this form was asked for."""
    from engine.model.outcome import Found

    if not isinstance(outcome, Found):
        return None
    if form is PlanForm.DOT:
        from engine.formats.report import dot

        return dot.plan(outcome.plan, problem)
    if form is PlanForm.SVG:
        from engine.formats.report import svg

        return svg.plan(outcome.plan, problem)
    return None


def validate(
    file: Annotated[Path, typer.Argument(help="a plan in JSON; with --pddl the PDDL domain")],
    task: Annotated[Path | None, typer.Argument(help="with --pddl: the PDDL problem")] = None,
    made: Annotated[Path | None, typer.Argument(help="with --pddl: the plan, one action per line")] = None,
    pddl: Pddl = False,
    problem: Annotated[
        str, typer.Option(help="check it against this problem instead of the one it carries")
    ] = "",
    export: Annotated[
        str, typer.Option(help="FILE is a plan that a PDDL planner found for the export of this target")
    ] = "",
    goals: Goals = "",
    command: Command = "",
    ground: Ground = False,
    format: Format = Form.TEXT,
) -> None:
    """Check the plan in FILE, or, with --pddl, the plan MADE for a PDDL task, with the independent checker."""
    if (pddl, pddl) != (task is not None, made is not None):
        raise typer.BadParameter("--pddl takes a domain, a problem and a plan; without it there is one file")
    if not export:
        own = {"--goals": goals, "--command": command, "--ground": ground}
        refuse_idle(own, "without --export: a plan contains its problem")
    refuse_idle(
        {"--problem": problem and (pddl or export)}, "with --pddl or --export, which name the problem"
    )
    refuse_idle({"--pddl": pddl and export}, "with --export, which takes one file")
    if export:
        give(lambda: _validate_export(file, PlanRequest(export, goals, command), ground), format)
    give(
        lambda: (
            _validate(file, problem) if not (pddl and task and made) else _validate_pddl(file, task, made)
        ),
        format,
    )


def _validate_export(file: Path, wanted: PlanRequest, ground: bool) -> Answer:
    from engine.formats.interop.pddl.files import read_exported_plan
    from engine.pipelines import planning

    problem = planning.problem_of(wanted.target, wanted.goals, wanted.command)
    return _judged(problem, read_exported_plan(problem, file, lifted=not ground), str(file))


def _validate_pddl(domain: Path, task: Path, made: Path) -> Answer:
    from engine.formats.interop.pddl import read_pddl
    from engine.formats.interop.pddl.plans import read_plan

    read = read_pddl(domain, task)
    return _judged(read.problem, read_plan(read, made), str(made))


def _validate(file: Path, target: str) -> Answer:
    from engine.pipelines import planning
    from kb.loader import load_plan

    own, plan = load_plan(file)
    return _judged(planning.problem_of(target) if target else own, plan, str(file))


def _judged(problem: "Problem", plan: "Plan", name: str) -> Answer:
    from rich.text import Text

    from engine.pipelines import planning

    found = planning.check_plan(problem, plan, name)
    said = f"valid: {len(plan.steps)} steps, cost {plan.cost}, {len(plan.links)} causal links"
    content = {"steps": len(plan.steps), "cost": plan.cost, "links": len(plan.links)}
    if found:
        return Answer("invalid", content, code=FINDINGS, diagnostics=tuple(found))
    return Answer("valid", content, text=lambda: Text(said))
