"""`cellwright plan`."""

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from engine.faces.cli.answers import Answer, Form, give
from engine.faces.cli.exits import INTERRUPTED, exit_code
from engine.faces.cli.options import (
    Anytime,
    Command,
    Expansions,
    Goals,
    Library,
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
    from collections.abc import Callable, Mapping

    from rich.console import RenderableType

    from engine.formats.interop.pddl import PddlProblem
    from engine.model.outcome import Outcome
    from engine.pipelines.moves.planning import Moving
    from engine.pipelines.objective import Run
    from kb.model.problem import Problem


class Wish(StrEnum):
    """What a plan should have least of."""

    COST = "cost"
    MAKESPAN = "makespan"


Objective = Annotated[
    Wish | None,
    typer.Option(
        "--objective",
        help="what the plan should have least of; without it makespan, then cost, where steps take time, else cost",
    ),
]
Folded = Annotated[
    bool, typer.Option("--folded", help="with --store: print the MACROPs in the plan instead of its steps")
]


class Ordering(StrEnum):
    """Who decides the order of measurements."""

    SEQUENCE = "sequence"
    FREE = "free"


Motion = Annotated[
    bool,
    typer.Option("--motion", help="with the motion of the arm in every step, and the time that it takes"),
]

Order = Annotated[
    Ordering | None,
    typer.Option(
        "--order",
        help="who orders measurements: the sequencer, or the planner alone (free); without it the sequencer, unless "
        "--objective, --strategy, --race or --anytime asks the planner",
    ),
]


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
    seed: Seed = 0,
    objective: Objective = None,
    order: Order = None,
    store: Library = "",
    folded: Folded = False,
    motion: Motion = False,
) -> None:
    """Print a plan for TARGET, or, with --pddl, for the PDDL domain TARGET and the PDDL problem TASK."""
    wanted = PlanRequest(target, goals, command, task)
    _refuse_misfits(wanted, pddl, strategy if race else "auto", motion)
    _refuse_unseen(format, stats, folded, store)
    searching = {"--objective": objective, "--race": race, "--anytime": anytime, "--pddl": pddl}
    searching["--strategy"] = strategy != "auto"
    if order is Ordering.SEQUENCE:
        refuse_idle(searching, "with --order sequence: the planner seeks no order then")
    work = SearchOptions(
        time_limit,
        expansions,
        seed,
        "race" if race else strategy,
        anytime,
        store,
        folded,
        objective or (Wish.COST if strategy == "shortest" else None),
        order or (Ordering.FREE if any(searching.values()) else Ordering.SEQUENCE),
        motion,
    )
    give(lambda: _plan(wanted, format, stats, work), Form.JSON if format is PlanForm.JSON else Form.TEXT)


def _refuse_misfits(wanted: "PlanRequest", pddl: bool, raced: str, motion: bool) -> None:
    """Refuse options that do not go together; `raced` is the strategy that is asked for beside a race of all."""
    if pddl and motion:
        raise typer.BadParameter("--motion needs a cell: a PDDL problem has none")
    if pddl != (wanted.pddl is not None):
        raise typer.BadParameter("--pddl takes a domain and a problem; without it there is one target")
    if pddl:
        own = {"--goals": wanted.goals, "--command": wanted.command}
        refuse_idle(own, "with --pddl: the PDDL problem has its own goals")
    if raced != "auto":
        refuse_idle({"--strategy": raced}, "with --race, which runs all of them: leave one of the two out")


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
    """The limits of the search (seconds, expansions), and how it searches."""

    seconds: float | None
    expansions: int
    seed: int
    strategy: str
    anytime: bool = False
    store: str = ""
    folded: bool = False
    objective: "Wish | None" = None
    order: Ordering = Ordering.SEQUENCE
    motion: bool = False


def _read_task(wanted: "PlanRequest") -> "PddlProblem | None":
    if not wanted.pddl:
        return None
    from engine.formats.interop.pddl import read_pddl

    return read_pddl(Path(wanted.target), wanted.pddl)


