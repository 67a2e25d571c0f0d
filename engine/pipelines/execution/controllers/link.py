"""Connection to a controller over TCP or standard streams, with heartbeats, and its options.

An event loop in a thread of its own reads and writes. The one thread that drives asks, and takes
what came from a queue.
"""

import asyncio
import contextlib
import itertools
import queue
import shlex
import threading
import time
from collections.abc import Callable, Mapping
from concurrent import futures
from dataclasses import dataclass
from typing import Any

from cellwright.engine.pipelines.execution.controllers.line_splitter import LineSplitter
from cellwright.engine.pipelines.execution.controllers.protocol import (
    ANSWER_OF_QUESTION,
    MAX_LINE_BYTES,
    MAX_NAME_CHARACTERS,
    MalformedLine,
    protocol_line,
    read_line,
)
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.numbers import NumberError, is_count, read_decimal

MAX_SILENT_HEARTBEATS = 3  # heartbeats without a line after which a controller counts as hanging
MAX_FRUITLESS_CONNECTIONS = 20  # in a row that end before any command is answered
MAX_WAITING_BYTES = 32 * 2**20  # of what has come and was not taken in yet
MAX_DROPPED_BYTES = 256 * 2**20  # of a line that does not end
EVENT_BYTES, VALUE_BYTES = 500, 100  # about the memory of an event, and of a value in a line
READ_BYTES = 2**16
UNASKED_TYPES = ("reply", "part")  # they come by themselves, whatever other keys they have
AGAIN_S = 0.1  # between two attempts to connect
BEGIN_LOOK_S = 0.05  # between two looks whether a controller has begun
ROOM_S = 0.02  # between two looks whether there is room


@dataclass(frozen=True, slots=True)
class ControllerAddress:
    """Where a controller is: `command` starts it, or it listens at `host` and `port`."""

    command: str = ""
    host: str = ""
    port: int = 0

    def __str__(self) -> str:
        return self.command or f"{self.host}:{self.port}"


@dataclass(frozen=True, slots=True)
class Patience:
    """How long a controller may take: to begin, to answer, between two signs of life, and to be
    there again. Seconds.
    """

    begin_s: float = 30.0
    answer_s: float = 5.0
    heartbeat_s: float = 1.0
    reconnect_s: float = 10.0


@dataclass(frozen=True, slots=True)
class MessageCame:
    """A line that nobody asked for, and about how many bytes of memory it takes."""

    content: Mapping[str, Any]
    cost: int = 0


@dataclass(frozen=True, slots=True)
class UnreadableLine:
    """A line that is none of the protocol."""

    why: str


@dataclass(frozen=True, slots=True)
class ControllerConnected:
    """The controller is there, or there again."""


@dataclass(frozen=True, slots=True)
class ConnectionBroken:
    """The controller is lost for good."""

    why: str


Event = MessageCame | UnreadableLine | ControllerConnected | ConnectionBroken


class EventInbox(queue.Queue[Event]):
    """What has come and was not taken in yet. `cost` is about its memory, in bytes."""

    cost = 0

    def _put(self, item: Event) -> None:
        super()._put(item)
        self.cost += EVENT_BYTES + getattr(item, "cost", 0)

    def _get(self) -> Event:
        item: Event = super()._get()
        self.cost -= EVENT_BYTES + getattr(item, "cost", 0)
        return item


class PeerGivenUp(Exception):
    """What the peer does makes it useless to connect again. The text says what it did."""


class NoAnswer(Exception):
    """A question got no answer. The text says why."""


class NoTimelyAnswer(NoAnswer):
    """The connection stands, but no answer came in time."""


