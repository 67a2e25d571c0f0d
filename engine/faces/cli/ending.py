"""The end of the process. Taking the interpreter apart, object by object, takes longer than parsing a small task."""

import os
import sys
import threading

ENDED_PROPERLY = ("concurrent.futures", "multiprocessing", "sqlite3", "sqlalchemy")
"""Modules that close something when the interpreter ends: processes, threads, databases."""


def leave(code: int) -> None:
    """End the process at once, its streams written; come back if something is left to close."""
    if _left_to_close():
        return
    try:
        sys.stdout.flush()
        sys.stderr.flush()
    except OSError:
        return
    os._exit(code)


def _left_to_close() -> bool:
    """Whether threads run, modules want to close what they opened, or a profiler or tracer wants to report."""
    watched = sys.getprofile() is not None or sys.gettrace() is not None
    return watched or threading.active_count() > 1 or any(name in sys.modules for name in ENDED_PROPERLY)
