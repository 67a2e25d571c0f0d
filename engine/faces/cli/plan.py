"""`cellwright plan`."""

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cellwright.engine.faces.cli import plan_forms
from cellwright.engine.faces.cli.answers import Answer, Form, give
from cellwright.engine.faces.cli.declared import Argument, Option, misfit
from cellwright.engine.faces.cli.exits import INTERRUPTED, exit_code
from cellwright.engine.faces.cli.idle import refuse_idle
from cellwright.engine.faces.cli.options import (
    Anytime,
    Before,
    Command,
    Expansions,
    Goals,
    Lasts,
    Library,
    Pddl,
    Race,
    Seed,
    Stats,
    Strategy,
    Target,
    TimeLimit,
    Windows,
)
from cellwright.engine.faces.cli.plan_forms import PlanForm
from cellwright.engine.faces.cli.saving import Output, form_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from cellwright.engine.faces.cli.interruption import Interruption
    from cellwright.engine.formats.interop.pddl import PddlProblem
    from cellwright.engine.formats.report.planned import Made
    from cellwright.engine.pipelines.moves.planning import Moving
    from cellwright.engine.pipelines.objective import Run
    from cellwright.engine.stages.planning import Limits
    from cellwright.kb.model.problem import Problem


class Wish(StrEnum):
    """What a plan should have least of."""

    COST = "cost"
    MAKESPAN = "makespan"


Objective = Annotated[
    Wish | None,
    Option(
        "--objective",
        help="what the plan should have least of; without it makespan, then cost, where steps take time, else cost",
    ),
]
Folded = Annotated[
    bool, Option("--folded", help="with --store: print the MACROPs in the plan instead of its steps")
]


class Ordering(StrEnum):
    """Who decides the order of measurements."""

    SEQUENCE = "sequence"
    FREE = "free"


Motion = Annotated[
    bool,
    Option("--motion", help="with the motion of the arm in every step, and the time that it takes"),
]

Order = Annotated[
    Ordering | None,
    Option(
        "--order",
        help="who orders measurements: the sequencer, or the planner alone (free); without it the sequencer, unless "
        "--objective, --strategy, --race or --anytime asks the planner",
    ),
]

FORMAT = "how the plan is written: text, unless the name of the output ends otherwise"


def plan(
    target: Target,
    task: Annotated[Path | None, Argument(help="with --pddl: the PDDL problem")] = None,
    pddl: Pddl = False,
    goals: Goals = "",
    command: Command = "",
    format: Annotated[PlanForm | None, Option("--format", help=FORMAT)] = None,
    output: Output = None,
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
    window: Windows = None,
    lasts: Lasts = None,
    before: Before = None,
) -> None:
    """Print a plan for TARGET, or, with --pddl, for the PDDL domain TARGET and the PDDL problem TASK."""
    wanted = PlanRequest(target, goals, command, task, (window or [], lasts or [], before or []))
    _refuse_misfits(wanted, pddl, strategy if race else "auto", motion)
    kind = form_of(output, format, PlanForm.TEXT)
    _refuse_unseen(PlanForm.TEXT if output else kind, stats, folded, store)
    searching = {"--objective": objective, "--race": race, "--anytime": anytime, "--pddl": pddl}
    searching["--strategy"] = strategy != "auto"
    way, wish = "race" if race else strategy, objective or (Wish.COST if strategy == "shortest" else None)
    ordered = _order(order, searching)
    work = SearchOptions(time_limit, expansions, seed, way, anytime, store, folded, wish, ordered, motion)
    give(lambda: _plan(wanted, kind, stats, work), Form.JSON if kind is PlanForm.JSON else Form.TEXT, output)


def _order(given: Ordering | None, searching: "Mapping[str, object]") -> Ordering:
    """Who orders measurements. Options that ask the planner to search leave the order to it."""
    if given is Ordering.SEQUENCE:
        refuse_idle(searching, "with --order sequence: the planner seeks no order then")
    return given or (Ordering.FREE if any(searching.values()) else Ordering.SEQUENCE)


def _refuse_misfits(wanted: "PlanRequest", pddl: bool, raced: str, motion: bool) -> None:
    """Refuse options that do not go together; `raced` is the strategy that is asked for beside a race of all."""
    if pddl and motion:
        raise misfit("--motion needs a cell: a PDDL problem has none")
    if pddl != (wanted.pddl is not None):
        raise misfit("--pddl takes a domain and a problem; without it there is one target")
    if pddl:
        own: dict[str, object] = {"--goals": wanted.goals, "--command": wanted.command}
        own |= dict(zip(("--window", "--lasts", "--before"), wanted.demands, strict=True))
        refuse_idle(own, "with --pddl: the PDDL problem says all that is wanted")
    if raced != "auto":
        refuse_idle({"--strategy": raced}, "with --race, which runs all of them: leave one of the two out")


