"""What else works on this machine: how much, and precedence over it for what is measured
(Linux, with the right to give it).
"""

import os
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path


def busy_s() -> float:
    """Seconds that all processors of this machine have worked since it began."""
    with open("/proc/stat") as file:
        user, nice, system, *_ = (int(each) for each in file.readline().split()[1:])
    return (user + nice + system) / os.sysconf("SC_CLK_TCK")


def come_first(parents: Iterable[int]) -> None:
    """Let the children of some processes come before all other work, each as soon as it has
    something to do.
    """
    for parent in parents:
        for child in children(parent):
            with suppress(ProcessLookupError):
                os.sched_setscheduler(child, os.SCHED_RR, os.sched_param(1))


def children(parent: int) -> Iterator[int]:
    """The processes that a process has started and that run."""
    for each in Path("/proc").glob("[0-9]*"):
        with suppress(OSError, ValueError, IndexError):
            if int((each / "stat").read_text().rpartition(")")[2].split()[1]) == parent:
                yield int(each.name)
