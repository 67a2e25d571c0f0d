"""Processes of this machine that carry units out. They end when they are told to, and with their parent."""

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

from cellwright.engine.pipelines.units.guard import limited_memory, share
from cellwright.engine.pipelines.units.parents import end_with_parent
from cellwright.engine.pipelines.units.work import Kind, Unit, one
from cellwright.kb.cycles import search_seldom

ENDING = 0.5  # seconds that processes may take to end their searches
SAFE_PATH = "PYTHONSAFEPATH"  # Python's own variable
SERVER = "cellwright.engine.pipelines.units.server"  # what the process loads first that forks the others
FORKED = multiprocessing.get_context("forkserver")


def loading(modules: Sequence[str]) -> None:
    """Begin to load modules that units need, while this process goes on; all processes of later pools have them at once."""
    forkserver.set_forkserver_preload([SERVER, *modules])
    resource_tracker.ensure_running()  # its start would end the deafness of what is started after it
    with _deaf(), _apart():
        forkserver.ensure_running()


@contextlib.contextmanager
def pool(processes: int) -> "Iterator[Pool]":
    """A pool of processes. A second Ctrl-C kills them."""
    hands = Pool(processes)
    try:
        yield hands
        hands.close()
    except BaseException:
        hands.kill()
        raise


class Pool:
    """Processes, forked from a server without threads, so that none inherits a connection or a lock. See `Hands`."""

    deaths: tuple[type[BaseException], ...] = (BrokenExecutor,)
    patience = 3

    def __init__(self, processes: int) -> None:
        loading(())  # nothing more, if the server runs already
        self._processes = processes
        self._stop = FORKED.Event()
        self._pool = self._made()

    def _made(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(self._processes, FORKED, _listen, (self._stop, share(self._processes)))

    @property
    def width(self) -> int:
        """One more than there are processes, so that none waits."""
        return self._processes + 1

    def give(self, kind: Kind[Any, Any], unit: Unit[Any]) -> Future[Any]:
        """See `Hands`."""
        with _deaf(), _apart():
            return self._pool.submit(_one, kind, unit)

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
        wait(running, timeout=ENDING)
        if any(not each.done() for each in running):
            self.kill()

    def close(self) -> None:
        """Wait until all processes have ended."""
        self._pool.shutdown(wait=True, cancel_futures=True)

    def kill(self) -> None:
        """End all processes at once."""
        for process in multiprocessing.active_children():
            process.kill()


@contextlib.contextmanager
def _deaf() -> Iterator[None]:
    """Processes that are started inside this context ignore Ctrl-C, which a terminal sends to them, too.

    The parent process handles Ctrl-C and tells them to stop.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    # what comes meanwhile is heard afterwards; an alarm would reach processes that are half started, and they would complain
    held = {signal.SIGINT, signal.SIGALRM}
    signal.pthread_sigmask(signal.SIG_BLOCK, held)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, held)


@contextlib.contextmanager
def _apart() -> Iterator[None]:
    """Python that is started inside this context does not look for modules in the present folder, which may have our names."""
    before = os.environ.get(SAFE_PATH)
    os.environ[SAFE_PATH] = "1"
    try:
        yield
    finally:
        os.environ.pop(SAFE_PATH)
        os.environ.update({} if before is None else {SAFE_PATH: before})


_STOPS: list[Event] = []  # in a process of the pool: the event that tells it to stop


def _listen(stop: Event, megabytes: int) -> None:
    """In a process of the pool: stop its searches and its grounding when `stop` is set, and end with its parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the server may have been started where Ctrl-C was heard
    end_with_parent()
    search_seldom()
    _STOPS.append(stop)
    limited_memory(megabytes)


def _stopped() -> bool:
    return any(each.is_set() for each in _STOPS)


def _one(kind: Kind[Any, Any], unit: Unit[Any]) -> Any:
    return one(kind, unit, _stopped)
