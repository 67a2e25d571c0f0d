"""The function that runs the command line until the exit code."""

import sys

from cellwright.engine.faces.cli.answers import open_streams, writing
from cellwright.engine.faces.cli.declared import is_misfit
from cellwright.engine.faces.cli.ending import leave
from cellwright.engine.faces.cli.exits import LIMIT
from cellwright.engine.faces.cli.kept_code import KeptCode
from cellwright.engine.faces.cli.memory import lift_limit
from cellwright.engine.faces.cli.plain_lines import plain_call
from cellwright.engine.faces.cli.watchdog import own_process


def run(code: KeptCode | None = None) -> None:
    """Run the command line. What was compiled is kept for the next one."""
    own_process()
    open_streams()
    try:
        _run(sys.argv[1:])
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


def _run(words: list[str]) -> None:
    """A plain line is read and run without typer. If its words turn out not to fit, typer reads them and tells so."""
    if call := plain_call(words):
        try:
            with writing():
                call()
                sys.exit(0)
        except Exception as error:
            if not is_misfit(error):
                raise
    from cellwright.engine.faces.cli.application import app

    app()