class ControllerLink:
    """A line to one controller."""

    def __init__(self, place: ControllerAddress, patience: Patience, fence: int = 0) -> None:
        self.place, self.patience = place, patience
        self._fenced: dict[str, int] = {"fence": fence} if fence else {}  # goes with each question
        self.inbox = EventInbox()
        self._fruitless = 0  # connections since a command was answered
        self._loop = asyncio.new_event_loop()
        self._writer: asyncio.StreamWriter | None = None
        self._process: asyncio.subprocess.Process | None = None
        self._asked: dict[int, tuple[str, futures.Future[dict[str, Any]]]] = {}
        self._numbers = itertools.count(1)
        self._closing = False
        self._spoke = False  # whether the controller has ever said anything
        self._thread = threading.Thread(target=self._live, daemon=True)
        self._thread.start()

    def ask(self, type_: str, more_s: float = 0.0, **content: Any) -> dict[str, Any]:
        """Ask the controller, and wait for its answer, for `more_s` longer than usual. Raises
        `NoAnswer`.
        """
        number = next(self._numbers)
        answer: futures.Future[dict[str, Any]] = futures.Future()
        self._asked[number] = (type_, answer)
        try:
            line = protocol_line(type_, id=number, **self._fenced, **content)
            self._call(self._write, line)
            return self._await(answer, type_, more_s)
        finally:
            self._asked.pop(number, None)

    def _await(
        self, answer: futures.Future[dict[str, Any]], type_: str, more_s: float
    ) -> dict[str, Any]:
        """The answer. A controller that has never said anything may still be about to begin; one
        that says something, and be it nonsense, has begun. Raises `NoTimelyAnswer`.
        """
        if not self._spoke:
            end = time.monotonic() + self.patience.begin_s
            while not self._spoke and not answer.done() and time.monotonic() < end:
                futures.wait([answer], BEGIN_LOOK_S)
        patience = more_s + (self.patience.answer_s if self._spoke else 0.0)
        try:
            return answer.result(patience)
        except futures.TimeoutError:
            waited = patience if self._spoke else self.patience.begin_s
            raise NoTimelyAnswer(f"no answer to `{type_}` within {waited:g} s") from None

    def _call(self, function: Callable[..., None], *arguments: Any) -> None:
        """Call a function in the thread of the link. Raises `NoAnswer` if that has ended."""
        try:
            self._loop.call_soon_threadsafe(function, *arguments)
        except RuntimeError:  # the loop is closed
            raise NoAnswer("the connection is closed") from None

    def replied(self) -> None:
        """A command was answered: the controller does get on, whatever its connections do."""
        self._fruitless = 0

    def say(self, text: bytes) -> None:
        """Send a line that asks nothing. Raises `NoAnswer`."""
        self._call(self._write, text)

    def broken_off(self) -> None:
        """Give this connection up, so that another one is made."""
        with contextlib.suppress(NoAnswer):
            self._call(self._hang_up)

    def close(self) -> None:
        """Say goodbye. A controller that listens lives on; one that was started here is left to
        end by itself.
        """
        self._closing = True
        with contextlib.suppress(NoAnswer):
            self._call(self._write, protocol_line("bye"))
            self._call(self._hang_up)
        self._thread.join(self.patience.answer_s)

    def _write(self, text: bytes) -> None:
        if self._writer is None or self._writer.is_closing():
            self._disappoint("the connection is broken")
            return
        self._writer.write(text)

    def _hang_up(self) -> None:
        if self._writer is not None:
            self._writer.close()

    def _disappoint(self, why: str) -> None:
        """Nobody will answer what was asked."""
        for _, answer in list(self._asked.values()):
            if not answer.done():
                answer.set_exception(NoAnswer(why))

    def _live(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._connections())
        finally:
            self._loop.run_until_complete(self._loop.shutdown_asyncgens())
            self._loop.close()

    async def _connections(self) -> None:
        """One connection after another, until the last one is lost or given back."""
        lost, why = time.monotonic(), ""
        while not self._closing:
            try:
                reader = await asyncio.wait_for(self._connect(), self.patience.answer_s)
            except (TimeoutError, OSError) as error:
                why = why or f"{self.place} cannot be reached: {error or 'no answer'}"
                if self.place.command or time.monotonic() - lost > self.patience.reconnect_s:
                    break
                await asyncio.sleep(AGAIN_S)
                continue
            self.inbox.put(ControllerConnected())
            self._fruitless += 1
            try:
                why, is_last = await self._conversation(reader), bool(self.place.command)
            except PeerGivenUp as error:
                why, is_last = str(error), True
            lost = time.monotonic()
            self._hang_up()
            self._disappoint(why)
            if is_last:
                break
            if self._fruitless >= MAX_FRUITLESS_CONNECTIONS:
                why = f"{self._fruitless} connections have ended without a reply; the last: {why}"
                break
        await self._ended()
        self.inbox.put(ConnectionBroken(why))
        self._disappoint(why)

    async def _connect(self) -> asyncio.StreamReader:
        if not self.place.command:
            reader, self._writer = await asyncio.open_connection(
                self.place.host, self.place.port, limit=READ_BYTES
            )
            return reader
        pipe = asyncio.subprocess.PIPE
        words = shlex.split(self.place.command)
        self._process = await asyncio.create_subprocess_exec(
            *words,
            stdin=pipe,
            stdout=pipe,
            limit=READ_BYTES,
            # Ctrl-C and a hang-up go to all processes of a terminal; this one is to be told by us
            start_new_session=True,
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._writer = self._process.stdin
        return self._process.stdout

    async def _conversation(self, reader: asyncio.StreamReader) -> str:
        """Read until the connection ends; why it did. Raises `PeerGivenUp`."""
        silent = 0
        beat, lines = self.patience.heartbeat_s, LineSplitter(MAX_LINE_BYTES)
        while True:
            await self._make_room()
            try:
                chunk = await asyncio.wait_for(reader.read(READ_BYTES), beat)
            except TimeoutError:
                silent += self._spoke
                if silent >= MAX_SILENT_HEARTBEATS:
                    return f"no sign of life for {silent * beat:g} s"
                self._write(protocol_line("ping", id=0))
                continue
            except OSError as error:
                return f"the connection broke: {error}"
            if not chunk:
                return "the controller has hung up"
            silent, self._spoke = 0, True
            for text in lines.feed(chunk):
                self._heard(text)
            if lines.dropped > MAX_DROPPED_BYTES:
                raise PeerGivenUp(f"it sends a line of more than {MAX_DROPPED_BYTES} bytes")

    async def _make_room(self) -> None:
        """Read no more while much waits to be taken in. While a question waits for its answer,
        which may be behind all that, read twice as much. Raises `PeerGivenUp` beyond that.
        """
        while self.inbox.cost > MAX_WAITING_BYTES and not self._asked and not self._closing:
            await asyncio.sleep(ROOM_S)
        if self.inbox.cost > 2 * MAX_WAITING_BYTES:
            raise PeerGivenUp("it sends more than can be taken in, and no answer")

    def _heard(self, text: bytes | None) -> None:
        if text is None:
            self.inbox.put(UnreadableLine(f"a line of more than {MAX_LINE_BYTES} bytes"))
            return
        try:
            message = read_line(text)
        except MalformedLine as error:
            self.inbox.put(UnreadableLine(str(error)))
            return
        number = message.get("id")
        if not isinstance(number, int) or isinstance(number, bool):
            number = None
        if message["type"] == "alive" and number == 0:
            return
        asked = None if number is None else self._asked.get(number)
        if asked is None or message["type"] in UNASKED_TYPES:
            values = text.count(b",") + text.count(b"[") + text.count(b"{")
            self.inbox.put(MessageCame(message, len(text) + VALUE_BYTES * values))
        elif message["type"] in (ANSWER_OF_QUESTION[asked[0]], "refused") and not asked[1].done():
            asked[1].set_result(message)
        else:
            kind = message["type"][:MAX_NAME_CHARACTERS]
            self.inbox.put(UnreadableLine(f"`{kind}` is no answer to `{asked[0]}`"))

    async def _ended(self) -> None:
        """Have a process that was started here end."""
        if self._process is None:
            return
        with contextlib.suppress(ProcessLookupError):
            try:
                await asyncio.wait_for(self._process.wait(), self.patience.heartbeat_s)
            except TimeoutError:
                self._process.kill()
                await self._process.wait()


ADDRESS_HINT = "give --option command='PROGRAM ...' or --option address=HOST:PORT"
CONTROLLER_OPTIONS = ("command", "address", "begin", "answer", "heartbeat", "reconnect")


def place_of(options: Mapping[str, str]) -> ControllerAddress:
    """Where the controller is. Raises `InvalidInput`."""
    strange = next((option for option in options if option not in CONTROLLER_OPTIONS), None)
    if strange is not None:
        reason = f"the driver `external` has no option '{strange}'"
        raise InvalidInput(
            [
                Diagnostic(
                    Source("--option"), "K406", reason, f"one of {', '.join(CONTROLLER_OPTIONS)}"
                )
            ]
        )
    command, address = options.get("command", ""), options.get("address", "")
    host, _, port = address.rpartition(":")
    if bool(command) == bool(address) or (
        address and not (host and is_count(port) and int(port) < 65536)
    ):
        raise InvalidInput(
            [Diagnostic(Source("--option"), "K409", "where is the controller?", ADDRESS_HINT)]
        )
    return ControllerAddress(command, host, int(port or 0))


def patience_of(options: Mapping[str, str]) -> Patience:
    """How long the controller may take. Raises `InvalidInput`."""
    usual = Patience()
    try:
        begin, answer, beat, again = (
            read_decimal(options[name]) if name in options else seconds
            for name, seconds in (
                ("begin", usual.begin_s),
                ("answer", usual.answer_s),
                ("heartbeat", usual.heartbeat_s),
                ("reconnect", usual.reconnect_s),
            )
        )
    except NumberError as error:
        reason = f"a number of seconds {error}"
        raise InvalidInput(
            [Diagnostic(Source("--option"), "K406", reason, "write answer=5")]
        ) from None
    if not (0 < begin < 1e6 and 0 < answer < 1e6 and 0 < beat < 1e6 and 0 <= again < 1e6):
        raise InvalidInput(
            [Diagnostic(Source("--option"), "K406", "a time must be more than 0 s", "give seconds")]
        )
    return Patience(begin, answer, beat, again)
