"""`cellwright init`: a new domain."""

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

from cellwright.engine.faces.cli import completion
from cellwright.engine.faces.cli.answers import Answer, Form, give
from cellwright.engine.faces.cli.declared import Argument, Option, misfit
from cellwright.engine.faces.cli.options import Format


def init(
    folder: Annotated[Path, Argument(help="a folder that is new or empty")],
    with_: Annotated[
        str | None,
        Option(
            "--with",
            metavar="DEVICES",
            help="put it together from devices: furnace,drawer,balance; hotel=rack gives one a name",
            autocompletion=completion.devices,
        ),
    ] = None,
    format: Format = Form.TEXT,
) -> None:
    """Write a small commented domain into FOLDER, with problems, a fault base and a golden plan."""
    devices = [each.strip() for each in (with_ or "").split(",") if each.strip()]
    if with_ is not None and not devices:
        raise misfit("it names no device; `devices list` has their names", param_hint="--with")
    give(lambda: _assembled(folder, devices) if devices else _init(folder), format)


def _init(folder: Path) -> Answer:
    from cellwright.engine.authoring.starter import create

    verbs = (
        f"check {folder}",
        f"plan {folder}/problems/two_items.yaml",
        f"test {folder}",
        f"diagnose {folder} --exception not_gripped --tree",
    )
    return _answer(map(str, create(folder)), verbs)


def _assembled(folder: Path, devices: list[str]) -> Answer:
    from cellwright.engine.authoring.starter import create_with

    written, faults = create_with(folder, devices)
    problem = f"{folder}/problems/first.yaml"
    failing = [f"run {problem} --fault {faults[-1]}"] if faults else []
    verbs = (f"check {folder}", f"plan {problem}", f"run {problem}", *failing, f"test {folder}")
    return _answer(map(str, written), verbs)


def _answer(files: Iterable[str], verbs: Iterable[str]) -> Answer:
    from rich.text import Text

    written = list(files)
    advice = ["try", *(f"  cellwright {verb}" for verb in verbs)]
    return Answer("ok", {"written": written}, lambda: Text("\n".join([*written, *advice])))
