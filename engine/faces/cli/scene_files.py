"""The options that name a scene and an image of it."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cellwright.engine.faces.cli import completion
from cellwright.engine.faces.cli.declared import Option

if TYPE_CHECKING:
    from cellwright.kb.model.scene import Scene

SceneName = Annotated[
    str,
    Option(
        "--scene",
        help="a scene file, or the name of a bundled one, such as handey or handey/five",
        autocompletion=completion.scenes,
    ),
]
Image = Annotated[
    Path | None,
    Option(
        "--image",
        help="the depth image: .npy, 16-bit .png in mm, .pcd or .ply; else it is made from the scene",
    ),
]
Calibration = Annotated[
    Path | None,
    Option("--calibration", help="a file with what calibrations have found of the camera (docs/placing.md)"),
]


def scene_of(scene: str, calibration: Path | None = None) -> "Scene":
    """The scene that is meant, its camera as it was calibrated. Raises `InvalidInput`."""
    from dataclasses import replace

    from cellwright.kb.loader.calibration import load_calibration
    from cellwright.kb.loader.scene import load_scene
    from cellwright.kb.targets import find_scene

    found = load_scene(find_scene(scene))
    return found if calibration is None else replace(found, calibrated=load_calibration(calibration))
