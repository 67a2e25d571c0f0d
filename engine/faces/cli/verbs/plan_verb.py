"""The verb `plan`: a plan for a target, as a table, as data, as a picture or for PDDL planners."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from cellwright.engine.faces.cli.options.shared_options import (
    Anytime,
    Before,
    Command,
    DurationsFrom,
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
from cellwright.engine.faces.cli.output.answer_output import AnswerForm, VerbAnswer, give_answer
from cellwright.engine.faces.cli.output.output_files import Output, answer_form
from cellwright.engine.faces.cli.output.plan_forms import PlanForm
from cellwright.engine.faces.cli.process.exit_codes import FINDINGS, INTERRUPTED, exit_code
from cellwright.engine.faces.cli.process.search_interruption import SearchInterruption
from cellwright.engine.faces.cli.wrong_options import make_misfit, refuse_idle
from cellwright.engine.formats import interop, report
from cellwright.engine.model.outcome import Found
from cellwright.engine.model.planning_choices import PlanningObjective, SequenceChoice
from cellwright.engine.pipelines import execution, inspection, planning
from cellwright.engine.pipelines import motion as motion_room
from cellwright.engine.plugins import geometry_backend
from cellwright.kb import loader
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, nearest_hint
from cellwright.kb.stopping import StoppedByCaller

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from cellwright.engine.formats.interop.pddl import PddlProblem
    from cellwright.engine.formats.report.plans.plan_answer import PlanAnswer
    from cellwright.engine.pipelines.motion.moving_plan import MovingRun
    from cellwright.engine.pipelines.planning.plan_objective import Run
    from cellwright.engine.stages.planning import SearchLimits
    from cellwright.kb.diagnostics import Diagnostic
    from cellwright.kb.model.domain_model import Domain
    from cellwright.kb.model.planning_problem import Problem


def raw_plan(made: "PlanAnswer", form: PlanForm, task: "PddlProblem | None") -> str | None:
    """The plan as a file of its own: DOT, SVG, or IPC for a PDDL `task`. None without a plan,
    and for the other forms.
    """
    if form is PlanForm.IPC:
        return _ipc_plan(made, task)
    outcome = made.run.outcome
    if not isinstance(outcome, Found):
        return None
    if form is PlanForm.DOT:
        return report.plan_dot(outcome.plan, made.problem)
    if form is PlanForm.SVG:
        return report.draw_plan(outcome.plan, made.problem)
    return None


def _ipc_plan(made: "PlanAnswer", task: "PddlProblem | None") -> str | None:
    """The plan in the format of the planning competitions."""
    if task is None:
        hint = "give --pddl"
        raise InvalidInput(
            [Diagnostic(Source("--format"), "K409", "ipc is a format for PDDL tasks", hint)]
        )
    outcome = made.run.outcome
    return interop.write_plan(task, outcome.plan) if isinstance(outcome, Found) else None


Objective = Annotated[
    PlanningObjective | None,
    Option(
        "--objective",
        help="what the plan should have least of; without it makespan, then cost, where "
        "steps take time, else cost",
    ),
]
Folded = Annotated[
    bool,
    Option("--folded", help="with --store: print the MACROPs in the plan instead of its steps"),
]


Motion = Annotated[
    bool,
    Option("--motion", help="with the motion of the arm in every step, and the time that it takes"),
]

Robust = Annotated[
    bool,
    Option(
        "--robust",
        help="with a policy that keeps every window however long steps last within their ranges, "
        "or why there is none",
    ),
]

Order = Annotated[
    SequenceChoice | None,
    Option(
        "--order",
        help="who orders measurements: the sequencer, or the planner alone (free); without it "
        "the sequencer, unless "
        "--objective, --strategy, --race or --anytime asks the planner",
    ),
]

FORMAT = "how the plan is written: text, unless the name of the output ends otherwise"


def plan_target(
    target: Target,
    task: Annotated[Path | None, Argument(help="with --pddl: the PDDL problem")] = None,
    pddl: Pddl = False,
    goals: Goals = "",
    command: Command = "",
    format: Annotated[PlanForm | None, Option("--format", help=FORMAT)] = None,
    output: Output = None,
    stats: Stats = False,
    time_limit: TimeLimit = None,
    expansions: Expansions = None,
    strategy: Strategy = "auto",
    race: Race = False,
    anytime: Anytime = False,
    seed: Seed = 0,
    objective: Objective = None,
    order: Order = None,
    store: Library = "",
    folded: Folded = False,
    motion: Motion = False,
    robust: Robust = False,
    durations_from: DurationsFrom = "",
    window: Windows = None,
    lasts: Lasts = None,
    before: Before = None,
) -> None:
    """Print a plan for TARGET, or, with --pddl, for the PDDL domain TARGET and the PDDL problem
    TASK.
    """
    plan_request = PlanRequest(
        target, goals, command, task, (window or [], lasts or [], before or [])
    )
    _refuse_misfits(plan_request, pddl, strategy if race else "auto", motion)
    _refuse_unrobust(robust, pddl, motion, objective)
    if durations_from and not robust:
        raise make_misfit("--durations-from needs --robust: only ranges are learned")
    kind = answer_form(output, format, PlanForm.TEXT)
    _refuse_unseen(PlanForm.TEXT if output else kind, stats, folded, store)
    searching = {"--objective": objective, "--race": race, "--anytime": anytime, "--pddl": pddl}
    searching["--strategy"] = strategy != "auto"
    planner_strategy, wish = (
        "race" if race else strategy,
        objective or (PlanningObjective.COST if strategy == "shortest" else None),
    )
    ordered = _choose_ordering(order, searching)
    work = SearchOptions(
        time_limit,
        expansions,
        seed,
        planner_strategy,
        anytime,
        store,
        folded,
        wish,
        ordered,
        motion,
        robust,
        durations_from,
    )
    if plan_request.pddl is not None:
        _give_timed(plan_request.target, plan_request.pddl, work, (kind, stats, output))
    give_answer(
        lambda: _plan_target(plan_request, kind, stats, work),
        AnswerForm.JSON if kind is PlanForm.JSON else AnswerForm.TEXT,
        output,
    )


def _give_timed(
    domain: str, problem: Path, work: "SearchOptions", shown: tuple[PlanForm, bool, Path | None]
) -> None:
    """Answer for a PDDL task with times; return where the task has none."""
    from cellwright.engine.faces.cli.plan_times import TimedRequest, give_timed

    idle: dict[str, object] = {
        "--race": work.strategy == "race",
        "--strategy": work.strategy not in ("auto", "race"),
        "--store": work.store,
        "--objective cost": work.objective is PlanningObjective.COST,
    }
    wanted = TimedRequest(
        Path(domain), problem, work.seconds, work.expansions, work.anytime, work.seed
    )
    give_timed(wanted, idle, *shown)


def _choose_ordering(
    given: SequenceChoice | None, searching: "Mapping[str, object]"
) -> SequenceChoice:
    """Who orders measurements. Options that ask the planner to search leave the order to it."""
    if given is SequenceChoice.SEQUENCE:
        refuse_idle(searching, "with --order sequence: the planner seeks no order then")
    return given or (SequenceChoice.FREE if any(searching.values()) else SequenceChoice.SEQUENCE)


def _refuse_misfits(wanted: "PlanRequest", pddl: bool, raced: str, motion: bool) -> None:
    """Refuse options that do not go together; `raced` is the strategy that is asked for beside
    a race of all.
    """
    if pddl and motion:
        raise make_misfit("--motion needs a cell: a PDDL problem has none")
    if pddl != (wanted.pddl is not None):
        raise make_misfit("--pddl takes a domain and a problem; without it there is one target")
    if pddl:
        own: dict[str, object] = {"--goals": wanted.goals, "--command": wanted.command}
        own |= dict(zip(("--window", "--lasts", "--before"), wanted.demands, strict=True))
        refuse_idle(own, "with --pddl: the PDDL problem says all that is wanted")
    if raced != "auto":
        refuse_idle(
            {"--strategy": raced}, "with --race, which runs all of them: leave one of the two out"
        )


def _refuse_unrobust(
    robust: bool, pddl: bool, motion: bool, objective: PlanningObjective | None
) -> None:
    """Refuse options that do not go with `--robust`."""
    if robust and pddl:
        raise make_misfit("--robust needs ranges of durations: PDDL has none")
    if robust and motion:
        raise make_misfit("--robust and --motion: motions last as long as they are computed to")
    if robust and objective is PlanningObjective.COST:
        raise make_misfit("--robust and --objective cost: a policy needs a timetable")


def _refuse_unseen(form: PlanForm, stats: bool, folded: bool, store: str) -> None:
    """Refuse options that the form of the answer cannot show."""
    if folded and not store:
        raise make_misfit("--folded needs a library of MACROPs: give --store")
    if form is not PlanForm.TEXT:
        refuse_idle({"--folded": folded}, f"on {form}, only on text")
    if form not in (PlanForm.TEXT, PlanForm.JSON):
        refuse_idle({"--stats": stats}, f"on {form}, only on text and json")


@dataclass(frozen=True, slots=True)
class PlanRequest:
    """What is to be planned: a target, goals or a command that replace its own, and windows,
    durations and orders of visits.
    """

    target: str
    goals: str = ""
    command: str = ""
    pddl: Path | None = None
    demands: tuple[list[str], list[str], list[str]] = ([], [], [])


@dataclass(frozen=True, slots=True)
class SearchOptions:
    """The limits of the search (seconds, expansions), and how it searches."""

    seconds: float | None
    expansions: int | None
    seed: int
    strategy: str
    anytime: bool = False
    store: str = ""
    folded: bool = False
    objective: "PlanningObjective | None" = None
    order: SequenceChoice = SequenceChoice.SEQUENCE
    motion: bool = False
    robust: bool = False
    durations_from: str = ""


def _read_task(wanted: "PlanRequest") -> "PddlProblem | None":
    if not wanted.pddl:
        return None
    return interop.read_pddl_task(Path(wanted.target), wanted.pddl)


def _plan_target(
    wanted: PlanRequest, form: PlanForm, stats: bool, work: SearchOptions
) -> VerbAnswer:
    _require_strategy(work.strategy)
    task = _read_task(wanted)
    with SearchInterruption(work.seconds) as interrupted:
        made_plan = _make_plan(wanted, task, work, interrupted)
    outcome = made_plan.run.outcome
    return VerbAnswer(
        report.outcome_status(outcome),
        report.plan_answer_content(made_plan, stats) if form is PlanForm.JSON else {},
        text=lambda: report.plan_answer_text(made_plan, stats, work.folded),
        code=INTERRUPTED if interrupted.heard else _plan_code(made_plan),
        diagnostics=(
            *report.library_warnings(made_plan.origin, work.store),
            *(task.warnings if task else _displaced(made_plan)),
        ),
        raw=raw_plan(made_plan, form, task),
    )


def _plan_code(made: "PlanAnswer") -> int:
    """The exit code; a plan that is not robust though that is asked for is a finding."""
    code = exit_code(made.run.outcome)
    return FINDINGS if not code and made.robust and not made.robust.is_robust else code


def _displaced(made: "PlanAnswer") -> "tuple[Diagnostic, ...]":
    """Warnings about what the plan moves out of the way of a goal without anybody having said
    so.
    """
    from cellwright.engine.model.outcome import Found
    from cellwright.engine.pipelines.planning.taken_places import find_taken_places

    outcome = made.run.outcome
    if not isinstance(outcome, Found):
        return ()
    return tuple(find_taken_places(made.problem, outcome.plan))


def _make_plan(
    wanted: PlanRequest,
    task: "PddlProblem | None",
    work: SearchOptions,
    interrupted: "SearchInterruption",
) -> "PlanAnswer":
    """The plan, with the motions of its steps if they are asked for."""
    problem = task.problem if task else _wanted_problem(wanted)
    learned = execution.learn_durations(work.durations_from, problem) if work.durations_from else ()
    problem = execution.with_learned_durations(problem, learned) if learned else problem
    limits = _search_limits(work, interrupted, problem.domain, task is not None)
    wish, order = work.objective, work.order
    if work.motion:
        moving = _plan_motions(
            problem,
            work,
            interrupted,
            lambda each: planning.plan_for_objective(each, limits, wish, order),
        )
        return report.PlanAnswer(moving.run, moving.problem, moving=moving)
    run, origin = planning.plan_with_library(problem, limits, wish, order, work.store, work.folded)
    if not work.robust:
        return report.PlanAnswer(run, problem, origin)
    run, robust = planning.make_robust(problem, run)
    if robust is not None:
        robust = replace(robust, learned=tuple(each.text for each in learned))
    return report.PlanAnswer(run, problem, origin, robust=robust)


def _wanted_problem(wanted: PlanRequest) -> "Problem":
    """The problem with what the options ask of its measurements."""
    problem = planning.problem_of(wanted.target, wanted.goals, wanted.command)
    if not any(wanted.demands):
        return problem
    return inspection.as_facts(problem, inspection.of_options(*wanted.demands))


def _search_limits(
    work: SearchOptions, interrupted: "SearchInterruption", domain: "Domain", pddl: bool
) -> "SearchLimits":
    """When the search ends. A PDDL problem gets little room for exact search, and no restarts."""
    from cellwright.engine.stages.planning import (
        RESTARTS,
        SMALL_STATE_ROOM,
        STATE_ROOM,
        SearchLimits,
        expansions_within,
    )

    return SearchLimits(
        expansions_within(work.expansions, work.seconds),
        room=SMALL_STATE_ROOM if pddl else STATE_ROOM,
        restarts=0 if pddl else RESTARTS,
        interrupted=interrupted,
        thorough=work.anytime,
        strategy=work.strategy,
        seed=work.seed,
        improved=(lambda plan: interrupted.tell(plan, domain)) if work.anytime else lambda _: None,
    )


def _plan_motions(
    problem: "Problem",
    work: SearchOptions,
    interrupted: "SearchInterruption",
    planned: "Callable[[Problem], Run]",
) -> "MovingRun":
    """The plan in which every step moves.

    Raises `StoppedByCaller` if it is interrupted: a plan that does not move is no answer.
    """

    def planned_in_time(each: "Problem") -> "Run":
        run = planned(each)
        if interrupted.told:
            raise StoppedByCaller
        return run

    backend = geometry_backend()
    posed_plan = motion_room.plan_with_poses(
        problem, loader.cell_of_problem(problem), backend, planned_in_time, work.seed, work.store
    )
    return posed_plan.moving


def _require_strategy(name: str) -> None:
    from cellwright.engine.stages.planning import RACE, STRATEGIES

    if name not in (*STRATEGIES, RACE):
        hint = nearest_hint(name, list(STRATEGIES)) or f"one of {', '.join(STRATEGIES)}"
        raise InvalidInput(
            [Diagnostic(Source("--strategy"), "K406", f"no strategy '{name}'", hint)]
        )
