"""Options that name a scene and its images, and how an execution by physics deviates from it."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from importlib.util import find_spec
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Option

from cellwright.engine.faces.cli.options import shared_options
from cellwright.engine.pipelines import manipulation
from cellwright.kb import loader
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, unknown_name
from cellwright.kb.numbers import NumberError, read_decimal

if TYPE_CHECKING:
    from cellwright.engine.pipelines.manipulation.assembly_execution import PartShift
    from cellwright.engine.pipelines.manipulation.camera_optics import CameraErrors
    from cellwright.kb.model.part_scene import Scene

SceneName = Annotated[
    str,
    Option(
        "--scene",
        help="a scene file, or the name of a bundled one, such as handey or handey/five",
        autocompletion=shared_options.complete_scenes,
    ),
]
Image = Annotated[
    Path | None,
    Option(
        "--image",
        help="the depth image: .npy, 16-bit .png in mm, .pcd or .ply; else it is made from the "
        "scene",
    ),
]
Calibration = Annotated[
    Path | None,
    Option(
        "--calibration",
        help="a file with what calibrations have found of the camera (docs/placing.md)",
    ),
]


def read_scene(scene: str, calibration: Path | None = None) -> "Scene":
    """The scene that is meant, its camera as it was calibrated. Raises `InvalidInput`."""
    from cellwright.kb.targets import find_scene

    loaded_scene = loader.load_scene(find_scene(scene))
    return (
        loaded_scene
        if calibration is None
        else replace(loaded_scene, calibrated=loader.load_calibration(calibration))
    )


def shifts_of(scene: "Scene", shifted: Sequence[str], removed: Sequence[str]) -> "list[PartShift]":
    """What is moved (PART=X,Y,TURN in mm and degrees) or taken away after it was seen.

    Raises `InvalidInput`.
    """
    needs_mujoco("--execute")
    return list(_read_shifts(scene, shifted, removed))


def knock_of(text: str) -> "CameraErrors":
    """By how much the camera was knocked: X,Y,Z,A,B,C in mm and degrees, along and about its
    own axes. Raises `InvalidInput`.
    """
    return manipulation.errors_of({"moved": text}, 0) if text else manipulation.CameraErrors()


def needs_mujoco(option: str) -> None:
    """Refuse what physics is needed for where MuJoCo is not installed. Raises `InvalidInput`."""
    if find_spec("mujoco") is None:
        message, hint = (
            f"{option} needs MuJoCo, which is not installed",
            "pip install 'cellwright[mujoco]'",
        )
        raise InvalidInput([Diagnostic(Source(option), "K414", message, hint)])


def _read_shifts(
    scene: "Scene", shifted: Sequence[str], removed: Sequence[str]
) -> "Iterator[PartShift]":
    for text in shifted:
        part, _, numbers = text.partition("=")
        x, y, turn = _three_numbers(numbers, text)
        yield manipulation.PartShift(
            _movable_part(scene, part, "--shift", fixed=True), (x / 1000, y / 1000), radians(turn)
        )
    for part in removed:
        yield manipulation.PartShift(_movable_part(scene, part, "--remove"), away=True)


def _three_numbers(numbers: str, text: str) -> tuple[float, float, float]:
    try:
        distances = [read_decimal(number_text.strip()) for number_text in numbers.split(",")]
    except NumberError:
        distances = []
    if len(distances) != 3:
        message = f"'{text}' does not say how a part is moved"
        raise InvalidInput(
            [
                Diagnostic(
                    Source("--shift"), "K107", message, "write wall_2=20,-10,15: mm, mm, degrees"
                )
            ]
        )
    return distances[0], distances[1], distances[2]


def _movable_part(scene: "Scene", name: str, option: str, fixed: bool = False) -> str:
    from cellwright.kb.model.cell_model import BodyKind

    kinds = (BodyKind.PART, BodyKind.FIXTURE) if fixed else (BodyKind.PART,)
    parts = [body_name for body_name, body in scene.cell.bodies.items() if body.kind in kinds]
    if name not in parts:
        raise InvalidInput(
            [unknown_name("part or fixture" if fixed else "part", name, parts, Source(option))]
        )
    return name