def _plan(wanted: PlanRequest, form: PlanForm, stats: bool, work: SearchOptions) -> Answer:
    from engine.faces.cli.interruption import Interruption
    from engine.faces.cli.origin import losses, planned
    from engine.formats.report import json
    from engine.pipelines import objective as objectives
    from engine.pipelines import planning
    from engine.stages.planning import LITTLE, RESTARTS, ROOM, Limits

    _require_strategy(work.strategy)
    with Interruption(work.seconds) as interrupted:
        task = _read_task(wanted)
        problem = task.problem if task else planning.problem_of(wanted.target, wanted.goals, wanted.command)
        limits = Limits(
            work.expansions,
            room=LITTLE if wanted.pddl else ROOM,
            restarts=0 if wanted.pddl else RESTARTS,
            interrupted=interrupted,
            thorough=work.anytime,
            strategy=work.strategy,
            seed=work.seed,
            improved=interrupted.tell if work.anytime else lambda _: None,
        )
        wish = objectives.Objective(work.objective.value) if work.objective else None
        order = objectives.Order(work.order.value)
        moving: Moving | None = None
        origin: dict[str, Any] = {}
        if work.motion:
            moving = _moving(
                wanted.target, problem, work, lambda each: objectives.plan(each, limits, wish, order)
            )
            run, problem = moving.run, moving.problem
        else:
            run, origin = planned(problem, limits, wish, order, work.store, work.folded)
    outcome = run.outcome
    return Answer(
        json.status(outcome),
        {**_document(run, problem, origin, stats), **_motions(moving)} if form is PlanForm.JSON else {},
        text=lambda: _text(run, problem, stats, origin, work.folded, moving),
        code=INTERRUPTED if interrupted.heard else exit_code(outcome),
        diagnostics=losses(origin, work.store),
        raw=_ipc(outcome, task) if form is PlanForm.IPC else _picture(outcome, problem, form),
    )


def _moving(
    target: str, problem: "Problem", work: SearchOptions, planned: "Callable[[Problem], Run]"
) -> "Moving":
    """The plan in which every step moves."""
    from engine.pipelines.poses.planning import plan_with_poses
    from engine.plugins import geometry_backend
    from engine.stages.geometry.pictures.view import cell_of

    found = plan_with_poses(problem, cell_of(target), geometry_backend(), planned, work.seed, work.store)
    return found.moving


def _motions(moving: "Moving | None") -> dict[str, Any]:
    """The motions as data."""
    if moving is None:
        return {}
    from engine.formats.report import moves

    return moves.entry(moving)


def _document(run: "Run", problem: "Problem", origin: "Mapping[str, Any]", stats: bool) -> dict[str, Any]:
    """The outcome as data, with its statistics if they were asked for."""
    from engine.formats.report import json
    from engine.formats.report.gantt import proof_entry

    content = {**json.outcome(run.outcome, problem, starts=run.starts), **origin}
    if run.itinerary:
        from engine.formats.report import itinerary

        content |= itinerary.entry(run)
    if run.timetable:
        content["makespan"] = proof_entry(run.timetable.schedule, run.timetable.scope)
    return {**content, "statistics": json.statistics(run.outcome.statistics)} if stats else content


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
    run: "Run",
    problem: "Problem",
    stats: bool,
    origin: "Mapping[str, Any]",
    folded: bool,
    moving: "Moving | None" = None,
) -> "RenderableType":
    from rich.console import Group

    from engine.faces.cli.origin import origin_text
    from engine.formats.report import text

    parts = [text.outcome(run.outcome, problem, run.timetable), *origin_text(origin)]
    if folded and origin.get("source", {}).get("parts"):
        parts = parts[1:]
    if run.itinerary:
        from engine.formats.report import itinerary

        parts.append(itinerary.text(run, problem.domain.time_unit))
    if moving is not None:
        from engine.formats.report import moves

        parts += moves.text(moving)
    return Group(*parts, *([text.statistics(run.outcome.statistics)] if stats else []))


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
