"""All verbs as one command line, and the function that runs it until the exit code."""

import sys
from typing import Annotated

import typer

from engine.faces.cli.answers import open_streams
from engine.faces.cli.ending import leave
from engine.faces.cli.exits import LIMIT
from engine.faces.cli.kept_code import KeptCode
from engine.faces.cli.memory import lift_limit
from engine.faces.cli.verbs import Verbs
from engine.faces.cli.watchdog import own_process

app = typer.Typer(
    name="cellwright",
    cls=Verbs,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        typer.echo(f"cellwright {version('cellwright')}")
        raise typer.Exit


@app.callback()
def cellwright(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="print the version and exit")
    ] = False,
) -> None:
    """Plan and diagnose for robot work cells."""


def run(code: KeptCode | None = None) -> None:
    """Run the command line. What was compiled is kept for the next one."""
    own_process()
    open_streams()
    try:
        app()
    except MemoryError:  # before the work began, or while the answer was printed
        lift_limit()
        sys.stderr.write(
            "memory: error K419: out of memory\n  try: raise --memory-limit, or make the problem smaller\n"
        )
        leave(LIMIT)
        raise
    except SystemExit as end:
        if code:
            code.keep()
        if isinstance(end.code, int):
            leave(end.code)
        raise
