"""The verbs `motion`: a path of an arm, sets of motion problems, and travel times."""

import json
import math
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Argument, Option

from cellwright.engine.faces.cli.options.shared_options import (
    Cluster,
    Format,
    Seed,
    Target,
    number_option,
)
from cellwright.engine.faces.cli.options.worker_options import (
    WorkerOptions,
    crew_asked,
    progress_of,
)
from cellwright.engine.faces.cli.output.answer_output import AnswerForm, VerbAnswer, give_answer
from cellwright.engine.faces.cli.process.exit_codes import GAVE_UP, INFEASIBLE
from cellwright.engine.faces.cli.process.search_interruption import SearchInterruption
from cellwright.engine.faces.cli.wrong_options import make_misfit, refuse_idle
from cellwright.engine.formats import report
from cellwright.engine.formats.report import rich_parts
from cellwright.engine.pipelines import motion
from cellwright.kb import loader
from cellwright.kb import store as kb_store
from cellwright.kb.files import read_file

if TYPE_CHECKING:
    from cellwright.engine.pipelines.motion.arm_motion import ArmMotion, MotionWish
    from cellwright.engine.pipelines.motion.problem_sets import MotionProblem

app = typer.Typer(add_completion=False, no_args_is_help=True)
MOTION_EXIT_CODES = {"found": 0, "infeasible": INFEASIBLE, "gave up": GAVE_UP}
MOTION_END_FORMS = (
    'home, a place of the cell, joint values "0, 90, 0, 0, 45, 0", "point X, Y, Z" or "pose X, '
    'Y, Z, R, P, Y"'
)


class MotionStrategy(StrEnum):
    """The strategies of `cellwright.engine.model.motion_values`, named here so that help needs
    no array library.
    """

    CONNECT = "connect"
    VISIBILITY = "visibility"
    REDUCED = "reduced"


class MotionForm(StrEnum):
    """The forms in which a motion is shown."""

    TEXT = "text"
    JSON = "json"
    SVG = "svg"
    GLTF = "gltf"
    PNG = "png"


class TableForm(StrEnum):
    """The forms in which travel times are shown; facts are for a problem file."""

    TEXT = "text"
    JSON = "json"
    FACTS = "facts"


From = Annotated[str, Option("--from", help=f"where it starts: {MOTION_END_FORMS}")]
To = Annotated[
    list[str] | None, Option("--to", help="where it goes: the same; of several, one is reached")
]
Problems = Annotated[
    Path | None, Option(help="replay this set of problems, in place of --from and --to")
]
Margin = Annotated[
    float,
    Option(min=0, max=10, callback=number_option, help="metres that everything must stay clear"),
]
Bridges = Annotated[
    int, Option(min=0, max=100_000, help="short cuts that are tried: more work, a shorter path")
]
Strategy = Annotated[
    MotionStrategy,
    Option(
        metavar="WAY",
        help="connect: two trees; visibility: the hand first; reduced: three joints at a time",
    ),
]
Refine = Annotated[
    int,
    Option(
        min=0, max=100_000_000, help="configurations to look at for a shorter path, such as 100000"
    ),
]
Budget = Annotated[
    int, Option(min=1, max=1_000_000_000, help="configurations to look at before it gives up")
]
Upright = Annotated[
    float,
    Option(
        min=0,
        max=90,
        callback=number_option,
        help="degrees by which what is in hand may tilt; 0: as it likes",
    ),
]
Direct = Annotated[
    bool, Option("--direct", help="no straight lines of the tool out of places and into them")
]
Tool = Annotated[str, Option(help="the tool in hand, where no place says which")]
Rest = Annotated[bool, Option("--rest", help="rest at each configuration, and cut no corner")]
MotionJobs = Annotated[
    int,
    Option(
        "--jobs", min=0, help="number_option of processes; 0 means as many as there are processors"
    ),
]
Notes = Annotated[
    str,
    Option(
        "--store", help="a library that notes what is finished, until all is: the next call goes on"
    ),
]
Shown = Annotated[MotionForm, Option("--format", help="how it is shown")]
Azimuth = Annotated[
    float, Option(callback=number_option, help="degrees about z from which a PNG is seen")
]
Elevation = Annotated[float, Option(callback=number_option, help="degrees above the ground")]
Output = Annotated[Path | None, Option("--output", "-o", help="the file to write")]


@app.callback()
def motion_group() -> None:
    """Plan motions of an arm."""


