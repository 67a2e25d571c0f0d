"""Settings of Python's garbage collector: searches for reference cycles are rare, and none while
many values are made.
"""

import gc
from collections.abc import Iterator
from contextlib import contextmanager

COLLECTION_THRESHOLD = 100_000  # new objects between two searches; Python itself has 700


@contextmanager
def no_search_for_cycles() -> Iterator[None]:
    """A context in which Python does not look for cycles of references.

    For work that makes very many values, none of them part of a cycle: the search would take a
    third more time.
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def search_now() -> None:
    """Let Python look for cycles among what was made lately. What stays is old from then on, and
    looked at no more in passing.

    For the end of work that makes many values that stay: else whoever comes next waits for that
    search.
    """
    if gc.isenabled():
        gc.collect(1)


def search_seldom() -> None:
    """From now on Python looks for cycles rarely: few objects here refer to each other in circles.

    For a process that is ours alone. What it has loaded so far stays, and is looked at no more.
    """
    gc.freeze()
    gc.set_threshold(COLLECTION_THRESHOLD)


@contextmanager
def seldom_searched() -> Iterator[None]:
    """A context in which Python looks for cycles as rarely as in a process of ours.

    For work inside other programs.
    """
    before = gc.get_threshold()
    gc.set_threshold(COLLECTION_THRESHOLD)
    try:
        yield
    finally:
        gc.set_threshold(*before)
