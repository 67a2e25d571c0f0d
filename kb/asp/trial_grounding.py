"""Trial grounding in another process: whether a program can be grounded within limits."""

import atexit
import os
import resource
import time
from multiprocessing.connection import Connection

from cellwright.kb import stopping
from cellwright.kb.asp import AspError, Grounder
from cellwright.kb.clean_process import CleanProcess

MAX_TRIAL_S = 10  # of processor time
MAX_TRIAL_CLOCK_S = 120.0  # on the clock, for a process that waits or gets little of a processor
MAX_TRIAL_MB = 2000
MAX_IDLE_MB = 300  # a process that keeps more than this is not kept
PAGE_BYTES = resource.getpagesize()
TRIAL_POLL_S = 0.01  # seconds between two looks whether it has answered

_idle: list[CleanProcess] = []


def can_be_grounded(text: str) -> bool:
    """Whether clingo grounds `text` within `MAX_TRIAL_S` of processor time and `MAX_TRIAL_MB` of
    additional memory, or within what the command may still take.

    clingo cannot be interrupted while it grounds, so another process grounds under limits of the
    operating system, and is kept for the next question. A text with errors counts as affordable,
    because the real grounding reports the errors. Raises `cellwright.kb.stopping.StoppedByCaller`.
    """
    megabytes = int(min(MAX_TRIAL_MB, stopping.megabytes_left()))
    process = _take_process()
    try:
        process.connection.send((text, MAX_TRIAL_S, megabytes))
        answer = _await_answer(process, _resident_megabytes(process.pid) + megabytes)
    except (EOFError, OSError):  # the limits have ended it
        answer = None
    except BaseException:  # it must not go on after an interrupt
        process.kill()
        raise
    if answer is None or _resident_megabytes(process.pid) > MAX_IDLE_MB:
        process.kill()
    else:
        _idle.append(process)
    return bool(answer)


def answer_trials(connection: Connection) -> None:
    """In the other process: answer each question until the parent process has no more."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, resource.getrlimit(resource.RLIMIT_CORE)[1]))
    while True:
        text, seconds, megabytes = connection.recv()
        used = resource.getrusage(resource.RUSAGE_SELF)
        _set_soft_limit(resource.RLIMIT_CPU, int(used.ru_utime + used.ru_stime) + seconds)
        _set_soft_limit(resource.RLIMIT_AS, _address_space() + megabytes * 2**20)
        connection.send(_can_be_grounded_here(text))


def _take_process() -> CleanProcess:
    while True:
        try:
            process = _idle.pop()
        except IndexError:
            return CleanProcess(answer_trials, quiet=True)
        if not process.connection.closed and not process.connection.poll():
            return process
        process.kill()  # it has ended meanwhile


def _await_answer(process: CleanProcess, most_megabytes: float) -> bool | None:
    """What the process answers; None if it took too long or more memory than it may.

    Raises `EOFError` if it has ended.
    """
    end = time.monotonic() + MAX_TRIAL_CLOCK_S
    while not process.connection.poll(TRIAL_POLL_S):
        if stopping.is_stop_wanted():
            raise stopping.StoppedByCaller
        if time.monotonic() > end or _resident_megabytes(process.pid) > most_megabytes:
            return None
    return bool(process.connection.recv())


def _can_be_grounded_here(text: str) -> bool:
    """Whether this process grounds a text. The limits of the operating system may end it."""
    try:
        Grounder().ground(text)
    except AspError as error:
        return "bad_alloc" not in str(error)
    except MemoryError:
        return False
    return True


def _set_soft_limit(kind: int, amount: int) -> None:
    hard = resource.getrlimit(kind)[1]
    if hard != resource.RLIM_INFINITY:
        amount = min(amount, hard)
    resource.setrlimit(kind, (amount, hard))


def _address_space() -> int:
    """Bytes of address space in use; 0 if the system does not report them."""
    return _read_statm("self")[0] * PAGE_BYTES


def _resident_megabytes(process: int) -> float:
    """How much of a process is in memory; 0 if the system does not report it."""
    return _read_statm(str(process))[1] * PAGE_BYTES / 2**20


def _read_statm(process: str) -> list[int]:
    """Pages of a process: in its address space, in memory, and others."""
    try:
        with open(f"/proc/{process}/statm", encoding="ascii") as file:
            return [int(field) for field in file.read().split()]
    except OSError:
        return [0, 0]


def _end_idle() -> None:
    while _idle:
        _idle.pop().kill()


atexit.register(_end_idle)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_idle.clear)  # they are the parent's
