"""A local socket on which other processes of the same user tell a run what to do. Nobody else can open it."""

import contextlib
import getpass
import hashlib
import json
import os
import queue
import socket
import stat
import tempfile
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any

from cellwright.engine.model.execution import Order, Record, RecordKind
from cellwright.engine.pipelines.execution.orders import Given
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.json_text import parsed

ASKED_S = 0.1  # how long a wait for an order is
PATIENCE_S = 5.0
ANSWERED_S = 3.0  # how long a caller waits to hear what came of an order that a run may refuse
REFUSABLE = (Order.SKIP, Order.RETRY, Order.BACK, Order.CORRECT, Order.ADD, Order.ANSWER)
ROOM = (
    100 - 50 - len("/cellwright-")
)  # characters of a folder: the path of a socket may have about 100, its name has 50
LONGEST = 65_536  # bytes of an order


def folder() -> Path:
    """The folder of the sockets, which only its owner can enter. Raises `InvalidInput` if somebody else made it."""
    given = os.environ.get("XDG_RUNTIME_DIR", "")
    given = given if len(given) <= ROOM else ""
    name = "cellwright" if given else f"cellwright-{os.getuid()}"
    place = Path(given or tempfile.gettempdir()) / name
    place.mkdir(mode=0o700, exist_ok=True)
    found = place.lstat()
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or stat.S_IMODE(found.st_mode) & 0o077:
        hint = "remove it, or set XDG_RUNTIME_DIR to a folder of your own"
        raise InvalidInput([Diagnostic(Source(str(place)), "K415", "others can open this folder", hint)])
    return place


def address(run: str, store: str = "") -> Path:
    """The socket of a run whose journal is in a store: runs of one name in other stores have others.

    The name is short, because the path of a socket may have about 100 characters.
    """
    where = store if "://" in store or not store else str(Path(store).resolve())
    return folder() / f"{_plain(run)}-{hashlib.sha256(f'{where} {run}'.encode()).hexdigest()[:12]}.sock"


def _plain(run: str) -> str:
    return "".join(each if (each.isalnum() and each.isascii()) or each in "-_." else "_" for each in run)[:32]


class Channel:
    """Orders for one run that come over its socket, and those that this process gives itself."""

    def __init__(self, run: str, store: str = "") -> None:
        self.run, self.store = run, store
        self._orders: queue.Queue[Given] = queue.Queue()
        self._told: Callable[[], Mapping[str, Any]] = dict
        self._order, self._noted = (
            "",
            False,
        )  # the last order that may be refused, and whether the run has noted it
        self._came: queue.Queue[str] = queue.Queue()  # what came of it: empty, or why it was refused
        self._one_by_one = threading.Lock()
        self._server: socket.socket | None = None

    def __enter__(self) -> "Channel":
        place = address(self.run, self.store)
        if _asked(place, "state") is not None:
            said = f"the run {self.run} goes on in another process"
            raise InvalidInput([Diagnostic(Source(self.run), "K421", said, "stop it there first")])
        place.unlink(missing_ok=True)
        self._server = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        before = os.umask(0o177)
        try:
            self._server.bind(str(place))
        except OSError:
            self._server.close()
            raise
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
            address(self.run, self.store).unlink(missing_ok=True)

    def tells(self, state: Callable[[], Mapping[str, Any]]) -> None:
        """What callers are told of the run beside that their order has come."""
        self._told = state

    def give(self, given: Given) -> None:
        """Give an order; from this process, it may be called in any thread. When it came is noted, if it does not say so."""
        when = given.when or datetime.now(UTC).isoformat(timespec="milliseconds")
        self._orders.put(replace(given, when=when, who=given.who or user()))

    def watch(self, record: Record) -> None:
        """Look at a record of the run, to tell a caller what came of an order."""
        content, order = record.content, self._order
        if record.kind is RecordKind.ORDER:
            self._noted = content["order"] == order
        elif not self._noted:
            return
        elif record.kind is RecordKind.DECISION and content["what"] == f"{order} refused":
            self._came.put(content["why"])
        elif (record.kind is RecordKind.PLAN and content["why"] == order) or (
            record.kind is RecordKind.REPLY and order == Order.ANSWER
        ):
            self._came.put("")

    def _came_of(self, given: Given) -> dict[str, str]:
        """Give an order and wait a little for what comes of it: why it was `refused`; nothing if that is not known yet."""
        if given.order not in REFUSABLE:
            self.give(given)
            return {}
        with self._one_by_one, contextlib.suppress(queue.Empty):
            self._order, self._noted, self._came = given.order.value, False, queue.Queue()
            self.give(given)
            return {"refused": self._came.get(timeout=ANSWERED_S)}
        return {}

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
            threading.Thread(target=self._converse, args=(caller,), daemon=True).start()

    def _converse(self, caller: socket.socket) -> None:
        """Answer one caller. A stop has not to wait until another order is answered."""
        with caller, contextlib.suppress(OSError, ValueError, KeyError, TypeError):
            caller.settimeout(PATIENCE_S)
            asked, came = parsed(_line(caller)), dict[str, str]()
            if asked["order"] != "state":
                text, who = str(asked.get("text", "")), str(asked.get("who", ""))
                came = self._came_of(Given(Order(asked["order"]), text, "socket", who))
            state = {**self._told(), "run": self.run, "store": self.store, **came}
            caller.sendall((json.dumps(state) + "\n").encode())


