"""`cellwright init`: a new domain."""

from pathlib import Path
from typing import Annotated

import typer

from engine.faces.cli.answers import Answer, Form, give
from engine.faces.cli.options import Format


def init(
    folder: Annotated[Path, typer.Argument(help="a folder that is new or empty")], format: Format = Form.TEXT
) -> None:
    """Write a small commented domain into FOLDER, with problems, a fault base and a golden plan."""
    give(lambda: _init(folder), format)


def _init(folder: Path) -> Answer:
    from rich.text import Text

    from engine.authoring.starter import create

    written = [str(path) for path in create(folder)]
    verbs = (
        f"check {folder}",
        f"plan {folder}/problems/two_items.yaml",
        f"test {folder}",
        f"diagnose {folder} --exception not_gripped --tree",
    )
    advice = ["try", *(f"  cellwright {verb}" for verb in verbs)]
    return Answer("ok", {"written": written}, lambda: Text("\n".join([*written, *advice])))
