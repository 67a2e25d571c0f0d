"""`cellwright run` and `cellwright resume`: carry out a plan in a cell, real or simulated, to the end."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any

from cellwright.engine.faces.cli.answers import Answer, Form, give
from cellwright.engine.faces.cli.declared import Option, misfit
from cellwright.engine.faces.cli.exits import FINDINGS, STOPPED, exit_code
from cellwright.engine.faces.cli.options import Command, Expansions, Format, Goals, Seed, Target, number
from cellwright.engine.faces.cli.supervision import Watching

if TYPE_CHECKING:
    from cellwright.engine.model.execution import Finish
    from cellwright.engine.pipelines.execution import Wanted
    from cellwright.engine.pipelines.execution.paths import Paths
    from cellwright.engine.pipelines.moves.planning import Moving
    from cellwright.engine.stages.planning import Limits
    from cellwright.kb.model.problem import Problem

DriverName = Annotated[str, Option("--driver", help="who carries out the commands: sim, or a plug-in")]
Store = Annotated[
    str,
    Option(
        "--store",
        envvar="CELLWRIGHT_STORE",
        help="where the journal is kept: a file, or postgresql://USER@HOST/DB",
    ),
]
Name = Annotated[
    str, Option("--name", help="the name of the run; if not given, that of the problem and a number")
]
Factor = Annotated[
    float,
    Option(
        min=0,
        callback=number,
        help="the share of real time that simulated time takes: 0 at once, 1 in real time",
    ),
]
Faults = Annotated[
    list[str] | None,
    Option(
        "--fault",
        help="simulate a fault: STEP=CAUSE, STEP being a number, an operator or a whole step; may be repeated",
    ),
]
Options = Annotated[
    list[str] | None,
    Option("--option", help="an option of the driver: NAME=VALUE (sim: spread=0.2, lookahead=4, log=FILE)"),
]
Approve = Annotated[bool, Option("--approve", help="show the plan and ask before anything moves")]
Events = Annotated[
    str, Option("--events", help="write each event as a line of JSON to this file; - is the output")
]
Watch = Annotated[
    bool,
    Option(
        "--watch",
        help="show how the run goes: on a terminal with --factor a live display with keys, else plain lines",
    ),
]
Motion = Annotated[
    bool,
    Option("--motion", help="plan with the motion of the arm in every step, and the time that it takes"),
]


def run(
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
    expansions: Expansions = 1_000_000,
    seed: Seed = 0,
    format: Format = Form.TEXT,
) -> None:
    """Plan TARGET, carry the plan out, handle what goes wrong, and go on until the goals are reached."""
    asked = Asked(target, goals, command, driver, store, name, factor, seed, approve, expansions, motion)
    if events == "-" and format is Form.JSON:
        raise misfit("--events - writes lines of JSON to the output: leave out --format json")
    give(lambda: _run(asked, fault or [], option or [], events, watch, format), format)


@dataclass(frozen=True, slots=True)
class Asked:
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
    expansions: int
    motion: bool


def _run(
    asked: Asked, faults: Sequence[str], options: Sequence[str], events: str, shown: bool, format: Form
) -> Answer:
    from cellwright.engine.pipelines.execution import Wanted, listed
    from cellwright.engine.pipelines.planning import problem_of
    from cellwright.kb.store.own import default_store

    problem = problem_of(asked.target, asked.goals, asked.command)
    store = asked.store or default_store()
    given = options_of(options) | ({"fault": "; ".join(faults)} if faults else {})
    wanted = Wanted(
        asked.target, asked.goals, asked.command, asked.driver, store, asked.name, asked.seed, asked.factor, given,
        asked.approve, asked.motion,
    )  # fmt: skip
    with listed(wanted, problem) as entered:
        return _carried_out(entered, asked, problem, events, shown, format)


def _carried_out(
    wanted: "Wanted", asked: Asked, problem: "Problem", events: str, shown: bool, format: Form
) -> Answer:
    from cellwright.engine.pipelines.execution import Scope, begin
    from cellwright.engine.stages.planning import Limits

    if shown:
        from cellwright.engine.faces.cli.terminal import say
        from cellwright.engine.formats.report.narration import understood

        say("\n".join(understood(problem)) + "\n")
    limits, table, scope, paths = Limits(asked.expansions, seed=asked.seed), None, None, None
    if asked.motion:
        moving = _moving(asked, problem, limits, wanted.store)
        table, scope = moving.run.timetable, Scope(moving.problem, moving.given_up)
        problem = replace(moving.problem, goal=problem.goal, chains=problem.chains)
        _tell(moving, quiet=events == "-" or format is Form.JSON)
        if table is None:
            return answer_of(moving.run.outcome, wanted.store, events == "-")
        paths = _paths(moving, asked.seed)
    with Watching(wanted.run, wanted.store, events, asked.approve, shown, asked.factor) as watch:
        ending = begin(
            wanted, problem, watch.channel, watch.watchers, limits, table=table, scope=scope, paths=paths
        )
    return answer_of(ending, wanted.store, events == "-")


def _tell(moving: "Moving", quiet: bool) -> None:
    """Say, before anything moves, which goals are given up, and why."""
    from cellwright.engine.faces.cli.terminal import say

    if moving.given_up and not quiet:
        say("\n".join(f"given up: {each.goal}: {each.why}" for each in moving.given_up) + "\n")


def _moving(asked: Asked, problem: "Problem", limits: "Limits", store: str) -> "Moving":
    """The plan in which every step moves. The poses of measurements are kept in the store."""
    from functools import partial

    from cellwright.engine.pipelines.objective import plan
    from cellwright.engine.pipelines.poses.planning import plan_with_poses
    from cellwright.engine.plugins import geometry_backend
    from cellwright.kb.loader.cell import cell_of

    cell, plans = cell_of(asked.target), partial(plan, limits=limits)
    return plan_with_poses(problem, cell, geometry_backend(), plans, asked.seed, store).moving


def _paths(moving: "Moving", seed: int) -> "Paths | None":
    """What the arms can do while the run goes on."""
    from cellwright.engine.pipelines.execution.apart import going_home
    from cellwright.engine.pipelines.execution.paths import Paths

    walk = moving.walk
    if walk is None:
        return None
    home = going_home(walk.cell, moving.steps)
    return Paths(moving.problem, walk.cell, seed, walk.ways, planned=walk, home=home)


def options_of(given: Sequence[str]) -> dict[str, str]:
    """The options of a driver from NAME=VALUE."""
    found = {}
    for each in given:
        name, equals, value = each.partition("=")
        if not equals:
            raise misfit(f"--option {each}: write NAME=VALUE")
        found[name.strip()] = value.strip()
    return found


def answer_of(ending: "Finish | Any", store: str, quiet: bool) -> Answer:
    """What is printed at the end of a run."""
    from cellwright.engine.formats.report import execution as report
    from cellwright.engine.formats.report.json import status
    from cellwright.engine.pipelines.execution import Finish

    if not isinstance(ending, Finish):
        from rich.text import Text

        said = Text(f"No plan: {ending.reason}.")
        return Answer(status(ending), {"reason": ending.reason}, lambda: said, exit_code(ending))
    code = {"reached": 0, "partly": FINDINGS}.get(ending.outcome, STOPPED)
    text = None if quiet else lambda: report.text(ending, store)
    return Answer(ending.outcome, report.entry(ending), text, code)