@app.command("plan")
def plan_motion(
    target: Target,
    start: From = "",
    goal: To = None,
    problems: Problems = None,
    margin: Margin = 0.0,
    bridges: Bridges = 60,
    strategy: Strategy = MotionStrategy.CONNECT,
    refine: Refine = 0,
    upright: Upright = 0.0,
    budget: Budget = 1_000_000,
    direct: Direct = False,
    tool: Tool = "",
    rest: Rest = False,
    jobs: MotionJobs = 1,
    cluster: Cluster = "",
    store: Notes = "",
    seed: Seed = 0,
    format: Shown = MotionForm.TEXT,
    output: Output = None,
    azimuth: Azimuth = -140.0,
    elevation: Elevation = 30.0,
) -> None:
    """Plan a motion in the cell of TARGET that touches nothing, and prove it."""
    _refuse_misfits(problems, start, goal, format, output)
    work = _worker_options(jobs, cluster, store, "" if problems else "without --problems")
    form = AnswerForm.JSON if format is MotionForm.JSON else AnswerForm.TEXT

    def wished() -> "MotionWish":
        from cellwright.engine.model.motion_values import Strategy

        planner_strategy, tilt_rad = Strategy(strategy.value), math.radians(upright)
        return motion.MotionWish(
            margin,
            seed,
            bridges,
            planner_strategy,
            direct,
            tool,
            not rest,
            refine,
            tilt_rad,
            budget,
        )

    if problems is not None:
        give_answer(lambda: _replay_set(target, problems, wished, output, work), form)
    seen, ends = (math.radians(azimuth), math.radians(elevation)), (start, tuple(goal or ()))
    give_answer(lambda: _plan_motion(target, ends, wished, format, output, seen), form)


def _replay_set(
    target: str,
    problems: Path,
    wished: "Callable[[], MotionWish]",
    output: Path | None,
    work: WorkerOptions,
) -> VerbAnswer:

    return replay_problem_set(target, problems, wished, output, work)


def _worker_options(jobs: int, cluster: str, store: str, idle: str = "") -> WorkerOptions:
    """How units of work are carried out.

    Raises `typer.BadParameter` for --jobs beside --cluster, or for any where they are idle.
    """
    if idle:
        refuse_idle({"--jobs": jobs != 1, "--cluster": cluster, "--store": store}, idle)
    if cluster:
        refuse_idle({"--jobs": jobs != 1}, "with --cluster")
    return WorkerOptions(jobs, cluster, store)


def _refuse_misfits(
    problems: Path | None,
    start: str,
    goal: list[str] | None,
    format: MotionForm,
    output: Path | None,
) -> None:
    """Refuse options that do not go together."""
    pictured = format not in (MotionForm.TEXT, MotionForm.JSON)
    if problems is not None:
        refuse_idle(
            {"--from": start, "--to": goal, f"--format {format}": pictured}, "with --problems"
        )
    elif not (start and goal):
        raise make_misfit("give --from and --to, or --problems")
    elif not pictured:
        refuse_idle({"--output": output}, "without a picture: give --format svg, gltf or png")
    if format is MotionForm.PNG and output is None:
        raise make_misfit("--format png needs --output")


@app.command("problems")
def motion_problems(
    target: Target,
    count: Annotated[int, Option(min=1, max=10_000, help="how many problems are drawn")] = 20,
    tool: Tool = "",
    seed: Seed = 0,
    output: Output = None,
) -> None:
    """Draw motion problems in the cell of TARGET: to free configurations and places, from free
    configurations.
    """

    give_answer(lambda: generate_problem_set(target, count, seed, tool, output), AnswerForm.TEXT)


@app.command("travel")
def motion_travel(
    target: Target,
    tool: Tool = "",
    place: Annotated[
        list[str] | None, Option(help="only these places; all that take the tool otherwise")
    ] = None,
    jobs: MotionJobs = 1,
    cluster: Cluster = "",
    store: Notes = "",
    format: Annotated[TableForm, Option("--format", help="how it is shown")] = TableForm.TEXT,
) -> None:
    """Print how long free motions between the places of TARGET's cell take."""

    form = AnswerForm.JSON if format is TableForm.JSON else AnswerForm.TEXT
    work = _worker_options(jobs, cluster, store)
    give_answer(
        lambda: travel_table_answer(
            target, tool, tuple(place or ()), format is TableForm.FACTS, work
        ),
        form,
    )


Played = Annotated[
    str, Argument(metavar="TARGET", help="what `plan` takes; leave it out with --run")
]
Film = Annotated[
    Path | None,
    Option(
        "--output", "-o", help="FILE.gltf for a scene that moves, FILE.png for numbered pictures"
    ),
]
RunName = Annotated[str, Option("--run", help="play this run from its journal")]
Journals = Annotated[
    str,
    Option(
        "--store",
        envvar="CELLWRIGHT_STORE",
        help="with --run: the journal; else where poses are kept",
    ),
]
Every = Annotated[
    float,
    Option(
        min=0,
        max=3600,
        callback=number_option,
        help="seconds between two shots; 0: 0.1, or 1 for pictures",
    ),
]


