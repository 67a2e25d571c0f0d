"""`cellwright handey calibrate`: what a range finder errs by, and where the camera stands."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cellwright.engine.faces.cli.answers import Answer, Form, give
from cellwright.engine.faces.cli.declared import Argument, Option
from cellwright.engine.faces.cli.options import Format, Seed
from cellwright.engine.faces.cli.scene_files import Calibration, SceneName, scene_of

if TYPE_CHECKING:
    from cellwright.kb.model.scene import Scene

app = typer.Typer(
    add_completion=False, no_args_is_help=True, help="Calibrate the range finder, or where it stands."
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
    format: Format = Form.TEXT,
) -> None:
    """What the range finder errs by: images of a flat plate across its axis at known distances."""
    give(lambda: _range(scene, readings, seed, keep, calibration), format)


def _range(
    scene: str, readings: Path | None, seed: int, keep: Path | None, calibration: Path | None
) -> Answer:
    from rich.text import Text

    from cellwright.engine.formats.interop.calibration_files import read_plates
    from cellwright.engine.formats.report import calibration as report
    from cellwright.engine.pipelines.placing import calibrating

    read, hidden = scene_of(scene, calibration), None
    if readings is not None:
        images, distances = read_plates(readings, read)
    else:
        images, distances, hidden = calibrating.plates(read, seed)
    found = calibrating.calibrate_range(read, images, distances)
    text = report.range_text(found, hidden) + _kept(keep, calibrating.with_range(read, found))
    return Answer("found", report.range_content(found), lambda: Text(text))


@app.command()
def camera(
    target: Annotated[str, Argument(metavar="TARGET", help="the part that the arm holds before the camera")],
    scene: SceneName,
    readings: Readings = None,
    number: Annotated[
        int, Option("--number", min=3, max=100, help="how many readings are made, if none are given")
    ] = 12,
    keep: Keep = None,
    calibration: Calibration = None,
    seed: Seed = 0,
    format: Format = Form.TEXT,
) -> None:
    """Where the camera stands: images of a part that the arm holds at known joint values."""
    give(lambda: _camera(target, scene, readings, number, seed, (keep, calibration)), format)


def _camera(
    target: str,
    scene: str,
    readings: Path | None,
    number: int,
    seed: int,
    files: tuple[Path | None, Path | None],
) -> Answer:
    from rich.text import Text

    from cellwright.engine.formats.interop.calibration_files import read_held
    from cellwright.engine.formats.report import calibration as report
    from cellwright.engine.pipelines.placing import calibrating
    from cellwright.engine.pipelines.placing.looking import camera_pose
    from cellwright.engine.stages.geometry.world.model import World

    keep, calibration = files
    read, hidden = scene_of(scene, calibration), None
    if readings is not None:
        given = read_held(readings, read)
    else:
        given, hidden = calibrating.made(read, target, number, seed)
    found = calibrating.calibrate_camera(read, target, given)
    text = report.camera_text(found, camera_pose(read, World.of(read.cell)), hidden)
    text += _kept(keep, calibrating.with_camera(read, found))
    return Answer("found", report.camera_content(found), lambda: Text(text))


def _kept(keep: Path | None, scene: "Scene") -> str:
    """Keep what was found, if that is asked for; the line that says so."""
    from cellwright.kb.loader.calibration import calibration_text

    if keep is None or scene.calibrated is None:
        return ""
    keep.write_text(calibration_text(scene.calibrated), "utf-8")
    return f"\nkept in {keep}"
