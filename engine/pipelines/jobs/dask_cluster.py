"""Workers of a Dask cluster that carry units out. Only this module imports Dask.

A worker hears that a unit is not wanted any more from the scheduler, which knows it from Ctrl-C
here or from the end of this process. What a worker has finished it has noted in the ledger, so
nothing is lost with the scheduler or with this process.
"""

import contextlib
import logging
import socket
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError, Future
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from cellwright.engine.pipelines.jobs.input_digests import program_digest
from cellwright.engine.pipelines.jobs.work_units import WorkKind, WorkUnit, carry_out_unit
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.garbage_collection import seldom_searched

if TYPE_CHECKING:
    import distributed

SCHEDULER_PORT = 8786
REACHED_S, ANSWERED_S, STAFFED_S = (
    3.0,
    8.0,
    10.0,
)  # until the port is open, the scheduler answers, and there is a worker
COUNTED_S = 2.0  # between two counts of the workers
WANTED_CHECK_S = 0.2  # between two looks of a worker whether its unit is still wanted
ADDRESS_SCHEMES = ("tcp", "tls")
_NO_SCHEDULER = "what answers there is no scheduler of Dask"
_START_HINT = "start one with `dask scheduler` and `dask worker ADDRESS`"


@contextlib.contextmanager
def connect_workers(address: str) -> "Iterator[ClusterWorkers]":
    """The workers of the cluster at an address.

    Raises `InvalidInput` if there is none that can be used.
    """
    import distributed

    where = _scheduler_address(address)
    _silence_dask()
    try:
        client = distributed.Client(where, timeout=ANSWERED_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise _cluster_error(address, _NO_SCHEDULER, _START_HINT) from error
    try:
        _require_workers(client, address)
        yield ClusterWorkers(client, address)
    finally:
        with contextlib.suppress(Exception):
            client.close(timeout=1)


def _silence_dask() -> None:
    """Keep Dask from telling what the answer tells."""
    for name in ("asyncio", *logging.root.manager.loggerDict):
        if name == "asyncio" or name.partition(".")[0] == "distributed":
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)


def _scheduler_address(said: str) -> str:
    """The address of a scheduler, as Dask writes it. Raises `InvalidInput`."""
    scheme, separator, rest = said.partition("://")
    host, colon, port = (rest if separator else said).rpartition(":")
    host = host if colon else port
    number = port if colon else str(SCHEDULER_PORT)
    plain = (
        (not separator or scheme in ADDRESS_SCHEMES)
        and host
        and host.isprintable()
        and not set(host) & set(" /@?#")
    )
    if not plain or not (number.isascii() and number.isdigit() and 0 < int(number[:6]) < 65_536):
        raise _cluster_error(
            said, "this is not the address of a cluster", "give HOST:PORT, or tls://HOST:PORT"
        )
    return f"{scheme if separator else 'tcp'}://{host}:{int(number)}"


def require_open(address: str) -> None:
    """Look at once whether anybody listens at an address: Dask itself would try again for as long
    as it may.

    Raises `InvalidInput` if nobody does, or if Dask is not installed.
    """
    host, _, port = _scheduler_address(address).partition("://")[2].rpartition(":")
    if find_spec("distributed") is None:
        hint = "install the extra: pip install 'cellwright[cluster]'"
        raise _cluster_error(address, "the package for clusters is not installed", hint, "K414")
    try:
        with socket.create_connection((host.strip("[]"), int(port)), timeout=REACHED_S) as line:
            _require_greeting(address, line)
    except (OSError, UnicodeError) as error:
        why = getattr(error, "strerror", "") or str(error) or "no answer"
        hint = "start one with `dask scheduler` and `dask worker ADDRESS`, or leave out --cluster"
        raise _cluster_error(address, f"no cluster answers: {why.lower()}", hint) from None


def _require_greeting(address: str, line: socket.socket) -> None:
    """Look whether who listens speaks first, as a scheduler does; with TLS it does not."""
    if address.startswith("tls"):
        return
    line.settimeout(ANSWERED_S)
    with contextlib.suppress(TimeoutError, ConnectionError):
        if line.recv(1):
            return
    raise _cluster_error(address, _NO_SCHEDULER, _START_HINT)


