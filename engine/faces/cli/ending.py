"""The end of the process, without the usual clean-up: that takes longer than parsing a small task."""

import os
import sys
import threading
from typing import TextIO

from engine.faces.cli.watchdog import NAME

ENDED_PROPERLY = ("concurrent.futures", "multiprocessing", "sqlite3", "sqlalchemy")
"""Modules that close something at the end of the interpreter: processes, threads, databases."""


def leave(code: int) -> None:
    """Write the streams and end the process at once. Return only if something must still be closed."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            abandon(stream)
    if not _left_to_close() or _is_grounding():
        os._exit(code)


def abandon(stream: TextIO) -> None:
    """Give up a stream that cannot be written any more. So closing it causes no message and no other exit code."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _is_grounding() -> bool:
    """Whether a grounding that was given up still runs: only the end of the process ends it."""
    bounded = sys.modules.get("kb.asp.bounded")
    return bounded is not None and bool(bounded.is_left_behind())


def _left_to_close() -> bool:
    """Whether threads run, modules must close what they opened, or a profiler or tracer must report."""
    watched = sys.getprofile() is not None or sys.gettrace() is not None
    others = [each for each in threading.enumerate()[1:] if each.name != NAME]
    return watched or bool(others) or any(name in sys.modules for name in ENDED_PROPERLY)
