"""The memory that a command may take: what is resident is watched, and the system refuses what goes far beyond it.

The system counts what is reserved, not what is used. Linear algebra (OpenBLAS) reserves a lot, and where there is none it ends the
process or tries for ever. So the system's limit is higher by what such libraries reserve.
"""

import os
import sys

THREADS = "OPENBLAS_NUM_THREADS"  # each of them reserves as much again
RESERVED = 160  # megabytes that libraries may reserve and not use
SHORT = ("failed to map segment", "cannot allocate memory")
_PAGE = os.sysconf("SC_PAGE_SIZE") if hasattr(os, "sysconf") else 4096


def limit_memory(megabytes: int | None) -> None:
    """Have the system refuse what goes far beyond a limit, to this process and to those it starts; None is no limit."""
    if megabytes is not None:
        os.environ.setdefault(THREADS, "1")
        _limit(min((megabytes + RESERVED) * 2**20, sys.maxsize))


def lift_limit() -> None:
    """Let this process have what the system allows: what is left to do is to say that memory has run out."""
    import resource

    _limit(resource.getrlimit(resource.RLIMIT_DATA)[1])


def resident() -> float:
    """The megabytes that this process has in memory; 0 where the system does not tell."""
    try:
        with open("/proc/self/statm", "rb") as file:
            return int(file.read().split()[1]) * _PAGE / 2**20
    except (OSError, IndexError, ValueError):
        return 0.0


def is_short(error: BaseException) -> bool:
    """Whether an error says that there was no memory: also that of a library that could not be loaded for want of it."""
    said = str(error).lower()
    lacking = isinstance(error, ImportError) and any(each in said for each in SHORT)
    return lacking or isinstance(error, MemoryError)


def _limit(wanted: int) -> None:
    import resource

    _, most = resource.getrlimit(resource.RLIMIT_DATA)
    resource.setrlimit(resource.RLIMIT_DATA, (wanted if most < 0 or wanted < 0 else min(wanted, most), most))