def _require_workers(client: "distributed.Client", address: str) -> None:
    """Look whether there are workers, and whether all have this Cellwright, the scheduler as well.

    Raises `InvalidInput`.
    """
    try:
        client.wait_for_workers(1, timeout=STAFFED_S)
    except (OSError, TimeoutError) as error:
        hint = f"start some: dask worker {address} --nthreads 1"
        raise _cluster_error(address, "the cluster has no workers", hint) from error
    try:
        programs = {"the scheduler": client.run_on_scheduler(program_digest)}
    except Exception as error:  # whatever it is, Cellwright could not be loaded there
        programs = {"the scheduler": error}
    programs |= {
        f"the worker {name}": worker_program
        for name, worker_program in client.run(program_digest, on_error="return").items()
    }
    for name, other_program in programs.items():
        if other_program != program_digest():
            why = (
                "has another version of Cellwright"
                if isinstance(other_program, str)
                else "cannot load Cellwright"
            )
            hint = "install the same version for scheduler and workers, and start them again"
            raise _cluster_error(address, f"{name} {why}", hint)


def _cluster_error(address: str, message: str, hint: str, code: str = "K430") -> InvalidInput:
    return InvalidInput([Diagnostic(Source(f"--cluster {address}"), code, message, hint)])


class ClusterWorkers:
    """The workers of a cluster. See `Hands`."""

    patience = 1  # the scheduler itself has tried it several times

    def __init__(self, client: "distributed.Client", address: str) -> None:
        from distributed import KilledWorker

        self.deaths: tuple[type[BaseException], ...] = (KilledWorker,)
        self._client, self._address = client, address
        self._given: dict[Future[Any], distributed.Future] = {}
        self._lost = False
        self._counted, self._threads = -COUNTED_S, 0

    @property
    def width(self) -> int:
        """Two units for each thread of the workers that there are now, so that none waits."""
        if time.monotonic() > self._counted + COUNTED_S:
            self._counted = time.monotonic()
            with contextlib.suppress(Exception):  # the last count must do
                info = self._client.scheduler_info(n_workers=-1)
                self._threads = sum(int(worker["nthreads"]) for worker in info["workers"].values())
        return max(2, 2 * self._threads)

    def give(self, kind: WorkKind[Any, Any], unit: WorkUnit[Any]) -> Future[Any]:
        """See `Hands`."""
        submitted = self._client.submit(_carry_out_one, kind, unit, pure=False)
        promise: Future[Any] = Future()
        promise.set_running_or_notify_cancel()
        self._given[promise] = submitted
        submitted.add_done_callback(lambda finished: self._hear(promise, finished))
        return promise

    def _hear(self, promise: Future[Any], given: "distributed.Future") -> None:
        self._given.pop(promise, None)
        if given.status == "finished":
            promise.set_result(given.result())
        elif given.status == "error":
            promise.set_exception(given.exception() or RuntimeError("no reason told"))
        else:  # the scheduler is gone
            self._lost = True
            promise.set_exception(CancelledError())

    def renew(self) -> None:
        """Workers are started again by those who have started them."""

    def gone(self) -> str:
        """Why nothing more can be carried out; empty as long as it can."""
        if self._lost or self._client.status not in ("running", "newly-created"):
            return (
                f"the cluster at {self._address} is gone; start again: what is finished is not "
                "done again"
            )
        return ""

    def stop(self, running: Sequence[Future[Any]]) -> None:
        """Take the units back. Workers hear it while they work."""
        if not self._lost:
            with contextlib.suppress(Exception):
                self._client.cancel(
                    [self._given[future] for future in running if future in self._given]
                )


def _carry_out_one(kind: WorkKind[Any, Any], unit: WorkUnit[Any]) -> Any:
    """On a worker: carry out a unit, as long as it is wanted."""
    is_wanted = _UnitWanted()
    try:
        with seldom_searched():
            return carry_out_unit(kind, unit, is_wanted.is_over)
    finally:
        is_wanted.ended = True


class _UnitWanted:
    """Whether the unit that this thread of a worker carries out is wanted: looked at now and
    then from another thread.
    """

    def __init__(self) -> None:
        from distributed.worker import get_worker, thread_state

        self._worker, self._key = get_worker(), thread_state.key
        self.over = self.ended = False
        threading.Thread(target=self._watch, daemon=True).start()

    def is_over(self) -> bool:
        """Whether the unit is not wanted any more."""
        return self.over

    def _watch(self) -> None:
        while not (self.ended or self.over):
            state = self._worker.state.tasks.get(self._key)
            self.over = state is None or state.state == "cancelled"
            time.sleep(WANTED_CHECK_S)
