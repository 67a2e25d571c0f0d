"""The driver for a controller in another process. Whatever the controller does, each command ends, or the loss is told.

A connection that breaks is made again within a time. Then the controller is asked what became of the commands that are open:
those that it never got are sent again under their numbers, and replies that were missed are given late.
"""

import queue
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from engine.model.execution import (
    Command,
    CommandKind,
    Fate,
    Message,
    Reply,
    Report,
    Trouble,
    TroubleKind,
)
from engine.pipelines.controllers.link import (
    Broken,
    Came,
    Connected,
    Event,
    Link,
    NoAnswer,
    Nonsense,
    Patience,
    Place,
    Silence,
)
from engine.pipelines.controllers.protocol import (
    Garbage,
    Ready,
    command_entry,
    hello,
    read_ready,
    read_reply,
    read_reports,
)
from engine.ports import DriverSetup
from kb.diagnostics import Diagnostic, InvalidInput, Source
from kb.numbers import is_count

HINT = "give --option command='PROGRAM ...' or --option address=HOST:PORT"
SETTINGS = ("command", "address", "begin", "answer", "heartbeat", "reconnect")


ATTEMPTS = 3  # for one question, each over another connection


class Lost(Exception):
    """The controller is lost for good."""


class ControllerDriver:
    """A driver that hands commands on to a controller."""

    def __init__(self, place: Place, patience: Patience, run: str) -> None:
        self._run, self._patience = run, patience
        self.link = Link(place, patience)
        self._open: dict[int, Command] = {}
        self._sent: dict[int, int] = {}  # when each open command was sent
        self._ended: set[int] = set()
        self._parts: dict[tuple[int, str], list[str]] = {}
        self._held: dict[int, Reply] = {}  # replies that came before those of commands ahead in the queue
        self._out: list[Message] = []
        self._lost = ""
        self._now, self._since = 0, time.monotonic()
        self._ready = Ready("", 0, False, 100, {})
        self._greet()

    def _greet(self) -> None:
        """Wait for the connection, and hear what the controller says of itself. Raises `InvalidInput` if there is none."""
        end = time.monotonic() + self._patience.reconnect_s + self._patience.answer_s
        try:
            self._await_connection(end)
            self._introduce()
        except (Lost, NoAnswer, Garbage) as error:
            self.close()
            said = f"the controller does not answer: {error}"
            raise InvalidInput([Diagnostic(Source("--driver"), "K425", said, HINT)]) from None

    def _introduce(self) -> None:
        answer = self.link.ask("hello", **hello(self._run))
        if answer["type"] == "refused":
            raise Garbage(f"it refuses: {answer.get('why', '')}")
        self._ready = read_ready(answer)
        self._set_clock(self._ready.now_ms)

    def _await_connection(self, end: float) -> None:
        while True:
            try:
                event = self.link.inbox.get(timeout=max(0.0, end - time.monotonic()))
            except queue.Empty:
                raise Lost("it cannot be reached") from None
            if isinstance(event, Connected):
                return
            if isinstance(event, Broken):
                raise Lost(event.why)

    def _set_clock(self, now_ms: int) -> None:
        self._now, self._since = max(self._now, now_ms), time.monotonic()

    @property
    def name(self) -> str:
        """What the controller calls itself."""
        return self._ready.name

    @property
    def tick_ms(self) -> int | None:
        """The controller's tick; None if its clock is virtual."""
        return self._ready.tick_ms

    def now_ms(self) -> int:
        """The controller's clock."""
        if self._ready.virtual:
            return self._now
        return self._now + int((time.monotonic() - self._since) * 1000)

    def lookahead(self, stream: str) -> int:
        """How many commands the controller queues for a stream."""
        depths = self._ready.lookahead
        return depths.get(stream, depths.get("default", 1))

    def send(self, commands: Sequence[Command]) -> None:
        """Send commands. Those that have ended or are open are known already."""
        fresh = [
            each for each in commands if each.number not in self._open and each.number not in self._ended
        ]
        now = self.now_ms()
        for each in fresh:
            if each.kind is not CommandKind.CONTINUE:
                self._open[each.number] = each
                self._sent[each.number] = now
        if fresh:
            self._ask("send", commands=[command_entry(each) for each in fresh])

    def receive(self, until_ms: int | None) -> Sequence[Message]:
        """What has come until a time, or within a tick."""
        self._take_in()
        if not self._out and not self._lost:
            if self._ready.virtual:
                answer = self._ask("advance", until_ms=until_ms)
                if answer is not None:
                    self._read(lambda: self._set_clock(_now(answer)))
                self._take_in()
            else:
                self._listen(until_ms)
        return self._given()

    def _given(self) -> list[Message]:
        found, self._out = self._out, []
        return found

    def _listen(self, until_ms: int | None) -> None:
        """Wait for the next line, at most a tick or until a time."""
        wait_ms = self._ready.tick_ms or 100
        if until_ms is not None:
            wait_ms = min(wait_ms, max(0, until_ms - self.now_ms()))
        try:
            self._hear(self.link.inbox.get(timeout=wait_ms / 1000))
        except queue.Empty:
            return
        self._take_in()

    def _take_in(self) -> None:
        while not self._lost:
            try:
                self._hear(self.link.inbox.get_nowait())
            except queue.Empty:
                return

    def _hear(self, event: Event) -> None:
        match event:
            case Came(content):
                self._read(lambda: self._message(content))
            case Nonsense(why):
                self._trouble(TroubleKind.GARBAGE, why)
            case Connected():
                self._resume()
            case Broken(why):
                self._lose(why)

    def _read(self, what: Callable[[], None]) -> None:
        """Do what reads a line; a line that cannot be read is garbage."""
        try:
            what()
        except Garbage as error:
            self._trouble(TroubleKind.GARBAGE, str(error))

    def _message(self, content: Mapping[str, Any]) -> None:
        match content["type"]:
            case "reply":
                reply = read_reply(content, self.now_ms())
                self._replied(
                    Reply(reply.number, reply.text, reply.at_ms, {**reply.data, **self._joined(reply.number)})
                )
            case "part":
                self._part(content)
            case _:
                raise Garbage(f"nobody asked for `{content['type']}`")

    def _part(self, content: Mapping[str, Any]) -> None:
        number, name, text = content.get("number"), content.get("name"), content.get("text")
        if not (isinstance(number, int) and isinstance(name, str) and isinstance(text, str)):
            raise Garbage("a part without number, name or text")
        if number in self._open:
            self._parts.setdefault((number, name), []).append(text)

    def _joined(self, number: int) -> dict[str, str]:
        """The data that came in parts before a reply."""
        keys = [key for key in self._parts if key[0] == number]
        return {name: "".join(self._parts.pop((number, name))) for _, name in keys}

    def _replied(self, reply: Reply) -> None:
        command = self._open.get(reply.number)
        if reply.number in self._ended:
            said = f"a second reply to command {reply.number}: {reply.text}"
            self._trouble(TroubleKind.REPEATED, said, reply.number)
        elif command is None:
            said = f"a reply to command {reply.number}, which was never sent: {reply.text}"
            self._trouble(TroubleKind.STRANGE, said, reply.number)
        elif (ahead := self._ahead(command)) is not None:
            self._held[reply.number] = reply
            said = f"a reply to command {reply.number} before that of command {ahead}, which is ahead of it"
            self._trouble(TroubleKind.STRANGE, said, reply.number)
        elif self._is_late(command, reply):
            self._close(reply.number)
            said = f"the reply came after the command was given up: {reply.text}"
            self._trouble(TroubleKind.LATE, said, reply.number)
        else:
            self._close(reply.number)
            self._out.append(reply)
            self._release(command.stream)

    def _ahead(self, command: Command) -> int | None:
        """The first open command ahead in the same queue; a device without a queue has none."""
        if self.lookahead(command.stream) < 2 or command.kind is not CommandKind.STEP:
            return None
        numbers = (
            n for n, each in sorted(self._open.items())
            if each.stream == command.stream and each.kind is CommandKind.STEP
        )  # fmt: skip
        first = next((n for n in numbers if n not in self._held), None)
        return first if first is not None and first < command.number else None

    def _release(self, stream: str) -> None:
        """Give the replies that waited for those ahead of them."""
        for number in sorted(self._held):
            command = self._open.get(number)
            if command is not None and command.stream == stream and self._ahead(command) is None:
                reply = self._held.pop(number)
                self._close(number)
                self._out.append(reply)

    def _is_late(self, command: Command, reply: Reply) -> bool:
        if command.timeout_ms is None or self.lookahead(command.stream) > 1:
            return False
        when = reply.at_ms if self._ready.virtual else self.now_ms()
        return when > self._sent[command.number] + command.timeout_ms

    def _close(self, number: int) -> None:
        self._open.pop(number, None)
        self._ended.add(number)

    def _trouble(self, kind: TroubleKind, said: str, number: int | None = None) -> None:
        self._out.append(Trouble(kind, said, self.now_ms(), number))

    def _lose(self, why: str) -> None:
        if not self._lost:
            self._lost = why or "the connection is closed"
            self._trouble(TroubleKind.LOST, self._lost)

    def _ask(self, type_: str, **content: Any) -> dict[str, Any] | None:
        """Ask the controller, over a connection made again if need be. None, and the loss is told, if that fails, too."""
        why = ""
        for _ in range(ATTEMPTS):
            if self._lost:
                return None
            try:
                return self.link.ask(type_, **content)
            except NoAnswer as error:
                why = str(error)
                self._come_back(error)
        self._lose(why)
        return None

    def _come_back(self, error: NoAnswer) -> None:
        """Wait until the controller is there again, and take up what is open; else it is lost."""
        end = time.monotonic() + self._patience.reconnect_s + self._patience.answer_s
        self._hang_up_on(error)
        while not self._lost:
            try:
                event = self.link.inbox.get(timeout=max(0.0, end - time.monotonic()))
            except queue.Empty:
                return self._lose(f"{error}; it did not come back")
            if not isinstance(event, Connected):
                self._hear(event)
                continue
            try:
                return self._take_up()
            except NoAnswer as again:
                self._hang_up_on(again)
        return None

    def _hang_up_on(self, error: NoAnswer) -> None:
        """Break a connection that stands but carries no answers."""
        if isinstance(error, Silence):
            self.link.broken_off()

    def _resume(self) -> None:
        """Take up what is open after the connection was made again."""
        try:
            self._take_up()
        except NoAnswer as error:
            self._come_back(error)

    def _take_up(self) -> None:
        try:
            self._introduce()
            numbers = sorted(self._open)
            found = read_reports(self.link.ask("report", numbers=numbers), self.now_ms()) if numbers else []
        except Garbage as error:
            raise Silence(str(error)) from None
        again = [
            self._open[each.number]
            for each in found
            if each.fate is Fate.UNKNOWN and each.number in self._open
        ]
        for each in found:
            if each.reply is not None and each.number in self._open:
                self._replied(each.reply)
        if again:
            self.link.ask("send", commands=[command_entry(each) for each in again])

    def quiesce(self, within_ms: int) -> Sequence[Message]:
        """Have the controller drop what is queued and bring what moves to its end."""
        self._ask("quiesce", within_ms=within_ms)
        self._take_in()
        return self._given()

    def halt(self) -> None:
        """Stop everything."""
        self._ask("halt")

    def report(self, numbers: Sequence[int]) -> Sequence[Report]:
        """What became of commands; unknown, if the controller is lost."""
        answer = self._ask("report", numbers=list(numbers))
        self._take_in()
        try:
            found = read_reports(answer, self.now_ms()) if answer is not None else []
        except Garbage as error:
            self._trouble(TroubleKind.GARBAGE, str(error))
            found = []
        known = {each.number: each for each in found}
        for each in found:
            if each.fate is Fate.ENDED:
                self._close(each.number)
            elif each.fate in (Fate.RUNNING, Fate.QUEUED) and each.number not in self._open:
                self._open[each.number] = Command(each.number, CommandKind.STEP, "", "")
                self._sent[each.number] = self.now_ms()
            elif each.fate is Fate.DROPPED:
                self._open.pop(each.number, None)
        return [known.get(number, Report(number, Fate.UNKNOWN)) for number in numbers]

    def close(self) -> None:
        """Hang up. A controller that listens lives on."""
        self.link.close()