def _refuse_unseen(form: PlanForm, stats: bool, folded: bool, store: str) -> None:
    """Refuse options that the form of the answer cannot show."""
    if folded and not store:
        raise misfit("--folded needs a library of MACROPs: give --store")
    if form is not PlanForm.TEXT:
        refuse_idle({"--folded": folded}, f"on {form}, only on text")
    if form not in (PlanForm.TEXT, PlanForm.JSON):
        refuse_idle({"--stats": stats}, f"on {form}, only on text and json")


@dataclass(frozen=True, slots=True)
class PlanRequest:
    """What is to be planned: a target, goals or a command that replace its own, and windows, durations and orders of visits."""

    target: str
    goals: str = ""
    command: str = ""
    pddl: Path | None = None
    demands: tuple[list[str], list[str], list[str]] = ([], [], [])


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
    from cellwright.engine.formats.interop.pddl import read_pddl

    return read_pddl(Path(wanted.target), wanted.pddl)


def _plan(wanted: PlanRequest, form: PlanForm, stats: bool, work: SearchOptions) -> Answer:
    from cellwright.engine.faces.cli.interruption import Interruption
    from cellwright.engine.formats.report import json, planned

    _require_strategy(work.strategy)
    task = _read_task(wanted)
    with Interruption(work.seconds) as interrupted:
        made = _made(wanted, task, work, interrupted)
    outcome = made.run.outcome
    return Answer(
        json.status(outcome),
        planned.document(made, stats) if form is PlanForm.JSON else {},
        text=lambda: planned.text(made, stats, work.folded),
        code=INTERRUPTED if interrupted.heard else exit_code(outcome),
        diagnostics=(*planned.losses(made.origin, work.store), *(task.warnings if task else ())),
        raw=plan_forms.raw(made, form, task),
    )


def _made(
    wanted: PlanRequest, task: "PddlProblem | None", work: SearchOptions, interrupted: "Interruption"
) -> "Made":
    """The plan, with the motions of its steps if they are asked for."""
    from cellwright.engine.formats.report.planned import Made
    from cellwright.engine.pipelines import objective as objectives
    from cellwright.engine.pipelines.recall import planned

    problem = task.problem if task else _problem(wanted)
    limits = _limits(work, interrupted, task is not None)
    wish = objectives.Objective(work.objective.value) if work.objective else None
    order = objectives.Order(work.order.value)
    if work.motion:
        moving = _moving(
            wanted.target, problem, work, interrupted, lambda each: objectives.plan(each, limits, wish, order)
        )
        return Made(moving.run, moving.problem, moving=moving)
    run, origin = planned(problem, limits, wish, order, work.store, work.folded)
    return Made(run, problem, origin)


def _problem(wanted: PlanRequest) -> "Problem":
    """The problem with what the options ask of its measurements."""
    from cellwright.engine.pipelines import planning

    problem = planning.problem_of(wanted.target, wanted.goals, wanted.command)
    if not any(wanted.demands):
        return problem
    from cellwright.engine.pipelines.inspection.demands import as_facts, of_options

    return as_facts(problem, of_options(*wanted.demands))


def _limits(work: SearchOptions, interrupted: "Interruption", pddl: bool) -> "Limits":
    """When the search ends. A PDDL problem gets little room for exact search, and no restarts."""
    from cellwright.engine.stages.planning import LITTLE, RESTARTS, ROOM, Limits

    return Limits(
        work.expansions,
        room=LITTLE if pddl else ROOM,
        restarts=0 if pddl else RESTARTS,
        interrupted=interrupted,
        thorough=work.anytime,
        strategy=work.strategy,
        seed=work.seed,
        improved=interrupted.tell if work.anytime else lambda _: None,
    )


def _moving(
    target: str,
    problem: "Problem",
    work: SearchOptions,
    interrupted: "Interruption",
    planned: "Callable[[Problem], Run]",
) -> "Moving":
    """The plan in which every step moves. Raises `Stopped` if it is interrupted: a plan that does not move is no answer."""
    from cellwright.engine.pipelines.poses.planning import plan_with_poses
    from cellwright.engine.plugins import geometry_backend
    from cellwright.kb.loader.cell import cell_of
    from cellwright.kb.stopping import Stopped

    def planned_in_time(each: "Problem") -> "Run":
        run = planned(each)
        if interrupted.told:
            raise Stopped
        return run

    backend = geometry_backend()
    found = plan_with_poses(problem, cell_of(target), backend, planned_in_time, work.seed, work.store)
    return found.moving


def _require_strategy(name: str) -> None:
    from cellwright.engine.stages.planning import RACE, STRATEGIES
    from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, nearest

    if name not in (*STRATEGIES, RACE):
        hint = nearest(name, list(STRATEGIES)) or f"one of {', '.join(STRATEGIES)}"
        raise InvalidInput([Diagnostic(Source("--strategy"), "K406", f"no strategy '{name}'", hint)])
