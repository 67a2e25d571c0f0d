"""Local socket over which other processes of the same user give orders to a run."""

import contextlib
import getpass
import hashlib
import json
import os
import queue
import socket
import stat
import struct
import tempfile
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any

from cellwright.engine.model.run_protocol import JournalRecord, OperatorCommand, RecordKind
from cellwright.engine.pipelines.execution.operator_orders import GivenOrder
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.json_text import parse_json

ORDER_WAIT_S = 0.1  # how long a wait for an order is
SOCKET_TIMEOUT_S = 5.0
ANSWERED_S = 3.0  # how long a caller waits to hear what came of an order that a run may refuse
REFUSABLE_ORDERS = (
    OperatorCommand.SKIP,
    OperatorCommand.RETRY,
    OperatorCommand.BACK,
    OperatorCommand.CORRECT,
    OperatorCommand.ADD,
    OperatorCommand.ANSWER,
)
MAX_FOLDER_CHARACTERS = (
    100 - 50 - len("/cellwright-")
)  # characters of a folder: the path of a socket may have about 100, its name has 50
MAX_ORDER_BYTES = 65_536  # bytes of an order


def socket_folder() -> Path:
    """The folder of the sockets, which only its owner can enter.

    Raises `InvalidInput` if somebody else made it.
    """
    runtime_folder = os.environ.get("XDG_RUNTIME_DIR", "")
    runtime_folder = runtime_folder if len(runtime_folder) <= MAX_FOLDER_CHARACTERS else ""
    name = "cellwright" if runtime_folder else f"cellwright-{os.getuid()}"
    place = Path(runtime_folder or tempfile.gettempdir()) / name
    place.mkdir(mode=0o700, exist_ok=True)
    status = place.lstat()
    if (
        not stat.S_ISDIR(status.st_mode)
        or status.st_uid != os.getuid()
        or stat.S_IMODE(status.st_mode) & 0o077
    ):
        hint = "remove it, or set XDG_RUNTIME_DIR to a folder of your own"
        raise InvalidInput(
            [Diagnostic(Source(str(place)), "K415", "others can open this folder", hint)]
        )
    return place


def socket_address(run: str, store: str = "") -> Path:
    """The socket of a run whose journal is in a store: runs of one name in other stores have
    others.

    The name is short, because the path of a socket may have about 100 characters.
    """
    where = store if "://" in store or not store else str(Path(store).resolve())
    return (
        socket_folder()
        / f"{_plain_name(run)}-{hashlib.sha256(f'{where} {run}'.encode()).hexdigest()[:12]}.sock"
    )


def _plain_name(run: str) -> str:
    return "".join(
        character if (character.isalnum() and character.isascii()) or character in "-_." else "_"
        for character in run
    )[:32]


class OrderChannel:
    """Orders for one run that come over its socket, and those that this process gives itself."""

    def __init__(self, run: str, store: str = "") -> None:
        self.run, self.store = run, store
        # its `put` may be called in a handler of signals while the same thread is in `get`
        self._orders: queue.SimpleQueue[GivenOrder] = queue.SimpleQueue()
        self._told: Callable[[], Mapping[str, Any]] = dict
        self._order, self._noted = (
            "",
            False,
        )  # the last order that may be refused, and whether the run has noted it
        # what came of it: empty, or why it was refused
        self._came: queue.Queue[str] = queue.Queue()
        self._one_by_one = threading.Lock()
        self._server: socket.socket | None = None

    def __enter__(self) -> "OrderChannel":
        place = socket_address(self.run, self.store)
        if _ask_process(place, "state") is not None:
            reason = f"the run {self.run} goes on in another process"
            raise InvalidInput(
                [Diagnostic(Source(self.run), "K421", reason, "stop it there first")]
            )
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
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._server is not None:
            with contextlib.suppress(OSError):
                self._server.shutdown(socket.SHUT_RDWR)
            self._server.close()
            socket_address(self.run, self.store).unlink(missing_ok=True)

    def tells(self, state: Callable[[], Mapping[str, Any]]) -> None:
        """What callers are told of the run beside that their order has come."""
        self._told = state

    def give(self, given: GivenOrder) -> None:
        """Give an order; from this process, it may be called in any thread.

        When it came is noted, if it does not say so.
        """
        when = given.when or datetime.now(UTC).isoformat(timespec="milliseconds")
        self._orders.put(replace(given, when=when, who=given.who or user_name()))

    def watch(self, record: JournalRecord) -> None:
        """Look at a record of the run, to tell a caller what came of an order."""
        content, order = record.content, self._order
        if record.kind is RecordKind.ORDER:
            self._noted = content["order"] == order
        elif not self._noted:
            return
        elif record.kind is RecordKind.DECISION and content["what"] == f"{order} refused":
            self._came.put(content["why"])
        elif (record.kind is RecordKind.PLAN and content["why"] == order) or (
            record.kind is RecordKind.REPLY and order == OperatorCommand.ANSWER
        ):
            self._came.put("")

    def _came_of(self, given: GivenOrder) -> dict[str, str]:
        """Give an order and wait a little for what comes of it: why it was `refused`; nothing
        if that is not known yet.
        """
        if given.order not in REFUSABLE_ORDERS:
            self.give(given)
            return {}
        with self._one_by_one, contextlib.suppress(queue.Empty):
            self._order, self._noted, self._came = given.order.value, False, queue.Queue()
            self.give(given)
            return {"refused": self._came.get(timeout=ANSWERED_S)}
        return {}

    def due(self, now_ms: int) -> Sequence[GivenOrder]:  # noqa: ARG002 - orders come in real time
        """The orders that came since the last call."""
        given_orders = []
        with contextlib.suppress(queue.Empty):
            while True:
                given_orders.append(self._orders.get_nowait())
        return given_orders

    def next_ms(self) -> int | None:
        """Nobody knows."""
        return None

    def wait(self) -> bool:
        """Wait a little for an order; one can always come."""
        with contextlib.suppress(queue.Empty):
            self._orders.put(self._orders.get(timeout=ORDER_WAIT_S))
        return True

    def _serve(self, server: socket.socket) -> None:
        while True:
            try:
                caller, _ = server.accept()
            except OSError:
                return
            if not _is_own_peer(caller):
                caller.close()
                continue
            threading.Thread(target=self._converse, args=(caller,), daemon=True).start()

    def _converse(self, caller: socket.socket) -> None:
        """Answer one caller. A stop has not to wait until another order is answered."""
        with caller, contextlib.suppress(OSError, ValueError, KeyError, TypeError):
            caller.settimeout(SOCKET_TIMEOUT_S)
            asked, came = parse_json(_read_line(caller)), dict[str, str]()
            if asked["order"] != "state":
                text, who = str(asked.get("text", "")), str(asked.get("who", ""))
                came = self._came_of(
                    GivenOrder(OperatorCommand(asked["order"]), text, "socket", who)
                )
            state = {**self._told(), "run": self.run, "store": self.store, **came}
            caller.sendall((json.dumps(state) + "\n").encode())


