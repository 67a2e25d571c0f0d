"""Trial grounding in a child process: whether a program can be grounded within limits."""

import os
import resource
import signal
import time

from cellwright.kb import stopping
from cellwright.kb.asp import AspError, Grounder

MAX_TRIAL_S = 10
MAX_TRIAL_MB = 2000
PAGE_BYTES = resource.getpagesize()  # bytes
TRIAL_POLL_S = 0.01  # seconds between two looks whether it has ended


def can_be_grounded(text: str) -> bool:
    """Whether clingo grounds `text` within `SECONDS` of processor time and `MEGABYTES` of
    additional memory, or within what the command may still take.

    clingo cannot be interrupted while it grounds, so a forked child process grounds under limits of
    the operating system. A text with errors counts as affordable, because the real grounding
    reports the errors. Raises `cellwright.kb.stopping.StoppedByCaller`.
    """
    megabytes = int(min(MAX_TRIAL_MB, stopping.megabytes_left()))
    child = os.fork()
    if child == 0:
        os._exit(_ground_in_child(text, MAX_TRIAL_S, megabytes))
    try:
        return (
            os.waitstatus_to_exitcode(
                _await_child(child, _resident_pages("self") + megabytes * 2**20 // PAGE_BYTES)
            )
            == 0
        )
    except BaseException:  # the child must not go on after an interrupt
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        raise


def _await_child(child: int, most: int) -> int:
    """The status of a child process, once it has ended.

    It is killed when it has more than so many pages in memory.
    """
    while True:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return status
        if stopping.is_stop_wanted():
            raise stopping.StoppedByCaller
        if _resident_pages(str(child)) > most:
            os.kill(child, signal.SIGKILL)
        time.sleep(TRIAL_POLL_S)


def _resident_pages(process: str) -> int:
    """How many pages of a process are in memory; 0 if the system does not report them."""
    return _read_statm(process)[1]


def _ground_in_child(text: str, seconds: int, megabytes: int) -> int:
    """In the child process: 0 if the text was grounded. If not, the limits end the process."""
    silence = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silence, 1)
    os.dup2(silence, 2)
    used = resource.getrusage(resource.RUSAGE_SELF)
    spent = int(used.ru_utime + used.ru_stime)
    memory = _address_space() + megabytes * 2**20
    resource.setrlimit(resource.RLIMIT_CPU, (spent + seconds, spent + seconds + 1))
    resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    try:
        Grounder().ground(text)
    except AspError as error:
        return 1 if "bad_alloc" in str(error) else 0
    except MemoryError:
        return 1
    return 0


def _address_space() -> int:
    """Bytes of address space in use; 0 if the system does not report them."""
    return _read_statm("self")[0] * PAGE_BYTES


def _read_statm(process: str) -> list[int]:
    """Pages of a process: in its address space, in memory, and others."""
    try:
        with open(f"/proc/{process}/statm", encoding="ascii") as file:
            return [int(field) for field in file.read().split()]
    except OSError:
        return [0, 0]
