"""The end of the process, without the usual clean-up: that takes longer than parsing a small task."""

import atexit
import os
import sys
import threading
from contextlib import suppress
from typing import TextIO

from cellwright.engine.faces.cli.exits import INTERRUPTED, LIMIT
from cellwright.engine.faces.cli.watchdog import NAME


def leave(code: int) -> None:
    """Write the streams and end the process at once. Return only if threads still run that nobody gave up.

    What a limit or Ctrl-C ended may have left a solver at work: its threads are not waited for. The usual end would even abort
    the process if it came upon them.
    """
    _flush()
    if not _is_busy() or _is_grounding() or code in (LIMIT, INTERRUPTED):
        _close()
        _flush()
        os._exit(code)


def _flush() -> None:
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            abandon(stream)


def abandon(stream: TextIO) -> None:
    """Give up a stream that cannot be written any more. So closing it causes no message and no other exit code."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _is_grounding() -> bool:
    """Whether a grounding that was given up still runs: only the end of the process ends it."""
    bounded = sys.modules.get("cellwright.kb.asp.bounded")
    return bounded is not None and bool(bounded.is_left_behind())


def _is_busy() -> bool:
    """Whether threads run, or a profiler or tracer must report: then the interpreter ends as it does by itself."""
    watched = sys.getprofile() is not None or sys.gettrace() is not None
    return watched or any(each.name != NAME for each in threading.enumerate()[1:])


def _close() -> None:
    """Close databases, end processes, delete temporary folders: all that must not be left as it is."""
    engines = sys.modules.get("cellwright.kb.store.engines")
    with suppress(Exception):
        if engines is not None:
            engines.close_all()
        atexit._run_exitfuncs()
