"""`cellwright devices`: the parts that cells are put together from."""

from pathlib import Path
from typing import Annotated

import typer

from cellwright.engine.faces.cli.answers import Answer, Form, give
from cellwright.engine.faces.cli.declared import Argument, Option
from cellwright.engine.faces.cli.options import Format

Beside = Annotated[
    Path, Option("--beside", help="a domain folder: also its own devices, in its folder `devices`")
]

app = typer.Typer(add_completion=False, no_args_is_help=True)


@app.callback()
def devices() -> None:
    """Look at the devices that a domain can use."""


@app.command("list")
def list_(beside: Beside = Path(), format: Format = Form.TEXT) -> None:
    """List the devices that come with the engine, and those beside a domain."""
    give(lambda: _list(beside), format)


@app.command()
def show(
    name: Annotated[str, Argument(help="the name of a device")],
    beside: Beside = Path(),
    format: Format = Form.TEXT,
) -> None:
    """Print what a device is, its parameters, ports, own names and commands, and how a domain uses it."""
    give(lambda: _show(name, beside), format)


def _list(beside: Path) -> Answer:
    from cellwright.engine.formats.report.devices import listed, listing
    from cellwright.kb.loader.uses import all_devices

    found = all_devices(beside)
    return Answer("ok", {"devices": [listed(each) for each in found]}, lambda: listing(found))


def _show(name: str, beside: Path) -> Answer:
    from cellwright.engine.formats.report.devices import listed, page
    from cellwright.kb.loader.uses import device_called

    found = device_called(name, beside)
    return Answer("ok", listed(found), lambda: page(found))
