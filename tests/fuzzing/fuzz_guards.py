"""Runs cases in a forked process that has budgets of processor time and memory, so that one bad
case ends nothing else.
"""

import contextlib
import mmap
import os
import resource
import signal
import struct
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

SECONDS = 20.0  # of the processor, for one case
MEGABYTES = 2000  # for one process
LOOK = 0.2  # seconds between two looks


@dataclass
class Tally:
    """What became of the cases of a reader; `failures` are the numbers of the bad ones with
    what happened.
    """

    cases: int = 0
    refused: int = 0
    accepted: int = 0
    slowest_s: float = 0.0
    largest_mb: float = 0.0
    failures: dict[int, str] = field(default_factory=dict)

    def add(self, other: "Tally") -> None:
        """Count what another tally counted, too."""
        self.cases += other.cases
        self.refused += other.refused
        self.accepted += other.accepted
        self.slowest_s = max(self.slowest_s, other.slowest_s)
        self.largest_mb = max(self.largest_mb, other.largest_mb)
        self.failures |= other.failures


# number, refused, accepted, slowest, processor time at the begin of the case
_FORM = struct.Struct("<qqqdd")


def batch(numbers: Sequence[int], case: Callable[[int], bool]) -> Tally:
    """Run cases one after the other; `case` says whether its input was accepted, and raises what
    went wrong.

    The process is begun anew behind a case that takes more than its budgets, or kills it.
    """
    found, left = Tally(), list(numbers)
    while left:
        tried, tally = _attempt(left, case)
        found.add(tally)
        left = left[tried:]
    return found


def _attempt(numbers: Sequence[int], case: Callable[[int], bool]) -> tuple[int, Tally]:
    """One process; returns how many of the cases it tried, and the tally."""
    with mmap.mmap(-1, 1 << 16) as shared:
        sys.stdout.flush()
        child = os.fork()
        if child == 0:
            _work(numbers, case, shared)
        status, usage, killed = _await(child, shared)
        at, refused, accepted, slowest, began = _FORM.unpack_from(shared)
        size = struct.unpack_from("<q", shared, 64)[0]
        said = bytes(shared[72 : 72 + size]).decode("utf-8", "replace") if size else ""
    tally = Tally(0, refused, accepted, slowest, usage.ru_maxrss / 1024)
    tally.failures = {
        int(n): what for n, _, what in (line.partition("\t") for line in said.split("\n") if line)
    }
    tried = at if os.waitstatus_to_exitcode(status) == 0 else at + 1
    if tried > at:
        spent = usage.ru_utime + usage.ru_stime - began
        tally.slowest_s = max(slowest, spent)
        how = f"took more than {SECONDS:g} s" if killed else f"ended the process: {status}"
        tally.failures[numbers[at]] = how
    if tally.largest_mb > MEGABYTES:
        tally.failures.setdefault(
            numbers[max(at - 1, 0)], f"{tally.largest_mb:.0f} MB in this batch"
        )
    tally.cases = tried
    return tried, tally


def _await(child: int, shared: mmap.mmap) -> tuple[int, resource.struct_rusage, bool]:
    killed = False
    while True:
        found, status, usage = os.wait4(child, os.WNOHANG)
        if found:
            return status, usage, killed
        began = _FORM.unpack_from(shared)[4]
        if began and _processor_s(child) - began > SECONDS:
            os.kill(child, signal.SIGKILL)
            killed = True
        time.sleep(LOOK if began else 0.01)


def _processor_s(process: int) -> float:
    with (
        contextlib.suppress(OSError, IndexError),
        open(f"/proc/{process}/stat", encoding="ascii") as file,
    ):
        parts = file.read().rpartition(")")[2].split()
        return (int(parts[11]) + int(parts[12])) / os.sysconf("SC_CLK_TCK")
    return 0.0


def _work(numbers: Sequence[int], case: Callable[[int], bool], shared: mmap.mmap) -> None:
    silence = os.open(os.devnull, os.O_RDWR)
    for each in (0, 1, 2):
        os.dup2(silence, each)
    limit = 2 * MEGABYTES * 2**20
    resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    refused = accepted = 0
    slowest, said = 0.0, ""
    for at, number in enumerate(numbers):
        began = time.process_time()
        _FORM.pack_into(shared, 0, at, refused, accepted, slowest, began)
        try:
            if case(number):
                accepted += 1
            else:
                refused += 1
        except BaseException as error:
            said += f"{number}\t{_told(error)}\n"
            data = said.encode("utf-8", "replace")[: (1 << 16) - 80]
            struct.pack_into("<q", shared, 64, len(data))
            shared[72 : 72 + len(data)] = data
        slowest = max(slowest, time.process_time() - began)
    _FORM.pack_into(shared, 0, len(numbers), refused, accepted, slowest, 0.0)
    os._exit(0)


def _told(error: BaseException) -> str:
    """The exception in one line, with the place that raised it."""
    trace, places = error.__traceback__, list[str]()
    while trace is not None:
        code = trace.tb_frame.f_code
        if "/fuzzing/" not in code.co_filename:
            places.append(f"{os.path.basename(code.co_filename)}:{trace.tb_lineno}")
        trace = trace.tb_next
    text = " ".join(f"{type(error).__name__}: {error}".split())[:600]
    return f"{text} [{' '.join(places[-3:])}]"
