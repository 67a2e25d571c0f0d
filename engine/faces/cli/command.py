"""All verbs as one command line, and the function that runs it until the exit code."""

import gc

import typer

from engine.faces.cli.answers import open_streams
from engine.faces.cli.ending import leave
from engine.faces.cli.verbs import Verbs

app = typer.Typer(
    name="cellwright", cls=Verbs, no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False
)


@app.callback()
def cellwright() -> None:
    """Plan and diagnose for robot work cells."""


def run() -> None:
    """Run the command line."""
    gc.set_threshold(100_000)  # rarely: few objects here refer to each other in circles
    open_streams()
    try:
        app()
    except SystemExit as end:
        if isinstance(end.code, int):
            leave(end.code)
        raise
