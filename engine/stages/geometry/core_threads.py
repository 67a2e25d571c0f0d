"""Runs work on batches in stretches of rows, with a thread for each core.

This helps because the kernels release Python's lock.
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from cellwright.kb.numbers import is_count

STRETCH_ROWS = 1024  # rows whose carrier poses are in memory at a time


def usable_cores() -> int:
    """How many cores this program may use. CELLWRIGHT_THREADS lowers the number."""
    setting = os.environ.get("CELLWRIGHT_THREADS", "")
    allowed = (
        len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    )
    return max(1, min(allowed, int(setting))) if is_count(setting) else allowed


def run_in_stretches(count: int, work: Callable[[int, int], None]) -> None:
    """Calls `work(first, after)` for stretches of `count` rows.

    Each call writes only to its own rows, so their order does not matter.
    """
    if count <= STRETCH_ROWS:
        work(0, count)
        return
    stretches = [
        (first, min(first + STRETCH_ROWS, count)) for first in range(0, count, STRETCH_ROWS)
    ]
    threads = min(len(stretches), usable_cores())
    if threads < 2:
        for first, after in stretches:
            work(first, after)
        return
    with ThreadPoolExecutor(threads) as pool:
        for done in [pool.submit(work, first, after) for first, after in stretches]:
            done.result()
