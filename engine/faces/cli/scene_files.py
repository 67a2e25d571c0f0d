"""The options that name a scene and an image of it."""

from pathlib import Path
from typing import Annotated

import typer

from engine.faces.cli import completion

SceneName = Annotated[
    str,
    typer.Option(
        "--scene",
        help="a scene file, or the name of a bundled one, such as handey or handey/five",
        autocompletion=completion.scenes,
    ),
]
Image = Annotated[
    Path | None,
    typer.Option(
        "--image",
        help="the depth image: .npy, 16-bit .png in mm, .pcd or .ply; else it is made from the scene",
    ),
]
