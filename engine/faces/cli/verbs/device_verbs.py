"""The verbs `devices`: the devices that cells are put together from."""

from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from cellwright.engine.faces.cli.options.shared_options import Format
from cellwright.engine.faces.cli.output.answer_output import AnswerForm, VerbAnswer, give_answer
from cellwright.engine.formats import report
from cellwright.kb import loader

Beside = Annotated[
    Path,
    Option(
        "--beside", help="a domain folder: also its own device_group, in its folder `device_group`"
    ),
]

app = typer.Typer(add_completion=False, no_args_is_help=True)


@app.callback()
def device_group() -> None:
    """Look at the devices that a domain can use."""


@app.command("list")
def list_devices(beside: Beside = Path(), format: Format = AnswerForm.TEXT) -> None:
    """List the devices that come with the engine, and those beside a domain."""
    give_answer(lambda: _list_devices(beside), format)


@app.command()
def show(
    name: Annotated[str, Argument(help="the name of a device")],
    beside: Beside = Path(),
    format: Format = AnswerForm.TEXT,
) -> None:
    """Print what a device is, its parameters, ports, own names and commands, and how a domain
    uses it.
    """
    give_answer(lambda: _show_device(name, beside), format)


def _list_devices(beside: Path) -> VerbAnswer:
    known_devices = loader.all_devices(beside)
    return VerbAnswer(
        "ok",
        {"devices": [report.device_entry(device) for device in known_devices]},
        lambda: report.device_table(known_devices),
    )


def _show_device(name: str, beside: Path) -> VerbAnswer:
    device = loader.device_called(name, beside)
    return VerbAnswer("ok", report.device_entry(device), lambda: report.device_page(device))
