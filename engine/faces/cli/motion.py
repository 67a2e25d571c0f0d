"""`cellwright motion`: paths of an arm in a cell."""

import math
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cellwright.engine.faces.cli.answers import Answer, Form, give
from cellwright.engine.faces.cli.declared import Argument, Option, misfit
from cellwright.engine.faces.cli.exits import GAVE_UP, INFEASIBLE
from cellwright.engine.faces.cli.idle import refuse_idle
from cellwright.engine.faces.cli.options import Cluster, Format, Seed, Target, number
from cellwright.engine.faces.cli.working import Work

if TYPE_CHECKING:
    from cellwright.engine.pipelines.motion.moving import Motion, Wish

app = typer.Typer(add_completion=False, no_args_is_help=True)
CODES = {"found": 0, "infeasible": INFEASIBLE, "gave up": GAVE_UP}
NAMED = (
    'home, a place of the cell, joint values "0, 90, 0, 0, 45, 0", "point X, Y, Z" or "pose X, Y, Z, R, P, Y"'
)


class Way(StrEnum):
    """The strategies of `cellwright.engine.model.motion`, named here so that help needs no array library."""

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


From = Annotated[str, Option("--from", help=f"where it starts: {NAMED}")]
To = Annotated[list[str] | None, Option("--to", help="where it goes: the same; of several, one is reached")]
Problems = Annotated[Path | None, Option(help="replay this set of problems, in place of --from and --to")]
Margin = Annotated[
    float, Option(min=0, max=10, callback=number, help="metres that everything must stay clear")
]
Bridges = Annotated[
    int, Option(min=0, max=100_000, help="short cuts that are tried: more work, a shorter path")
]
Strategy = Annotated[
    Way,
    Option(
        metavar="WAY", help="connect: two trees; visibility: the hand first; reduced: three joints at a time"
    ),
]
Refine = Annotated[
    int,
    Option(min=0, max=100_000_000, help="configurations to look at for a shorter path, such as 100000"),
]
Budget = Annotated[int, Option(min=1, max=1_000_000_000, help="configurations to look at before it gives up")]
Upright = Annotated[
    float,
    Option(min=0, max=90, callback=number, help="degrees by which what is in hand may tilt; 0: as it likes"),
]
Direct = Annotated[bool, Option("--direct", help="no straight lines of the tool out of places and into them")]
Tool = Annotated[str, Option(help="the tool in hand, where no place says which")]
Rest = Annotated[bool, Option("--rest", help="rest at each configuration, and cut no corner")]
MotionJobs = Annotated[
    int, Option("--jobs", min=0, help="number of processes; 0 means as many as there are processors")
]
Notes = Annotated[
    str,
    Option("--store", help="a library that notes what is finished, until all is: the next call goes on"),
]
Shown = Annotated[MotionForm, Option("--format", help="how it is shown")]
Azimuth = Annotated[float, Option(callback=number, help="degrees about z from which a PNG is seen")]
Elevation = Annotated[float, Option(callback=number, help="degrees above the ground")]
Output = Annotated[Path | None, Option("--output", "-o", help="the file to write")]


@app.callback()
def motion() -> None:
    """Plan motions of an arm."""


