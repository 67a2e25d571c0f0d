"""A local socket on which other processes of the same user tell a run what to do. Nobody else can open it."""

import contextlib
import json
import os
import queue
import socket
import stat
import tempfile
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from engine.model.execution import Order
from engine.pipelines.execution.orders import Given
from kb.diagnostics import Diagnostic, InvalidInput, Source

ASKED_S = 0.1  # how long a wait for an order is
PATIENCE_S = 5.0
LONGEST = 65_536  # bytes of an order


def folder() -> Path:
    """The folder of the sockets, which only its owner can enter. Raises `InvalidInput` if somebody else made it."""
    given = os.environ.get("XDG_RUNTIME_DIR")
    name = "cellwright" if given else f"cellwright-{os.getuid()}"
    place = Path(given or tempfile.gettempdir()) / name
    place.mkdir(mode=0o700, exist_ok=True)
    found = place.lstat()
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or stat.S_IMODE(found.st_mode) & 0o077:
        hint = "remove it, or set XDG_RUNTIME_DIR to a folder of your own"
        raise InvalidInput([Diagnostic(Source(str(place)), "K415", "others can open this folder", hint)])
    return place


def address(run: str) -> Path:
    """The socket of a run."""
    plain = "".join(each if each.isalnum() or each in "-_." else "_" for each in run)
    return folder() / f"{plain[:80]}.sock"


class Channel:
    """Orders for one run that come over its socket, and those that this process gives itself."""

    def __init__(self, run: str) -> None:
        self.run = run
        self._orders: queue.Queue[Given] = queue.Queue()
        self._told: Callable[[], Mapping[str, Any]] = dict
        self._server: socket.socket | None = None

    def __enter__(self) -> "Channel":
        place = address(self.run)
        if answers(self.run):
            said = f"the run {self.run} goes on in another process"
            raise InvalidInput([Diagnostic(Source(self.run), "K421", said, "stop it there first")])
        place.unlink(missing_ok=True)
        self._server = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        before = os.umask(0o177)
        try:
            self._server.bind(str(place))
        finally:
            os.umask(before)
        self._server.listen()
        threading.Thread(target=self._serve, args=(self._server,), daemon=True).start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._server is not None:
            with contextlib.suppress(OSError):
                self._server.shutdown(socket.SHUT_RDWR)
            self._server.close()
            address(self.run).unlink(missing_ok=True)

    def tells(self, state: Callable[[], Mapping[str, Any]]) -> None:
        """What callers are told of the run beside that their order has come."""
        self._told = state

    def give(self, given: Given) -> None:
        """Give an order from this process."""
        self._orders.put(given)

    def due(self, now_ms: int) -> Sequence[Given]:  # noqa: ARG002 - orders come in real time
        """The orders that came since the last call."""
        found = []
        with contextlib.suppress(queue.Empty):
            while True:
                found.append(self._orders.get_nowait())
        return found

    def next_ms(self) -> int | None:
        """Nobody knows."""
        return None

    def wait(self) -> bool:
        """Wait a little for an order; one can always come."""
        with contextlib.suppress(queue.Empty):
            self._orders.put(self._orders.get(timeout=ASKED_S))
        return True

    def _serve(self, server: socket.socket) -> None:
        while True:
            try:
                caller, _ = server.accept()
            except OSError:
                return
            with caller, contextlib.suppress(OSError, ValueError, KeyError, TypeError):
                caller.settimeout(PATIENCE_S)
                asked = json.loads(_line(caller))
                if asked["order"] != "state":
                    given = Given(Order(asked["order"]), str(asked.get("text", "")), "socket")
                    self._orders.put(given)
                caller.sendall((json.dumps(dict(self._told())) + "\n").encode())


def answers(run: str) -> bool:
    """Whether a process runs this run."""
    try:
        tell(run, "state")
    except (InvalidInput, OSError):
        return False
    return True


def tell(run: str, order: str, text: str = "") -> Mapping[str, Any]:
    """Give an order to a run; how it stands. Raises `InvalidInput` if no process runs it."""
    place = address(run)
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as line:
        line.settimeout(PATIENCE_S)
        try:
            line.connect(str(place))
            line.sendall((json.dumps({"order": order, "text": text}) + "\n").encode())
            found = json.loads(_line(line))
        except (OSError, ValueError):
            known = sorted(each.stem for each in folder().glob("*.sock"))
            hint = f"these go on: {', '.join(known)}" if known else "no run goes on"
            said = f"the run {run} does not go on in any process of yours"
            raise InvalidInput([Diagnostic(Source(run), "K421", said, hint)]) from None
    return found if isinstance(found, dict) else {}


def _line(line: socket.socket) -> str:
    found = b""
    while not found.endswith(b"\n") and len(found) < LONGEST:
        part = line.recv(4096)
        if not part:
            break
        found += part
    return found.decode("utf-8")
