"""Batches in stretches, a thread for each core: the kernels leave the interpreter free while they run."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

STRETCH = 1024  # rows whose carrier poses are held at a time


def cores() -> int:
    """How many cores this program may use; CELLWRIGHT_THREADS lowers it."""
    given = os.environ.get("CELLWRIGHT_THREADS", "")
    allowed = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, min(allowed, int(given))) if given.isdigit() else allowed


def in_stretches(count: int, work: Callable[[int, int], None]) -> None:
    """Call `work(first, after)` for stretches of `count` rows; each writes to its own rows, so that their order means nothing."""
    if count <= STRETCH:
        work(0, count)
        return
    stretches = [(first, min(first + STRETCH, count)) for first in range(0, count, STRETCH)]
    threads = min(len(stretches), cores())
    if threads < 2:
        for first, after in stretches:
            work(first, after)
        return
    with ThreadPoolExecutor(threads) as pool:
        for done in [pool.submit(work, first, after) for first, after in stretches]:
            done.result()
