"""The processes that work through a set of problems at the same time. They end when they are told to, and with their parent."""

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from multiprocessing.synchronize import Event

from engine.kernels.cancellation import Interrupted
from engine.pipelines.preparation.problem import interrupted_before, work
from engine.pipelines.preparation.results import PreparationJob, Prepared
from kb import stopping

ENDING = 0.5  # seconds that processes may take to end their searches
SPAWN = multiprocessing.get_context("spawn")


def carried_out(
    jobs: Sequence[PreparationJob], processes: int, interrupted: Interrupted
) -> Generator[tuple[PreparationJob, Prepared], None, None]:
    """The jobs with their results, in the order in which they are finished.

    Processes are spawned, so that none inherits a connection or the lock of a thread.
    """
    if processes == 1:
        for job in jobs:
            yield job, work(job, interrupted)
        return
    stop = SPAWN.Event()
    with _pool(min(processes, len(jobs) or 1), stop) as pool:
        with _deaf():
            waiting: dict[Future[Prepared], PreparationJob] = {pool.submit(_work, job): job for job in jobs}
        while waiting and not interrupted():
            done, _ = wait(waiting, timeout=0.2, return_when=FIRST_COMPLETED)
            for each in done:
                yield waiting.pop(each), each.result()
        stop.set()
        wait(waiting, timeout=ENDING)
        late = [each for each in waiting if not each.done()]
        if late:
            _kill()
        for each, job in waiting.items():
            yield job, interrupted_before(job.path) if each in late else each.result()


@contextlib.contextmanager
def _pool(processes: int, stop: Event) -> Iterator[ProcessPoolExecutor]:
    """A pool of processes. Their searches end when `stop` is set. A second Ctrl-C kills them."""
    pool = ProcessPoolExecutor(processes, SPAWN, _listen, (stop,))
    try:
        yield pool
        pool.shutdown(wait=True, cancel_futures=True)
    except BaseException:
        _kill()
        raise


def _kill() -> None:
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
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    # an alarm would reach processes that are half started, and they would complain
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGALRM})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGALRM})
        signal.signal(signal.SIGINT, before)


_STOPS: list[Event] = []  # in a process of the pool: the event that tells it to stop


def _listen(stop: Event) -> None:
    """In a process of the pool: stop its searches and its grounding when `stop` is set, and end with its parent."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _STOPS.append(stop)
    stopping.asking(_stopped).__enter__()


def _end_with_parent() -> None:
    """End this process when its parent is gone, killed perhaps: the pool's queue would keep it waiting for ever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _stopped() -> bool:
    return any(each.is_set() for each in _STOPS)


def _work(job: PreparationJob) -> Prepared:
    return work(job, _stopped)
