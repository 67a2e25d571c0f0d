"""The verbs `run` and `resume`: a plan is carried out in a cell, real or simulated, to its end."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from cellwright.engine.faces.cli.options import shared_options
from cellwright.engine.faces.cli.options.shared_options import (
    Command,
    DurationsFrom,
    Expansions,
    Format,
    Goals,
    Seed,
    Target,
    number_option,
)
from cellwright.engine.faces.cli.output.answer_output import AnswerForm, VerbAnswer, give_answer
from cellwright.engine.faces.cli.output.terminal_console import say_on_stderr
from cellwright.engine.faces.cli.process.exit_codes import FINDINGS, STOPPED, exit_code
from cellwright.engine.faces.cli.verbs.run_supervision import RunSupervision
from cellwright.engine.faces.cli.wrong_options import make_misfit
from cellwright.engine.formats import report
from cellwright.engine.formats.report import rich_parts
from cellwright.engine.model.outcome import Found
from cellwright.engine.model.start_rules import NO_RULES
from cellwright.engine.pipelines import execution, planning
from cellwright.engine.pipelines import motion as motion_room
from cellwright.engine.plugins import geometry_backend
from cellwright.kb import loader
from cellwright.kb import store as kb_store
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source

if TYPE_CHECKING:
    from cellwright.engine.model.run_protocol import Finish
    from cellwright.engine.model.start_rules import StartRules
    from cellwright.engine.pipelines.execution import RunRequest
    from cellwright.engine.pipelines.execution.run_motions import RunPaths
    from cellwright.engine.pipelines.motion.moving_plan import MovingRun
    from cellwright.engine.pipelines.planning.plan_objective import Run
    from cellwright.engine.stages.planning import SearchLimits
    from cellwright.kb.model.planning_problem import Problem

DriverName = Annotated[
    str, Option("--driver", help="who carries out the commands: sim, or a plug-in")
]
Store = Annotated[
    str,
    Option(
        "--store",
        envvar="CELLWRIGHT_STORE",
        help="where the journal is kept: a file, or postgresql://USER@HOST/DB",
    ),
]
Name = Annotated[
    str,
    Option(
        "--name",
        help="the name of the run_target; if not given, that of the problem and a number_option",
    ),
]
Factor = Annotated[
    float,
    Option(
        min=0,
        callback=number_option,
        help="the share of real time that simulated time takes: 0 at once, 1 in real time",
    ),
]
Faults = Annotated[
    list[str] | None,
    Option(
        "--fault",
        help="simulate a fault: STEP=CAUSE, STEP being a number_option, an operator or a whole "
        "step; may be repeated",
    ),
]
Options = Annotated[
    list[str] | None,
    Option(
        "--option",
        help="an option of the driver: NAME=VALUE (sim: spread=0.2, lookahead=4, log=FILE)",
    ),
]
Approve = Annotated[bool, Option("--approve", help="show the plan and ask before anything moves")]
Events = Annotated[
    str, Option("--events", help="write each event as a line of JSON to this file; - is the output")
]
Watch = Annotated[
    bool,
    Option(
        "--watch",
        help="show how the run_target goes: on a terminal with --factor a live display with "
        "keys, else plain lines",
    ),
]
Motion = Annotated[
    bool,
    Option(
        "--motion", help="plan with the motion of the arm in every step, and the time that it takes"
    ),
]

Robust = Annotated[
    bool,
    Option(
        "--robust",
        help="follow a policy that keeps every window however long steps last within their "
        "ranges; no run begins without one",
    ),
]


def run_target(
    target: Target,
    driver: DriverName = "sim",
    store: Store = "",
    name: Name = "",
    goals: Goals = "",
    command: Command = "",
    factor: Factor = 0.0,
    fault: Faults = None,
    option: Options = None,
    approve: Approve = False,
    events: Events = "",
    watch: Watch = False,
    motion: Motion = False,
    robust: Robust = False,
    durations_from: DurationsFrom = "",
    expansions: Expansions = None,
    seed: Seed = 0,
    format: Format = AnswerForm.TEXT,
) -> None:
    """Plan TARGET, carry the plan out, handle what goes wrong, and go on until the goals are
    reached.
    """
    asked = RunCommandRequest(
        target,
        goals,
        command,
        driver,
        store,
        name,
        factor,
        seed,
        approve,
        expansions,
        motion,
        robust,
        durations_from,
    )
    if durations_from and not robust:
        raise make_misfit("--durations-from needs --robust: only ranges are learned")
    if robust and motion:
        raise make_misfit("--robust and --motion: motions last as long as they are computed to")
    if events == "-" and format is AnswerForm.JSON:
        raise make_misfit("--events - writes lines of JSON to the output: leave out --format json")
    give_answer(lambda: _start_run(asked, fault or [], option or [], events, watch, format), format)


@dataclass(frozen=True, slots=True)
class RunCommandRequest:
    """What is to be run, as it was typed."""

    target: str
    goals: str
    command: str
    driver: str
    store: str
    name: str
    factor: float
    seed: int
    approve: bool
    expansions: int | None
    motion: bool
    robust: bool = False
    durations_from: str = ""


def _start_run(
    asked: RunCommandRequest,
    faults: Sequence[str],
    options: Sequence[str],
    events: str,
    shown: bool,
    format: AnswerForm,
) -> VerbAnswer:
    problem = planning.problem_of(asked.target, asked.goals, asked.command)
    store = asked.store or kb_store.default_store()
    driver_options = options_of(options) | ({"fault": "; ".join(faults)} if faults else {})
    wanted = execution.RunRequest(
        asked.target, asked.goals, asked.command, asked.driver, store, asked.name, asked.seed,
        asked.factor, driver_options,
        asked.approve, asked.motion,
    )  # fmt: skip
    with execution.list_run(wanted, problem) as entered:
        return _carried_out(entered, asked, problem, events, shown, format)


def _carried_out(
    wanted: "RunRequest",
    asked: RunCommandRequest,
    problem: "Problem",
    events: str,
    shown: bool,
    format: AnswerForm,
) -> VerbAnswer:
    from cellwright.engine.stages.planning import SearchLimits, expansions_within

    if shown:
        say_on_stderr("\n".join(report.narrate_problem(problem)) + "\n")
    as_read = problem
    limits = SearchLimits(expansions_within(asked.expansions, None), seed=asked.seed)
    table, scope, paths, rules = None, None, None, NO_RULES
    if asked.robust:
        if asked.durations_from:
            learned = execution.learn_durations(asked.durations_from, problem)
            problem = execution.with_learned_durations(problem, learned)
        run, rules = _plan_with_policy(asked.target, problem, limits)
        table = run.timetable
        if not isinstance(run.outcome, Found):
            return answer_of(run.outcome, wanted.store, events == "-")
    if asked.motion:
        moving = _plan_with_motions(asked, problem, limits, wanted.store)
        table, scope = moving.run.timetable, execution.RunScope(moving.problem, moving.given_up)
        problem = replace(moving.problem, goal=problem.goal, chains=problem.chains)
        _tell_given_up(moving, quiet=events == "-" or format is AnswerForm.JSON)
        if table is None:
            return answer_of(moving.run.outcome, wanted.store, events == "-")
        paths = _arm_paths(moving, asked.seed)
    with RunSupervision(
        wanted.run, wanted.store, events, asked.approve, shown, asked.factor
    ) as watch:
        ending = execution.begin_run(
            wanted,
            problem,
            watch.channel,
            watch.watchers,
            limits,
            table=table,
            scope=scope,
            paths=paths,
            as_read=as_read,
            rules=rules,
        )
    return answer_of(ending, wanted.store, events == "-")


def _plan_with_policy(
    target: str, problem: "Problem", limits: "SearchLimits"
) -> "tuple[Run, StartRules]":
    """A plan, and the rules of its policy; none where no step takes time.

    Raises `InvalidInput` if no policy keeps all windows.
    """
    run, robust = planning.make_robust(problem, planning.plan_for_objective(problem, limits))
    if robust is not None and not robust.is_robust:
        hint = f"cellwright plan {target} --robust says what does not go together"
        message = "no policy keeps all windows of the plan whatever happens in the ranges"
        raise InvalidInput([Diagnostic(Source(target), "K421", message, hint)])
    return run, NO_RULES if robust is None else robust.rules


def _tell_given_up(moving: "MovingRun", quiet: bool) -> None:
    """Say, before anything moves, which goals are given up, and why."""
    if moving.given_up and not quiet:
        say_on_stderr(
            "\n".join(
                f"given up: {given_up_goal.goal}: {given_up_goal.why}"
                for given_up_goal in moving.given_up
            )
            + "\n"
        )


def _plan_with_motions(
    asked: RunCommandRequest, problem: "Problem", limits: "SearchLimits", store: str
) -> "MovingRun":
    """The plan in which every step moves. The poses of measurements are kept in the store."""
    cell, plans = (
        loader.cell_of_problem(problem),
        partial(planning.plan_for_objective, limits=limits),
    )
    return motion_room.plan_with_poses(
        problem, cell, geometry_backend(), plans, asked.seed, store
    ).moving


def _arm_paths(moving: "MovingRun", seed: int) -> "RunPaths | None":
    """What the arms can do while the run goes on."""
    walk = moving.walk
    if walk is None:
        return None
    home = execution.going_home(walk.cell, moving.steps)
    return execution.RunPaths(moving.problem, walk.cell, seed, walk.ways, planned=walk, home=home)


def options_of(given: Sequence[str]) -> dict[str, str]:
    """The options of a driver from NAME=VALUE."""
    driver_options = {}
    for option_text in given:
        name, equals, value = option_text.partition("=")
        if not equals:
            raise make_misfit(f"--option {option_text}: write NAME=VALUE")
        driver_options[name.strip()] = value.strip()
    return driver_options


def answer_of(ending: "Finish | Any", store: str, quiet: bool) -> VerbAnswer:
    """What is printed at the end of a run."""
    if not isinstance(ending, execution.Finish):
        ending_text = rich_parts.Text(f"No plan: {ending.reason}.")
        return VerbAnswer(
            report.outcome_status(ending),
            {"reason": ending.reason},
            lambda: ending_text,
            exit_code(ending),
        )
    code = {"reached": 0, "partly": FINDINGS}.get(ending.outcome, STOPPED)
    text = None if quiet else lambda: report.ending_text(ending, store)
    return VerbAnswer(ending.outcome, report.ending_entry(ending), text, code)


def resume_named_run(
    run: Annotated[
        str,
        Argument(
            metavar="RUN",
            help="the name of the run, as `cellwright run` printed it",
            autocompletion=shared_options.complete_runs,
        ),
    ],
    store: Store = "",
    factor: Annotated[
        float | None,
        Option(
            min=0,
            callback=number_option,
            help="the share of real time that simulated time takes; if not given, as before",
        ),
    ] = None,
    unchained: Annotated[
        bool,
        Option(
            "--unchained", help="go on with a journal that an older version began without digests"
        ),
    ] = False,
    events: Events = "",
    watch: Watch = False,
    expansions: Expansions = None,
    seed: Seed = 0,
    format: Format = AnswerForm.TEXT,
) -> None:
    """Go on with RUN from its journal: ask the driver what became of commands under way, repeat
    none, and finish.
    """
    if events == "-" and format is AnswerForm.JSON:
        raise make_misfit("--events - writes lines of JSON to the output: leave out --format json")
    give_answer(
        lambda: _resume_run(run, store, factor, unchained, events, watch, (expansions, seed)),
        format,
    )


def _resume_run(
    run: str,
    store: str,
    factor: float | None,
    unchained: bool,
    events: str,
    watch: bool,
    search: tuple[int | None, int],
) -> VerbAnswer:
    from cellwright.engine.stages.planning import SearchLimits, expansions_within

    where = store or kb_store.default_store()
    pace, before = execution.follow_run(where, run, factor) if watch else (0.0, ())
    with RunSupervision(run, where, events, False, watch, pace, before) as seen:
        limits = SearchLimits(expansions_within(search[0], None), seed=search[1])
        ending = execution.resume_run(
            where, run, seen.channel, seen.watchers, limits, factor, unchained
        )
    return answer_of(ending, where, events == "-")
