"""Forks and other processes of a mutation run: what came of them, and the limits that each of
them has.
"""

import contextlib
import math
import os
import resource
import signal
import time
from collections.abc import Callable
from pathlib import Path

MEMORY = 12 << 30  # bytes of address space for one run
BEGIN_S, IMPORT_S = 10, 60  # processor time beside that of the tests: of a fork, of a new process
SLACK = 3  # times the usual cost of the tests
PATIENCE = 20  # times the limit of processor time, until a run ends that waits for something
LOOK_S = 0.01  # between two looks whether a run has ended
SAID = "said.txt"  # what the last run printed
Became = tuple[str, float]  # survived, killed or timeout; the processor time of its run


def fork(run: Callable[[], None]) -> int:
    """The process that does this, and ends."""
    child = os.fork()
    if child:
        return child
    code = 1
    try:
        os.setsid()
        limit_memory()
        run()
        code = 0
    except BaseException as error:  # a fork may not go on with what its parent does
        say(f"{type(error).__name__}: {error}\n")
    os._exit(code)


def waited(child: int, patience: float) -> Became:
    """What came of a run, and its processor time; what it leaves behind ends with it."""
    ended, status = 0, 0
    # not the clock: we may be stopped
    looks = math.inf if patience == math.inf else round(patience / LOOK_S)
    try:
        while not ended and looks:
            ended, status, used = os.wait4(child, os.WNOHANG)
            looks -= 1
            time.sleep(0 if ended else LOOK_S)
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)
    if not ended:
        _, status, used = os.wait4(child, 0)
    endless = not ended or (os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGXCPU)
    return (
        "timeout" if endless else "killed" if status else "survived",
        used.ru_utime + used.ru_stime,
    )


def patience_s(usual_s: float) -> float:
    """How long to wait for a run that usually takes so much of the processor."""
    return PATIENCE * (BEGIN_S + SLACK * usual_s)


def limit_memory() -> None:
    """No process takes all of the memory."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))


def say(text: str) -> None:
    """Add to what the run has printed."""
    with Path(SAID).open("a") as said:
        said.write(text)
