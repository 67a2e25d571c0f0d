"""Grounding in a thread of its own, within limits of time and memory.

clingo listens to nobody while it grounds. So it grounds in a thread of its own, and the thread that
waits for it looks at the clock and at the memory, and asks whether to stop. A grounding that is
given up goes on in the background until it ends by itself or the process does: `is_left_behind`
tells the command line to end the process at once.
"""

import os
import threading
import time
from collections.abc import Callable

from cellwright.kb import stopping

MAX_GROUNDING_S = 15.0  # of processor time
MAX_GROUNDING_MB = 2000  # more than the process had before
GROUNDING_POLL_S = 0.02  # seconds between two looks

_left_behind: list[threading.Thread] = []


class GroundingTooLarge(Exception):
    """A grounding that took more than its time or its memory."""


def run_bounded(ground: Callable[[], None]) -> None:
    """Call `ground`, and raise what it raises.

    Raises `GroundingTooLarge`, `MemoryError` if the operating system gives it no more memory, and
    `cellwright.kb.stopping.StoppedByCaller`, also if whoever watches the memory of the whole
    process has raised a `MemoryError` meanwhile.
    """
    watch = _Grounding(ground)
    watch.start()
    try:
        _await_grounding(watch)
    except BaseException as error:
        if watch.is_alive():
            _left_behind.append(watch)
        if isinstance(
            error, MemoryError
        ):  # not of the grounding, but of the whole command: nothing more can be tried
            raise stopping.StoppedByCaller from None
        raise
    if watch.error is not None:
        raise MemoryError if "bad_alloc" in str(watch.error) else watch.error


def is_left_behind() -> bool:
    """Whether a grounding that was given up still runs."""
    return any(grounding.is_alive() for grounding in _left_behind)


class _Grounding(threading.Thread):
    """A thread that keeps what its function raised."""

    def __init__(self, ground: Callable[[], None]) -> None:
        super().__init__(daemon=True)
        self.ground = ground
        self.error: BaseException | None = None
        self.done = threading.Event()

    def run(self) -> None:
        try:
            self.ground()
        except BaseException as error:
            self.error = error
        finally:
            self.done.set()


def _await_grounding(watch: _Grounding) -> None:
    if watch.done.wait(GROUNDING_POLL_S):
        watch.join()
        return
    spent, size = (
        time.process_time() + MAX_GROUNDING_S,
        _resident_bytes() + MAX_GROUNDING_MB * 2**20,
    )
    while not watch.done.wait(GROUNDING_POLL_S):
        if stopping.is_stop_wanted():
            raise stopping.StoppedByCaller
        if time.process_time() > spent or _resident_bytes() > size:
            raise GroundingTooLarge
    watch.join()


def _resident_bytes() -> int:
    """Bytes of memory in use; 0 if the system does not report them."""
    try:
        with open("/proc/self/statm", encoding="ascii") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return 0
