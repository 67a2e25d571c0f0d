"""The options that name a scene and an image of it."""

from pathlib import Path
from typing import Annotated

import typer

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