@app.command("play")
def motion_play(
    target: Played = "",
    output: Film = None,
    run: RunName = "",
    store: Journals = "",
    every: Every = 0.0,
    azimuth: Azimuth = -140.0,
    elevation: Elevation = 30.0,
    seed: Seed = 0,
    format: Format = AnswerForm.TEXT,
) -> None:
    """Write a film of the plan of TARGET, or of a run, with everything that moves."""
    if bool(target) == bool(run):
        raise make_misfit("give a target, or a run with --run")
    if output is None or output.suffix not in (".gltf", ".png"):
        raise make_misfit("give -o FILE.gltf or -o FILE.png")
    seen, file = (math.radians(azimuth), math.radians(elevation)), output
    pace = every or (1.0 if file.suffix == ".png" else 0.1)

    def played() -> VerbAnswer:
        from cellwright.engine.faces.cli.verbs import motion_film as films

        if run:
            return films.film_of_run(run, store or kb_store.default_store(), seed, file, pace, seen)
        return films.film_of_plan(target, seed, store, file, pace, seen)

    give_answer(played, format)


def _plan_motion(
    target: str,
    ends: tuple[str, tuple[str, ...]],
    wished: "Callable[[], MotionWish]",
    form: MotionForm,
    output: Path | None,
    seen: tuple[float, float],
) -> VerbAnswer:
    planned_motion = motion.plan_named_motion(motion.MotionSite.of(target), *ends, wished())
    status, motion_text = (
        report.motion_status(planned_motion.answer),
        report.motion_text(planned_motion),
    )
    if form not in (MotionForm.TEXT, MotionForm.JSON):
        drawn = _draw_motion(planned_motion, form, seen)
        if output is None and drawn:
            return VerbAnswer(status, raw=drawn.decode("utf-8"))
        if output is not None and drawn:
            output.write_bytes(drawn)
            motion_text = f"{motion_text}\n{output}"
    return VerbAnswer(
        status,
        report.motion_content(planned_motion),
        lambda: rich_parts.Text(motion_text),
        MOTION_EXIT_CODES[status],
    )


def _draw_motion(found: "ArmMotion", form: MotionForm, seen: tuple[float, float]) -> bytes:
    """The picture of a motion.

    Where there is no path, only PNG has one: where it is blocked worst.
    """
    if form is MotionForm.PNG:
        return report.motion_png(found, *seen)
    if not found.legs:
        return b""
    return (
        report.motion_svg(found) if form is MotionForm.SVG else report.motion_gltf(found)
    ).encode("utf-8")


def generate_problem_set(
    target: str, count: int, seed: int, tool: str, output: Path | None
) -> VerbAnswer:
    """A new problem set, printed or written."""
    listed = motion.problem_entries(
        motion.draw_motion_problems(motion.MotionSite.of(target), count, seed, tool)
    )
    if output is None:
        return VerbAnswer("found", raw=_problem_set_text({"problems": listed}))
    output.write_text(_problem_set_text({"problems": listed}), encoding="utf-8")
    saved_text = (
        f"{len(listed)} problems in {output}; replay them with: motion plan {target} --problems "
        f"{output}"
    )
    return VerbAnswer("found", {"problems": listed}, lambda: rich_parts.Text(saved_text))


def replay_problem_set(
    target: str,
    problems: Path,
    wished: "Callable[[], MotionWish]",
    output: Path | None,
    work: "WorkerOptions",
) -> VerbAnswer:
    """What the planner makes of a saved set; exit code 10 if an answer is not the saved one."""
    crew = crew_asked(work.jobs, work.cluster)
    with SearchInterruption() as interrupted, progress_of("motions") as progress:
        replayed_problems = motion.replayed_set(
            target, _read_problem_set(problems), wished(), crew, work.store, interrupted, progress
        )
    entry = report.replay_entry(replayed_problems)
    if output is not None:
        output.write_text(_problem_set_text(entry), encoding="utf-8")
    changed = any(replayed_problem.same is False for replayed_problem in replayed_problems)
    return VerbAnswer(
        "changed" if changed else "found",
        entry,
        lambda: report.replay_table(replayed_problems),
        INFEASIBLE if changed else 0,
    )


def _read_problem_set(path: Path) -> "list[MotionProblem]":
    from cellwright.kb.json_text import parse_json

    try:
        content = parse_json(read_file(path).text)
    except ValueError:
        content = None
    return motion.problems_in(content, str(path))


def _problem_set_text(content: dict[str, object]) -> str:
    return json.dumps(content, indent=1) + "\n"


def travel_table_answer(
    target: str, tool: str, places: tuple[str, ...], facts: bool, work: "WorkerOptions"
) -> VerbAnswer:
    """Travel times between the places of a cell; with `facts`, as facts for a problem file."""
    from cellwright.kb.syntax import SECONDS_PER_UNIT

    unit_s = float(SECONDS_PER_UNIT[loader.load(loader.find_target(target)).domain.time_unit])
    crew = crew_asked(work.jobs, work.cluster)
    with SearchInterruption() as interrupted:
        travel_times = motion.table_by(target, tool, places, crew, work.store, interrupted)
    if facts:
        return VerbAnswer(
            "found", raw="".join(f"  - {fact}\n" for fact in travel_times.facts(unit_s))
        )
    return VerbAnswer(
        "found",
        report.travel_entry(travel_times, unit_s),
        lambda: report.travel_table(travel_times),
    )
