"""The end of the process, without the usual clean-up: that takes longer than parsing a small task."""

import os
import sys
import threading

from engine.faces.cli.watchdog import NAME

ENDED_PROPERLY = ("concurrent.futures", "multiprocessing", "sqlite3", "sqlalchemy")
"""Modules that close something at the end of the interpreter: processes, threads, databases."""


def leave(code: int) -> None:
    """Write the streams and end the process at once. Return only if something must still be closed."""
    if _left_to_close() and not _is_grounding():
        return
    try:
        sys.stdout.flush()
        sys.stderr.flush()
    except OSError:
        return
    os._exit(code)


def _is_grounding() -> bool:
    """Whether a grounding that was given up still runs: only the end of the process ends it."""
    bounded = sys.modules.get("kb.asp.bounded")
    return bounded is not None and bool(bounded.is_left_behind())


def _left_to_close() -> bool:
    """Whether threads run, modules must close what they opened, or a profiler or tracer must report."""
    watched = sys.getprofile() is not None or sys.gettrace() is not None
    others = [each for each in threading.enumerate()[1:] if each.name != NAME]
    return watched or bool(others) or any(name in sys.modules for name in ENDED_PROPERLY)
