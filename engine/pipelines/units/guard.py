"""The memory that one worker may take: a unit that needs more ends with a `MemoryError`, and the machine goes on."""

import os

LEAST = 1024  # megabytes: below that not even the libraries fit


def share(processes: int) -> int:
    """The megabytes of this machine's memory that each of so many processes may take."""
    try:
        whole = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2**20
    except (ValueError, OSError):
        return 0
    return max(LEAST, whole // max(1, processes))


def limited_memory(megabytes: int) -> None:
    """Limit the memory of this process, unless it has a lower limit already; 0 is no limit."""
    if not megabytes:
        return
    import resource

    soft, most = resource.getrlimit(resource.RLIMIT_DATA)
    wanted = megabytes * 2**20
    if soft < 0 or wanted < soft:
        resource.setrlimit(resource.RLIMIT_DATA, (wanted if most < 0 else min(wanted, most), most))
