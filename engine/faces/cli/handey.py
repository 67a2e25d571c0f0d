"""`cellwright handey`: assemblies, and portions of motions, of the scenes on which `place` works."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cellwright.engine.faces.cli.answers import Answer, Form, give
from cellwright.engine.faces.cli.calibration import app as calibration
from cellwright.engine.faces.cli.declared import Argument, Option, misfit
from cellwright.engine.faces.cli.exits import FINDINGS, GAVE_UP, INFEASIBLE
from cellwright.engine.faces.cli.options import Format, Seed, number
from cellwright.engine.faces.cli.scene_files import Calibration, Image, SceneName, scene_of

if TYPE_CHECKING:
    from cellwright.engine.pipelines.placing.assembling import Built
    from cellwright.engine.pipelines.placing.optics import Errors
    from cellwright.engine.pipelines.workshop.running import Shift
    from cellwright.kb.model.domain import Domain
    from cellwright.kb.model.scene import Scene

CODES = {"found": 0, "infeasible": INFEASIBLE, "gave up": GAVE_UP}
app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    help="Assemble parts, plan portions of their motions, and follow an operator.",
)

app.add_typer(calibration, name="calibrate")


@app.command()
def assemble(
    base: Annotated[str, Argument(help="the body on which the assembly is built")],
    scene: SceneName,
    image: Image = None,
    execute: Annotated[
        bool,
        Option("--execute", help="carry it out in MuJoCo, with tests and repairs where it goes wrong"),
    ] = False,
    shift: Annotated[
        list[str] | None,
        Option(
            "--shift",
            help="with --execute: move a part or a fixture after it was seen, NAME=X,Y,TURN in mm and degrees; may be repeated",
        ),
    ] = None,
    remove: Annotated[
        list[str] | None,
        Option("--remove", help="with --execute: take a part away after it was seen; may be repeated"),
    ] = None,
    knock: Annotated[
        str,
        Option(
            "--knock",
            help="with --execute: the camera was knocked after it was calibrated, X,Y,Z,A,B,C in mm and degrees along its axes",
        ),
    ] = "",
    calibration: Calibration = None,
    seed: Seed = 0,
    format: Format = Form.TEXT,
) -> None:
    """Put all parts of a scene where its relations say, in an order that the task planner finds and geometry proves."""
    changes = (shift or [], remove or [])
    if (any(changes) or knock) and not execute:
        raise misfit("--shift, --remove and --knock change what is executed: add --execute")
    if image is not None and execute:
        raise misfit("--execute makes its images from the scene: leave out --image")
    done = (changes, knock) if execute else None
    give(lambda: _assembled(base, scene_of(scene, calibration), image, seed, done), format)


def _assembled(
    base: str,
    read: "Scene",
    image: Path | None,
    seed: int,
    done: tuple[tuple[list[str], list[str]], str] | None,
) -> Answer:
    from rich.text import Text

    from cellwright.engine.faces.cli.execution_options import knock_of, shifts_of
    from cellwright.engine.formats.interop.depth_files import read_depth
    from cellwright.engine.formats.report import assembling as report
    from cellwright.engine.pipelines.placing import assembling, looking
    from cellwright.engine.pipelines.placing.optics import Optics
    from cellwright.engine.stages.geometry.world.model import World
    from cellwright.kb.loader import load_domain

    given = read_depth(image, looking.camera_of(read)) if image else None
    domain, shifts = load_domain("handey"), shifts_of(read, *done[0]) if done is not None else None
    knock = knock_of(done[1] if done is not None else "")
    if done is not None and done[1]:
        given = Optics.of(read, knock).image(World.of(read.cell), seed)
    made, _ = assembling.assemble(read, domain, base, seed, given)
    said = report.text(made, base)
    status = report.status(made)
    if shifts is not None and isinstance(made, assembling.Built):
        return _executed(made, domain, (shifts, knock), said, seed)
    return Answer(status, report.content(made), lambda: Text(said), CODES[status])


def _executed(
    made: "Built", domain: "Domain", changes: "tuple[Sequence[Shift], Errors]", said: str, seed: int
) -> Answer:
    from rich.text import Text

    from cellwright.engine.faces.cli.exits import STOPPED
    from cellwright.engine.formats.report import assembling as planned
    from cellwright.engine.formats.report import workshop as report
    from cellwright.engine.pipelines.workshop.running import executed

    done = executed(made, domain, changes[0], seed, knock=changes[1])
    outcome = done.runs[-1].outcome
    content = {**planned.content(made), "execution": report.content(done)}
    text = f"{said}\n{report.text(done)}"
    return Answer(
        outcome, content, lambda: Text(text), {"reached": 0, "partly": FINDINGS}.get(outcome, STOPPED)
    )


@app.command()
def align(
    first: Annotated[str, Argument(metavar="FEATURE", help="of the part, such as angle.heel")],
    kind: Annotated[str, Argument(metavar="RELATION", help="such as parallel, aligned or coplanar")],
    second: Annotated[str, Argument(metavar="FEATURE", help="of another body, such as base.front")],
    scene: SceneName,
    by: Annotated[
        float,
        Option(
            callback=number, help="how far or how much, in millimetres or degrees, where the relation asks"
        ),
    ] = 0.0,
    image: Image = None,
    seed: Seed = 0,
    format: Format = Form.TEXT,
) -> None:
    """Plan one portion: take a part, and bring it to where one relation holds. It stays in the hand."""
    give(lambda: _aligned(first, kind, second, by, scene, image, seed), format)


def _aligned(
    first: str, kind: str, second: str, by: float, scene: str, image: Path | None, seed: int
) -> Answer:
    from rich.text import Text

    from cellwright.engine.formats.interop.depth_files import read_depth
    from cellwright.engine.formats.report import portions as report
    from cellwright.engine.pipelines.placing import aligning, looking
    from cellwright.kb.loader.scene import load_scene, relation_of
    from cellwright.kb.targets import find_scene

    read = load_scene(find_scene(scene))
    said = relation_of(read.cell, first, kind, second, by)
    given = read_depth(image, looking.camera_of(read)) if image else None
    found = aligning.bring(read, said, seed, given)
    status, text = report.status(found), report.text(found, said)
    return Answer(status, report.content(found), lambda: Text(text), CODES[status])


@app.command()
def watch(
    part: Annotated[str, Argument(metavar="PART", help="the part that an operator places")],
    base: Annotated[str, Argument(metavar="PART", help="the body that it is placed on")],
    scene: SceneName,
    acts: Annotated[Path, Option(help="what the operator does, as JSON (docs/placing.md)")],
    image: Image = None,
    seed: Seed = 0,
    format: Format = Form.TEXT,
) -> None:
    """Follow an operator who places a part, and warn as soon as the goal has become hard or impossible."""
    give(lambda: _watched(part, base, scene, acts, image, seed), format)


def _watched(part: str, base: str, scene: str, acts: Path, image: Path | None, seed: int) -> Answer:
    from rich.text import Text

    from cellwright.engine.formats.interop.acts import read_acts
    from cellwright.engine.formats.interop.depth_files import read_depth
    from cellwright.engine.formats.report import placing as placing_report
    from cellwright.engine.formats.report import portions as report
    from cellwright.engine.pipelines.placing import looking, watching
    from cellwright.engine.pipelines.placing.answers import NotPlaced
    from cellwright.kb.loader.scene import load_scene
    from cellwright.kb.targets import find_scene

    read = load_scene(find_scene(scene))
    events = read_acts(acts, read)
    given = read_depth(image, looking.camera_of(read)) if image else None
    state = watching.begin(read, part, base, seed, given)
    if isinstance(state, NotPlaced):
        why, status = placing_report.text(state, part, base), placing_report.status(state)
        return Answer(status, placing_report.content(state), lambda: Text(why), CODES[status])
    told = list(watching.watched(state, events))
    warned = any(said is not None for _, said in told)
    content, text = report.events(state, told), report.followed(state, told)
    return Answer("warned" if warned else "found", content, lambda: Text(text), FINDINGS if warned else 0)
