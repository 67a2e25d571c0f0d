"""`cellwright init`: a new domain."""

from pathlib import Path
from typing import Annotated

import typer

from engine.cli.answers import Answer, Form, give
from engine.cli.options import Format


def init(
    folder: Annotated[Path, typer.Argument(help="a folder that is new or empty")], format: Format = Form.TEXT
) -> None:
    """Write a small commented domain into FOLDER: it checks, plans, and has a golden plan."""
    give(lambda: _init(folder), format)


def _init(folder: Path) -> Answer:
    from rich.text import Text

    from engine.starter import create

    written = [str(path) for path in create(folder)]
    advice = f"try: cellwright check {folder}; cellwright plan {folder}/problems/two_items.yaml"
    return Answer("ok", {"written": written}, lambda: Text("\n".join([*written, advice])))
