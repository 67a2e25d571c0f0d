"""The verbs `handey calibrate`: the error of a range finder and the pose of the camera."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cellwright.engine.faces.cli.option_declarations import Argument, Option
from cellwright.engine.faces.cli.options.scene_options import Calibration, SceneName, read_scene
from cellwright.engine.faces.cli.options.shared_options import Format, Seed
from cellwright.engine.faces.cli.output.answer_output import AnswerForm, VerbAnswer, give_answer

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
    from rich.text import Text

    from cellwright.engine.formats.interop.calibration_files import read_plates
    from cellwright.engine.formats.report.cells import calibration_report as report
    from cellwright.engine.pipelines.manipulation import camera_calibration

    read, hidden = read_scene(scene, calibration), None
    if readings is not None:
        images, distances = read_plates(readings, read)
    else:
        images, distances, hidden = camera_calibration.plate_images(read, seed)
    range_calibration = camera_calibration.calibrate_range(read, images, distances)
    text = report.range_text(range_calibration, hidden) + _keep_calibration(
        keep, camera_calibration.with_range(read, range_calibration)
    )
    return VerbAnswer("found", report.range_content(range_calibration), lambda: Text(text))


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
    from rich.text import Text

    from cellwright.engine.formats.interop.calibration_files import read_held
    from cellwright.engine.formats.report.cells import calibration_report as report
    from cellwright.engine.pipelines.manipulation import camera_calibration
    from cellwright.engine.pipelines.manipulation.scene_camera import camera_pose
    from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld

    keep, calibration = files
    read, hidden = read_scene(scene, calibration), None
    if readings is not None:
        held_images = read_held(readings, read)
    else:
        held_images, hidden = camera_calibration.made_readings(read, target, number, seed)
    camera_calibration_entry = camera_calibration.calibrate_camera(read, target, held_images)
    text = report.camera_text(
        camera_calibration_entry, camera_pose(read, GeometricWorld.of(read.cell)), hidden
    )
    text += _keep_calibration(
        keep, camera_calibration.scene_with_camera(read, camera_calibration_entry)
    )
    return VerbAnswer("found", report.camera_content(camera_calibration_entry), lambda: Text(text))


def _keep_calibration(keep: Path | None, scene: "Scene") -> str:
    """Keep what was found, if that is asked for; the line that says so."""
    from cellwright.kb.loader.calibration_file import calibration_text

    if keep is None or scene.calibrated is None:
        return ""
    keep.write_text(calibration_text(scene.calibrated), "utf-8")
    return f"\nkept in {keep}"
