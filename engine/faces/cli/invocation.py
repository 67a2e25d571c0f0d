"""One invocation of the command line, from its words to the exit code."""

import sys

from cellwright.engine.faces.cli.bytecode_cache import KeptCode
from cellwright.engine.faces.cli.option_declarations import is_misfit
from cellwright.engine.faces.cli.output.answer_output import (
    leave_process,
    open_streams,
    writing_output,
)
from cellwright.engine.faces.cli.plain_line_parser import plain_call
from cellwright.engine.faces.cli.process.exit_codes import LIMIT
from cellwright.engine.faces.cli.process.process_limits import lift_limit, own_process


def run_command_line(code: KeptCode | None = None) -> None:
    """Run the command line. What was compiled is kept for the next one."""
    own_process()
    open_streams()
    try:
        _run_words(sys.argv[1:])
    except MemoryError:  # before the work began, or while the answer was printed
        lift_limit()
        sys.stderr.write(
            "memory: error K419: out of memory\n  try: raise --memory-limit, or make the "
            "problem smaller\n"
        )
        leave_process(LIMIT)
        raise
    except SystemExit as end:
        if code:
            code.keep()
        if isinstance(end.code, int):
            leave_process(end.code)
        raise


def _run_words(words: list[str]) -> None:
    """A plain line is read and run without typer.

    If its words turn out not to fit, typer reads them and tells so.
    """
    if call := plain_call(words):
        try:
            with writing_output():
                call()
                sys.exit(0)
        except Exception as error:
            if not is_misfit(error):
                raise
    from cellwright.engine.faces.cli.typer_application import app

    app()
