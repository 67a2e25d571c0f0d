"""The verbs `handey calibrate`: the error of a range finder and the pose of the camera."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Argument, Option

from cellwright.engine.faces.cli.options.scene_options import Calibration, SceneName, read_scene
from cellwright.engine.faces.cli.options.shared_options import Format, Seed
from cellwright.engine.faces.cli.output.answer_output import AnswerForm, VerbAnswer, give_answer
from cellwright.engine.formats import interop, report
from cellwright.engine.formats.report import rich_parts
from cellwright.engine.pipelines import manipulation
from cellwright.kb import loader

if TYPE_CHECKING:
    from cellwright.kb.model.part_scene import Scene

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    help="Calibrate the range finder, or where it stands.",
)
Readings = Annotated[
    Path | None,
    Option(
        "--readings",
        help="depth images and how they were taken, as JSON (docs/placing.md); else they are made",
    ),
]

Keep = Annotated[
    Path | None, Option("--keep", help="a file for what was found; --calibration reads it again")
]


@app.command("range")
def range_finder(
    scene: SceneName,
    readings: Readings = None,
    keep: Keep = None,
    calibration: Calibration = None,
    seed: Seed = 0,
    format: Format = AnswerForm.TEXT,
) -> None:
    """What the range finder errs by: images of a flat plate across its axis at known distances."""
    give_answer(lambda: _calibrate_range(scene, readings, seed, keep, calibration), format)


def _calibrate_range(
    scene: str, readings: Path | None, seed: int, keep: Path | None, calibration: Path | None
) -> VerbAnswer:
    read, hidden = read_scene(scene, calibration), None
    if readings is not None:
        images, distances = interop.read_plates(readings, read)
    else:
        images, distances, hidden = manipulation.plate_images(read, seed)
    range_calibration = manipulation.calibrate_range(read, images, distances)
    text = report.range_text(range_calibration, hidden) + _keep_calibration(
        keep, manipulation.with_range(read, range_calibration)
    )
    return VerbAnswer(
        "found", report.range_content(range_calibration), lambda: rich_parts.Text(text)
    )


@app.command()
def camera(
    target: Annotated[
        str, Argument(metavar="TARGET", help="the part that the arm holds before the camera")
    ],
    scene: SceneName,
    readings: Readings = None,
    number: Annotated[
        int,
        Option("--number", min=3, max=100, help="how many readings are made, if none are given"),
    ] = 12,
    keep: Keep = None,
    calibration: Calibration = None,
    seed: Seed = 0,
    format: Format = AnswerForm.TEXT,
) -> None:
    """Where the camera stands: images of a part that the arm holds at known joint values."""
    give_answer(
        lambda: _calibrate_camera(target, scene, readings, number, seed, (keep, calibration)),
        format,
    )


def _calibrate_camera(
    target: str,
    scene: str,
    readings: Path | None,
    number: int,
    seed: int,
    files: tuple[Path | None, Path | None],
) -> VerbAnswer:
    from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld

    keep, calibration = files
    read, hidden = read_scene(scene, calibration), None
    if readings is not None:
        held_images = interop.read_held(readings, read)
    else:
        held_images, hidden = manipulation.made_readings(read, target, number, seed)
    camera_calibration_entry = manipulation.calibrate_camera(read, target, held_images)
    text = report.camera_text(
        camera_calibration_entry,
        manipulation.camera_pose(read, GeometricWorld.of(read.cell)),
        hidden,
    )
    text += _keep_calibration(keep, manipulation.scene_with_camera(read, camera_calibration_entry))
    return VerbAnswer(
        "found", report.camera_content(camera_calibration_entry), lambda: rich_parts.Text(text)
    )


def _keep_calibration(keep: Path | None, scene: "Scene") -> str:
    """Keep what was found, if that is asked for; the line that says so."""
    if keep is None or scene.calibrated is None:
        return ""
    keep.write_text(loader.calibration_text(scene.calibrated), "utf-8")
    return f"\nkept in {keep}"
