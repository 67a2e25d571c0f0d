"""The scene that a command line means."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from kb.model.scene import Scene

SCENE_FILE = "scene.yaml"
SceneName = Annotated[
    str,
    typer.Option("--scene", help="a scene file, or the name of a bundled one, such as handey or handey/five"),
]
Image = Annotated[
    Path | None,
    typer.Option(
        "--image",
        help="the depth image: .npy, 16-bit .png in mm, .pcd or .ply; else it is made from the scene",
    ),
]
Calibration = Annotated[
    Path | None,
    typer.Option(
        "--calibration", help="a file with what calibrations have found of the camera (docs/placing.md)"
    ),
]


def scene_of(scene: str, calibration: Path | None = None) -> "Scene":
    """The scene that is meant, its camera as it was calibrated. Raises `InvalidInput`."""
    from dataclasses import replace

    from kb.loader.calibration import load_calibration
    from kb.loader.scene import load_scene

    found = load_scene(scene_file(scene))
    return found if calibration is None else replace(found, calibrated=load_calibration(calibration))


def scene_file(scene: str) -> Path:
    """The file that is meant. Raises `InvalidInput`."""
    from kb.diagnostics import Diagnostic, InvalidInput, Source, nearest
    from kb.files import is_file
    from kb.targets import BUNDLED

    bundled = {path.parent.name: path for path in sorted(BUNDLED.glob(f"*/{SCENE_FILE}"))}
    more = sorted(path for path in BUNDLED.glob("*/scenes/*.yaml") if not path.stem.endswith("_cell"))
    bundled |= {f"{path.parent.parent.name}/{path.stem}": path for path in more}
    if is_file(Path(scene)):
        return Path(scene)
    if scene in bundled:
        return bundled[scene]
    hint = nearest(scene, list(bundled)) or f"bundled: {', '.join(bundled)}"
    raise InvalidInput([Diagnostic(Source(scene), "K401", "no file and no bundled scene of this name", hint)])
