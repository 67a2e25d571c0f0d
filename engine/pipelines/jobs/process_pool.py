"""Pool of processes of this machine, their memory limit, and their end with the command."""

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor, wait
from multiprocessing import forkserver, resource_tracker
from multiprocessing.synchronize import Event
from typing import Any

from cellwright.engine.pipelines.jobs.parent_exit import end_with_parent
from cellwright.engine.pipelines.jobs.work_units import WorkKind, WorkUnit, carry_out_unit
from cellwright.kb.garbage_collection import search_seldom

MIN_WORKER_MB = 1024  # megabytes: below that not even the libraries fit


def memory_share(processes: int) -> int:
    """The megabytes of this machine's memory that each of so many processes may take."""
    try:
        whole = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2**20
    except (ValueError, OSError):
        return 0
    return max(MIN_WORKER_MB, whole // max(1, processes))


def limited_memory(megabytes: int) -> None:
    """Limit the memory of this process, unless it has a lower limit already; 0 is no limit."""
    if not megabytes:
        return
    import resource

    soft, most = resource.getrlimit(resource.RLIMIT_DATA)
    limit = megabytes * 2**20
    if soft < 0 or limit < soft:
        resource.setrlimit(resource.RLIMIT_DATA, (limit if most < 0 else min(limit, most), most))


ENDING_GRACE_S = 0.5  # seconds that processes may take to end their searches
SAFE_PATH = "PYTHONSAFEPATH"  # Python's own variable
# what the process loads first that forks the others
FORKSERVER_MODULE = "cellwright.engine.pipelines.jobs.forkserver_preload"
FORKSERVER_CONTEXT = multiprocessing.get_context("forkserver")


def begin_loading(modules: Sequence[str]) -> None:
    """Begin to load modules that units need, while this process goes on; all processes of later
    pools have them at once.
    """
    forkserver.set_forkserver_preload([FORKSERVER_MODULE, *modules])
    # its start would end the deafness of what is started after it
    resource_tracker.ensure_running()
    with _ignoring_interrupts(), _without_own_folder():
        forkserver.ensure_running()


@contextlib.contextmanager
def open_pool(processes: int) -> "Iterator[ProcessPool]":
    """A pool of processes. A second Ctrl-C kills them."""
    hands = ProcessPool(processes)
    try:
        yield hands
        hands.close()
    except BaseException:
        hands.kill()
        raise


class ProcessPool:
    """Processes, forked from a server without threads, so that none inherits a connection or a
    lock. See `Hands`.
    """

    deaths: tuple[type[BaseException], ...] = (BrokenExecutor,)
    patience = 3

    def __init__(self, processes: int) -> None:
        begin_loading(())  # nothing more, if the server runs already
        self._processes = processes
        self._stop = FORKSERVER_CONTEXT.Event()
        self._pool = self._made()

    def _made(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(
            self._processes,
            FORKSERVER_CONTEXT,
            _begin_worker,
            (self._stop, memory_share(self._processes)),
        )

    @property
    def width(self) -> int:
        """One more than there are processes, so that none waits."""
        return self._processes + 1

    def give(self, kind: WorkKind[Any, Any], unit: WorkUnit[Any]) -> Future[Any]:
        """See `Hands`."""
        with _ignoring_interrupts(), _without_own_folder():
            return self._pool.submit(_carry_out_unit, kind, unit)

    def renew(self) -> None:
        """A new pool in the place of one that is broken."""
        if getattr(self._pool, "_broken", False):
            self._pool.shutdown(wait=False, cancel_futures=True)
            self._pool = self._made()

    def gone(self) -> str:
        """A pool can always be made anew."""
        return ""

    def stop(self, running: Sequence[Future[Any]]) -> None:
        """Have the searches end; kill those that do not."""
        self._stop.set()
        wait(running, timeout=ENDING_GRACE_S)
        if any(not future.done() for future in running):
            self.kill()

    def close(self) -> None:
        """Wait until all processes have ended."""
        self._pool.shutdown(wait=True, cancel_futures=True)

    def kill(self) -> None:
        """End all processes at once."""
        for process in multiprocessing.active_children():
            process.kill()


@contextlib.contextmanager
def _ignoring_interrupts() -> Iterator[None]:
    """Processes that are started inside this context ignore Ctrl-C, which a terminal sends to them,
    too.

    The parent process handles Ctrl-C and tells them to stop.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    # what comes meanwhile is heard afterwards; an alarm would reach processes that are half
    # started, and they would complain
    signals = {signal.SIGINT, signal.SIGALRM}
    signal.pthread_sigmask(signal.SIG_BLOCK, signals)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, signals)


@contextlib.contextmanager
def _without_own_folder() -> Iterator[None]:
    """Python that is started inside this context does not look for modules in the present
    folder, which may have our names.
    """
    before = os.environ.get(SAFE_PATH)
    os.environ[SAFE_PATH] = "1"
    try:
        yield
    finally:
        os.environ.pop(SAFE_PATH)
        os.environ.update({} if before is None else {SAFE_PATH: before})


_STOP_EVENTS: list[Event] = []  # in a process of the pool: the event that tells it to stop


def _begin_worker(stop: Event, megabytes: int) -> None:
    """In a process of the pool: stop its searches and its grounding when `stop` is set, and end
    with its parent.
    """
    # the server may have been started where Ctrl-C was heard
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()
    search_seldom()
    _STOP_EVENTS.append(stop)
    limited_memory(megabytes)


def _is_stopped() -> bool:
    return any(event.is_set() for event in _STOP_EVENTS)


def _carry_out_unit(kind: WorkKind[Any, Any], unit: WorkUnit[Any]) -> Any:
    return carry_out_unit(kind, unit, _is_stopped)