def going_on() -> tuple[Mapping[str, Any], ...]:
    """How each run stands that goes on in a process of this user, with its `run` and `store`."""
    states = (_asked(each, "state") for each in sorted(folder().glob("*.sock")))
    return tuple(each for each in states if each is not None)


def tell(run: str, order: str, text: str = "", store: str = "", who: str = "") -> Mapping[str, Any]:
    """Give an order to a run; how it stands, and why it was `refused` if it was (empty: it is followed). `who` gives it is noted: this user, if nobody is named.

    Raises `InvalidInput` if no process runs it, or if several runs have this name and no store is given.
    """
    place = address(run, store) if store else _only(run)
    found = _asked(place, order, text, who or user())
    if found is None:
        raise _silent(run)
    return found


def user() -> str:
    """The name of who runs this process, for the journal."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return str(os.getuid())


def _only(run: str) -> Path:
    """The socket of the only run of a name that goes on. Raises `InvalidInput` if there is none, or more than one."""
    found = [each for each in going_on() if each["run"] == run]
    if not found:
        raise _silent(run)
    if len(found) > 1:
        stores = " or ".join(f"--store {each['store']}" for each in found)
        said = f"{len(found)} runs with the name {run} go on"
        raise InvalidInput([Diagnostic(Source(run), "K421", said, f"say which one: {stores}")])
    return address(run, found[0]["store"])


def _silent(run: str) -> InvalidInput:
    known = sorted({str(each["run"]) for each in going_on()})
    resume = f"take it up again with: cellwright resume {run}"
    hint = f"{resume}; these go on: {', '.join(known)}" if known else f"{resume}; no run goes on now"
    said = f"the run {run} does not go on in any process of yours"
    return InvalidInput([Diagnostic(Source(run), "K421", said, hint)])


def _asked(place: Path, order: str, text: str = "", who: str = "") -> Mapping[str, Any] | None:
    """What the process behind a socket answers to an order; None if nobody is there."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as line:
        line.settimeout(PATIENCE_S)
        try:
            line.connect(str(place))
            line.sendall((json.dumps({"order": order, "text": text, "who": who}) + "\n").encode())
            found = parsed(_line(line))
        except (OSError, ValueError):
            return None
    return found if isinstance(found, dict) and "run" in found and "store" in found else None


def _line(line: socket.socket) -> str:
    found = b""
    while not found.endswith(b"\n") and len(found) < LONGEST:
        part = line.recv(4096)
        if not part:
            break
        found += part
    return found.decode("utf-8")