def going_on() -> tuple[Mapping[str, Any], ...]:
    """How each run stands that goes on in a process of this user, with its `run` and `store`."""
    states = (
        _ask_process(socket_file, "state") for socket_file in sorted(socket_folder().glob("*.sock"))
    )
    return tuple(state for state in states if state is not None)


def tell_run(
    run: str, order: str, text: str = "", store: str = "", who: str = ""
) -> Mapping[str, Any]:
    """Give an order to a run; how it stands, and why it was `refused` if it was (empty: it is
    followed). `who` gives it is noted: this user, if nobody is named.

    Raises `InvalidInput` if no process runs it, or if several runs have this name and no store is
    given.
    """
    place = socket_address(run, store) if store else _only_socket(run)
    answer = _ask_process(place, order, text, who or user_name())
    if answer is None:
        raise _no_process_error(run)
    return answer


def user_name() -> str:
    """The name of who runs this process, for the journal."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return str(os.getuid())


def _only_socket(run: str) -> Path:
    """The socket of the only run of a name that goes on.

    Raises `InvalidInput` if there is none, or more than one.
    """
    states = [state for state in going_on() if state["run"] == run]
    if not states:
        raise _no_process_error(run)
    if len(states) > 1:
        stores = " or ".join(f"--store {state['store']}" for state in states)
        reason = f"{len(states)} runs with the name {run} go on"
        raise InvalidInput([Diagnostic(Source(run), "K421", reason, f"say which one: {stores}")])
    return socket_address(run, states[0]["store"])


def _no_process_error(run: str) -> InvalidInput:
    run_names = sorted({str(state["run"]) for state in going_on()})
    resume = f"take it up again with: cellwright resume {run}"
    hint = (
        f"{resume}; these go on: {', '.join(run_names)}"
        if run_names
        else f"{resume}; no run goes on now"
    )
    reason = f"the run {run} does not go on in any process of yours"
    return InvalidInput([Diagnostic(Source(run), "K421", reason, hint)])


def _ask_process(
    place: Path, order: str, text: str = "", who: str = ""
) -> Mapping[str, Any] | None:
    """What the process behind a socket answers to an order; None if nobody is there."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as line:
        line.settimeout(SOCKET_TIMEOUT_S)
        try:
            line.connect(str(place))
            if not _is_own_peer(line):
                return None
            line.sendall((json.dumps({"order": order, "text": text, "who": who}) + "\n").encode())
            answer = parse_json(_read_line(line))
        except (OSError, ValueError):
            return None
    return answer if isinstance(answer, dict) and "run" in answer and "store" in answer else None


def _is_own_peer(line: socket.socket) -> bool:
    """Whether the other end is a process of this user or of root, as far as the system tells."""
    option = getattr(socket, "SO_PEERCRED", None)
    if option is None:
        return True
    told = line.getsockopt(socket.SOL_SOCKET, option, struct.calcsize("3i"))
    _, user, _ = struct.unpack("3i", told)
    return user in (0, os.getuid())


def _read_line(line: socket.socket) -> str:
    received = b""
    while not received.endswith(b"\n") and len(received) < MAX_ORDER_BYTES:
        part = line.recv(4096)
        if not part:
            break
        received += part
    return received.decode("utf-8")