@app.command("plan")
def plan_motion(
    target: Target,
    start: From = "",
    goal: To = None,
    problems: Problems = None,
    margin: Margin = 0.0,
    bridges: Bridges = 60,
    strategy: Strategy = Way.CONNECT,
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
    work = _work(jobs, cluster, store, "" if problems else "without --problems")
    form = Form.JSON if format is MotionForm.JSON else Form.TEXT

    def wished() -> "Wish":
        from cellwright.engine.model.motion import Strategy
        from cellwright.engine.pipelines.motion.moving import Wish

        way, tilt_rad = Strategy(strategy.value), math.radians(upright)
        return Wish(margin, seed, bridges, way, direct, tool, not rest, refine, tilt_rad, budget)

    if problems is not None:
        give(lambda: _replayed(target, problems, wished, output, work), form)
    seen, ends = (math.radians(azimuth), math.radians(elevation)), (start, tuple(goal or ()))
    give(lambda: _planned(target, ends, wished, format, output, seen), form)


def _replayed(
    target: str, problems: Path, wished: "Callable[[], Wish]", output: Path | None, work: Work
) -> Answer:
    from cellwright.engine.faces.cli.motion_sets import replays

    return replays(target, problems, wished, output, work)


def _work(jobs: int, cluster: str, store: str, idle: str = "") -> Work:
    """How units of work are carried out. Raises `IdleOption` for --jobs beside --cluster, or for any where they are idle."""
    if idle:
        refuse_idle({"--jobs": jobs != 1, "--cluster": cluster, "--store": store}, idle)
    if cluster:
        refuse_idle({"--jobs": jobs != 1}, "with --cluster")
    return Work(jobs, cluster, store)


def _refuse_misfits(
    problems: Path | None, start: str, goal: list[str] | None, format: MotionForm, output: Path | None
) -> None:
    """Refuse options that do not go together."""
    pictured = format not in (MotionForm.TEXT, MotionForm.JSON)
    if problems is not None:
        refuse_idle({"--from": start, "--to": goal, f"--format {format}": pictured}, "with --problems")
    elif not (start and goal):
        raise misfit("give --from and --to, or --problems")
    elif not pictured:
        refuse_idle({"--output": output}, "without a picture: give --format svg, gltf or png")
    if format is MotionForm.PNG and output is None:
        raise misfit("--format png needs --output")


@app.command("problems")
def motion_problems(
    target: Target,
    count: Annotated[int, Option(min=1, max=10_000, help="how many problems are drawn")] = 20,
    tool: Tool = "",
    seed: Seed = 0,
    output: Output = None,
) -> None:
    """Draw motion problems in the cell of TARGET: to free configurations and places, from free configurations."""
    from cellwright.engine.faces.cli.motion_sets import generated

    give(lambda: generated(target, count, seed, tool, output), Form.TEXT)


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
    from cellwright.engine.faces.cli.motion_sets import table

    form = Form.JSON if format is TableForm.JSON else Form.TEXT
    work = _work(jobs, cluster, store)
    give(lambda: table(target, tool, tuple(place or ()), format is TableForm.FACTS, work), form)


Played = Annotated[str, Argument(metavar="TARGET", help="what `plan` takes; leave it out with --run")]
Film = Annotated[
    Path | None,
    Option("--output", "-o", help="FILE.gltf for a scene that moves, FILE.png for numbered pictures"),
]
RunName = Annotated[str, Option("--run", help="play this run from its journal")]
Journals = Annotated[
    str,
    Option("--store", envvar="CELLWRIGHT_STORE", help="with --run: the journal; else where poses are kept"),
]
Every = Annotated[
    float,
    Option(min=0, max=3600, callback=number, help="seconds between two shots; 0: 0.1, or 1 for pictures"),
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
    format: Format = Form.TEXT,
) -> None:
    """Write a film of the plan of TARGET, or of a run, with everything that moves."""
    if bool(target) == bool(run):
        raise misfit("give a target, or a run with --run")
    if output is None or output.suffix not in (".gltf", ".png"):
        raise misfit("give -o FILE.gltf or -o FILE.png")
    seen, file = (math.radians(azimuth), math.radians(elevation)), output
    pace = every or (1.0 if file.suffix == ".png" else 0.1)

    def played() -> Answer:
        from cellwright.engine.faces.cli import motion_play as films
        from cellwright.kb.store.own import default_store

        if run:
            return films.film_of_run(run, store or default_store(), seed, file, pace, seen)
        return films.film_of_plan(target, seed, store, file, pace, seen)

    give(played, format)


def _planned(
    target: str,
    ends: tuple[str, tuple[str, ...]],
    wished: "Callable[[], Wish]",
    form: MotionForm,
    output: Path | None,
    seen: tuple[float, float],
) -> Answer:
    from rich.text import Text

    from cellwright.engine.formats.report import motion as report
    from cellwright.engine.pipelines.motion.moving import Site, move

    found = move(Site.of(target), *ends, wished())
    status, said = report.status(found.answer), report.text(found)
    if form not in (MotionForm.TEXT, MotionForm.JSON):
        drawn = _drawn(found, form, seen)
        if output is None and drawn:
            return Answer(status, raw=drawn.decode("utf-8"))
        if output is not None and drawn:
            output.write_bytes(drawn)
            said = f"{said}\n{output}"
    return Answer(status, report.content(found), lambda: Text(said), CODES[status])


def _drawn(found: "Motion", form: MotionForm, seen: tuple[float, float]) -> bytes:
    """The picture of a motion. Where there is no path, only PNG has one: where it is blocked worst."""
    from cellwright.engine.formats.report import motion_pictures as pictures

    if form is MotionForm.PNG:
        return pictures.as_png(found, *seen)
    if not found.legs:
        return b""
    return (pictures.as_svg(found) if form is MotionForm.SVG else pictures.as_gltf(found)).encode("utf-8")
