"""One invocation of the command line, from its words to the exit code."""

import sys

from cellwright.engine.faces.cli.output.answer_output import (
    leave_process,
    open_streams,
)
from cellwright.engine.faces.cli.process.exit_codes import LIMIT
from cellwright.engine.faces.cli.process.process_limits import lift_limit, own_process
from cellwright.engine.faces.cli.typer_application import app


def run_command_line() -> None:
    """Run the command line."""
    own_process()
    open_streams()
    try:
        app()
    except MemoryError:  # before the work began, or while the answer was printed
        lift_limit()
        sys.stderr.write(
            "memory: error K419: out of memory\n  try: raise --memory-limit, or make the "
            "problem smaller\n"
        )
        leave_process(LIMIT)
        raise
    except SystemExit as end:
        if isinstance(end.code, int):
            leave_process(end.code)
        raise
