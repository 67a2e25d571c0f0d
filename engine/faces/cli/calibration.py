"""`cellwright handey calibrate`: what a range finder errs by, and where the camera stands."""

from pathlib import Path
from typing import Annotated

import typer

from engine.faces.cli.answers import Answer, Form, give
from engine.faces.cli.options import Format, Seed
from engine.faces.cli.scene_files import SceneName

app = typer.Typer(
    add_completion=False, no_args_is_help=True, help="Calibrate the range finder, or where it stands."
)
Readings = Annotated[
    Path | None,
    typer.Option(
        "--readings",
        help="depth images and how they were taken, as JSON (docs/placing.md); else they are made",
    ),
]


@app.command("range")
def range_finder(
    scene: SceneName, readings: Readings = None, seed: Seed = 0, format: Format = Form.TEXT
) -> None:
    """What the range finder errs by: images of a flat plate across its axis at known distances."""
    give(lambda: _range(scene, readings, seed), format)


def _range(scene: str, readings: Path | None, seed: int) -> Answer:
    from rich.text import Text

    from engine.formats.interop.calibration_files import read_plates
    from engine.formats.report import calibration as report
    from engine.pipelines.placing import calibrating
    from kb.loader.scene import load_scene
    from kb.targets import find_scene

    read, hidden = load_scene(find_scene(scene)), None
    if readings is not None:
        images, distances = read_plates(readings, read)
    else:
        images, distances, hidden = calibrating.plates(read, seed)
    found = calibrating.calibrate_range(read, images, distances)
    text = report.range_text(found, hidden)
    return Answer("found", report.range_content(found), lambda: Text(text))


@app.command()
def camera(
    target: Annotated[
        str, typer.Argument(metavar="TARGET", help="the part that the arm holds before the camera")
    ],
    scene: SceneName,
    readings: Readings = None,
    number: Annotated[
        int, typer.Option("--number", min=3, max=100, help="how many readings are made, if none are given")
    ] = 12,
    seed: Seed = 0,
    format: Format = Form.TEXT,
) -> None:
    """Where the camera stands: images of a part that the arm holds at known joint values."""
    give(lambda: _camera(target, scene, readings, number, seed), format)


def _camera(target: str, scene: str, readings: Path | None, number: int, seed: int) -> Answer:
    from rich.text import Text

    from engine.formats.interop.calibration_files import read_held
    from engine.formats.report import calibration as report
    from engine.pipelines.placing import calibrating
    from engine.pipelines.placing.looking import camera_pose
    from engine.stages.geometry.world.model import World
    from kb.loader.scene import load_scene
    from kb.targets import find_scene

    read, hidden = load_scene(find_scene(scene)), None
    if readings is not None:
        given = read_held(readings, read)
    else:
        made = calibrating.made(read, target, number, seed)
        given, hidden = made.readings, made.T_world_camera
    found = calibrating.calibrate_camera(read, target, given)
    text = report.camera_text(found, camera_pose(read, World.of(read.cell)), hidden)
    return Answer("found", report.camera_content(found), lambda: Text(text))
