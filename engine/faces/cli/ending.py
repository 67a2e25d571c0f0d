"""The end of the process, without the usual clean-up: that takes longer than parsing a small task."""

import os
import sys
import threading

ENDED_PROPERLY = ("concurrent.futures", "multiprocessing", "sqlite3", "sqlalchemy")
"""Modules that close something at the end of the interpreter: processes, threads, databases."""


def leave(code: int) -> None:
    """Write the streams and end the process at once. Return only if something must still be closed."""
    if _left_to_close():
        return
    try:
        sys.stdout.flush()
        sys.stderr.flush()
    except OSError:
        return
    os._exit(code)


def _left_to_close() -> bool:
    """Whether threads run, modules must close what they opened, or a profiler or tracer must report."""
    watched = sys.getprofile() is not None or sys.gettrace() is not None
    return watched or threading.active_count() > 1 or any(name in sys.modules for name in ENDED_PROPERLY)
