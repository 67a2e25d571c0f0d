"""The verbs `handey`: assemblies and portions of motions in a scene, and an operator followed."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Argument, Option

from cellwright.engine.faces.cli.options.scene_options import (
    Calibration,
    Image,
    SceneName,
    knock_of,
    read_scene,
    shifts_of,
)
from cellwright.engine.faces.cli.options.shared_options import Format, Seed, number_option
from cellwright.engine.faces.cli.output.answer_output import AnswerForm, VerbAnswer, give_answer
from cellwright.engine.faces.cli.process.exit_codes import FINDINGS, GAVE_UP, INFEASIBLE, STOPPED
from cellwright.engine.faces.cli.verbs.calibration_verbs import app as calibration
from cellwright.engine.faces.cli.wrong_options import make_misfit
from cellwright.engine.formats import interop, report
from cellwright.engine.formats.report import rich_parts
from cellwright.engine.pipelines import manipulation
from cellwright.kb import loader
from cellwright.kb.targets import find_scene

if TYPE_CHECKING:
    from cellwright.engine.pipelines.manipulation.assembly_execution import PartShift
    from cellwright.engine.pipelines.manipulation.assembly_order import Built
    from cellwright.engine.pipelines.manipulation.camera_optics import CameraErrors
    from cellwright.kb.model.domain_model import Domain
    from cellwright.kb.model.part_scene import Scene

HANDEY_EXIT_CODES = {"found": 0, "infeasible": INFEASIBLE, "gave up": GAVE_UP}
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
        Option(
            "--execute", help="carry it out in MuJoCo, with tests and repairs where it goes wrong"
        ),
    ] = False,
    shift: Annotated[
        list[str] | None,
        Option(
            "--shift",
            help="with --execute: move a part or a fixture after it was seen, NAME=X,Y,TURN in "
            "mm and degrees; may be repeated",
        ),
    ] = None,
    remove: Annotated[
        list[str] | None,
        Option(
            "--remove", help="with --execute: take a part away after it was seen; may be repeated"
        ),
    ] = None,
    knock: Annotated[
        str,
        Option(
            "--knock",
            help="with --execute: the camera was knocked after it was calibrated, X,Y,Z,A,B,C in "
            "mm and degrees along its axes",
        ),
    ] = "",
    calibration: Calibration = None,
    seed: Seed = 0,
    format: Format = AnswerForm.TEXT,
) -> None:
    """Put all parts of a scene where its relations say, in an order that the task planner finds
    and geometry proves.
    """
    changes = (shift or [], remove or [])
    if (any(changes) or knock) and not execute:
        raise make_misfit("--shift, --remove and --knock change what is executed: add --execute")
    if image is not None and execute:
        raise make_misfit("--execute makes its images from the scene: leave out --image")
    done = (changes, knock) if execute else None
    give_answer(
        lambda: _assemble_scene(base, read_scene(scene, calibration), image, seed, done), format
    )


def _assemble_scene(
    base: str,
    read: "Scene",
    image: Path | None,
    seed: int,
    done: tuple[tuple[list[str], list[str]], str] | None,
) -> VerbAnswer:
    from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld

    depth_image = interop.read_depth(image, manipulation.camera_of(read)) if image else None
    domain, shifts = (
        loader.load_domain("handey"),
        shifts_of(read, *done[0]) if done is not None else None,
    )
    knock = knock_of(done[1] if done is not None else "")
    if done is not None and done[1]:
        depth_image = manipulation.CameraOptics.of(read, knock).image(
            GeometricWorld.of(read.cell), seed
        )
    assembly, _ = manipulation.assemble_scene(read, domain, base, seed, depth_image)
    answer_text = report.assembly_text(assembly, base)
    status = report.assembly_status(assembly)
    if shifts is not None and isinstance(assembly, manipulation.Built):
        return _execute_assembly(assembly, domain, (shifts, knock), answer_text, seed)
    return VerbAnswer(
        status,
        report.assembly_content(assembly),
        lambda: rich_parts.Text(answer_text),
        HANDEY_EXIT_CODES[status],
    )


def _execute_assembly(
    made: "Built",
    domain: "Domain",
    changes: "tuple[Sequence[PartShift], CameraErrors]",
    said: str,
    seed: int,
) -> VerbAnswer:
    done = manipulation.execute_assembly(made, domain, changes[0], seed, knock=changes[1])
    outcome = done.runs[-1].outcome
    content = {**report.assembly_content(made), "execution": report.physics_content(done)}
    text = f"{said}\n{report.physics_text(done)}"
    return VerbAnswer(
        outcome,
        content,
        lambda: rich_parts.Text(text),
        {"reached": 0, "partly": FINDINGS}.get(outcome, STOPPED),
    )


@app.command()
def align(
    first: Annotated[str, Argument(metavar="FEATURE", help="of the part, such as angle.heel")],
    kind: Annotated[
        str, Argument(metavar="RELATION", help="such as parallel, aligned or coplanar")
    ],
    second: Annotated[str, Argument(metavar="FEATURE", help="of another body, such as base.front")],
    scene: SceneName,
    by: Annotated[
        float,
        Option(
            callback=number_option,
            help="how far or how much, in millimetres or degrees, where the relation asks",
        ),
    ] = 0.0,
    image: Image = None,
    seed: Seed = 0,
    format: Format = AnswerForm.TEXT,
) -> None:
    """Plan one portion: take a part, and bring it to where one relation holds.

    It stays in the hand.
    """
    give_answer(lambda: _align_features(first, kind, second, by, scene, image, seed), format)


def _align_features(
    first: str, kind: str, second: str, by: float, scene: str, image: Path | None, seed: int
) -> VerbAnswer:
    read = loader.load_scene(find_scene(scene))
    relation = loader.relation_of(read.cell, first, kind, second, by)
    depth_image = interop.read_depth(image, manipulation.camera_of(read)) if image else None
    portion = manipulation.bring_to_relation(read, relation, seed, depth_image)
    status, text = report.portion_status(portion), report.portion_text(portion, relation)
    return VerbAnswer(
        status,
        report.portion_content(portion),
        lambda: rich_parts.Text(text),
        HANDEY_EXIT_CODES[status],
    )


@app.command()
def watch(
    part: Annotated[str, Argument(metavar="PART", help="the part that an operator places")],
    base: Annotated[str, Argument(metavar="PART", help="the body that it is placed on")],
    scene: SceneName,
    acts: Annotated[Path, Option(help="what the operator does, as JSON (docs/placing.md)")],
    image: Image = None,
    seed: Seed = 0,
    format: Format = AnswerForm.TEXT,
) -> None:
    """Follow an operator who places a part, and warn as soon as the goal has become hard or
    impossible.
    """
    give_answer(lambda: _watch_operator(part, base, scene, acts, image, seed), format)


def _watch_operator(
    part: str, base: str, scene: str, acts: Path, image: Path | None, seed: int
) -> VerbAnswer:
    read = loader.load_scene(find_scene(scene))
    events = interop.read_acts(acts, read)
    depth_image = interop.read_depth(image, manipulation.camera_of(read)) if image else None
    state = manipulation.begin_watching(read, part, base, seed, depth_image)
    if isinstance(state, manipulation.NotPlaced):
        why, status = (
            report.placing_text(state, part, base),
            report.placing_status(state),
        )
        return VerbAnswer(
            status,
            report.placing_content(state),
            lambda: rich_parts.Text(why),
            HANDEY_EXIT_CODES[status],
        )
    forecasts = list(manipulation.watch_events(state, events))
    warned = any(forecast is not None for _, forecast in forecasts)
    content, text = (
        report.followed_content(state, forecasts),
        report.followed_text(state, forecasts),
    )
    return VerbAnswer(
        "warned" if warned else "found",
        content,
        lambda: rich_parts.Text(text),
        FINDINGS if warned else 0,
    )