def _now(answer: Mapping[str, Any]) -> int:
    now = answer.get("now_ms")
    if not isinstance(now, int) or isinstance(now, bool):
        raise Garbage("`advanced` does not say `now_ms`")
    return now


def external(setup: DriverSetup) -> ControllerDriver:
    """The driver for the controller that the options name. Raises `InvalidInput`."""
    return ControllerDriver(place_of(setup.options), patience_of(setup.options), setup.run)


def place_of(options: Mapping[str, str]) -> Place:
    """Where the controller is. Raises `InvalidInput`."""
    strange = next((each for each in options if each not in SETTINGS), None)
    if strange is not None:
        said = f"the driver `external` has no option '{strange}'"
        raise InvalidInput([Diagnostic(Source("--option"), "K406", said, f"one of {', '.join(SETTINGS)}")])
    command, address = options.get("command", ""), options.get("address", "")
    host, _, port = address.rpartition(":")
    if bool(command) == bool(address) or (address and not (host and is_count(port) and int(port) < 65536)):
        raise InvalidInput([Diagnostic(Source("--option"), "K409", "where is the controller?", HINT)])
    return Place(command, host, int(port or 0))


def patience_of(options: Mapping[str, str]) -> Patience:
    """How long the controller may take. Raises `InvalidInput`."""
    usual = Patience()
    try:
        begin = float(options.get("begin", usual.begin_s))
        answer = float(options.get("answer", usual.answer_s))
        beat = float(options.get("heartbeat", usual.heartbeat_s))
        again = float(options.get("reconnect", usual.reconnect_s))
    except ValueError as error:
        raise InvalidInput(
            [Diagnostic(Source("--option"), "K406", f"no number of seconds: {error}", "5")]
        ) from None
    if not (0 < begin < 1e6 and 0 < answer < 1e6 and 0 < beat < 1e6 and 0 <= again < 1e6):
        raise InvalidInput(
            [Diagnostic(Source("--option"), "K406", "a time must be more than 0 s", "give seconds")]
        )
    return Patience(begin, answer, beat, again)
