"""Driver for a controller in another process, and the commands it has not answered yet.

A connection that breaks is made again within a time. Then the controller is asked what became of
the commands that are open: those that it never got are sent again under their numbers, and replies
that were missed are given late.
"""

import queue
import time
from collections.abc import Callable, Mapping, MutableSet, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from cellwright.engine.model.run_protocol import (
    CommandKind,
    DriverCommand,
    Fate,
    Message,
    NumberSet,
    Reply,
    Report,
    Trouble,
    TroubleKind,
)
from cellwright.engine.pipelines.execution.controllers.link import (
    ADDRESS_HINT,
    ConnectionBroken,
    ControllerAddress,
    ControllerConnected,
    ControllerLink,
    Event,
    MessageCame,
    NoAnswer,
    NoTimelyAnswer,
    Patience,
    UnreadableLine,
    patience_of,
    place_of,
)
from cellwright.engine.pipelines.execution.controllers.protocol import (
    ControllerReady,
    MalformedLine,
    command_entry,
    hello_content,
    read_ready,
    read_reply,
    read_reports,
)
from cellwright.engine.ports import DriverSetup
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source


@dataclass
class PendingCommands:
    """What is open at a controller. `lookahead` says how many commands a stream queues; `virtual`
    is its clock.

    `out` are the messages that are to be given to the executive.
    """

    lookahead: Callable[[str], int]
    virtual: bool = False
    open: dict[int, DriverCommand] = field(default_factory=dict)
    out: list[Message] = field(default_factory=list)
    _sent: dict[int, int] = field(default_factory=dict)  # when each open command was sent
    _ended: MutableSet[int] = field(default_factory=NumberSet)
    _parts: dict[tuple[int, str], list[str]] = field(default_factory=dict)
    # came before those of commands ahead in the queue
    _held: dict[int, Reply] = field(default_factory=dict)

    def fresh(self, commands: Sequence[DriverCommand], now_ms: int) -> list[DriverCommand]:
        """The commands that have neither ended nor been sent; they are open from now on."""
        fresh_commands = [
            command
            for command in commands
            if command.number not in self.open and command.number not in self._ended
        ]
        for command in fresh_commands:
            if command.kind is not CommandKind.CONTINUE:
                self.open[command.number] = command
                self._sent[command.number] = now_ms
        return fresh_commands

    def given(self) -> list[Message]:
        """The messages that have come since the last call."""
        replies, self.out = self.out, []
        return replies

    def told(self, reports: Sequence[Report], now_ms: int) -> None:
        """Take in what the controller says became of commands."""
        for report in reports:
            if report.fate is Fate.ENDED:
                self.close(report.number)
            elif report.fate in (Fate.RUNNING, Fate.QUEUED) and report.number not in self.open:
                self.open[report.number] = DriverCommand(report.number, CommandKind.STEP, "", "")
                self._sent[report.number] = now_ms
            elif report.fate is Fate.DROPPED:
                self.open.pop(report.number, None)

    def part(self, content: Mapping[str, Any]) -> None:
        """Take in a piece of bulk data. Raises `MalformedLine`."""
        number, name, text = content.get("number"), content.get("name"), content.get("text")
        if not (isinstance(number, int) and isinstance(name, str) and isinstance(text, str)):
            raise MalformedLine("a part without number, name or text")
        if number in self.open:
            self._parts.setdefault((number, name), []).append(text)

    def _joined(self, number: int) -> dict[str, str]:
        """The data that came in parts before a reply."""
        keys = [key for key in self._parts if key[0] == number]
        return {name: "".join(self._parts.pop((number, name))) for _, name in keys}

    def replied(self, reply: Reply, now_ms: int) -> None:
        """Take in a reply with the pieces that came before it; one that cannot be is told as
        trouble.
        """
        reply = replace(reply, data={**reply.data, **self._joined(reply.number)})
        command = self.open.get(reply.number)
        if reply.number in self._ended:
            text = f"a second reply to command {reply.number}: {reply.text}"
            self._trouble(now_ms, TroubleKind.REPEATED, text, reply.number)
        elif command is None:
            text = f"a reply to command {reply.number}, which was never sent: {reply.text}"
            self._trouble(now_ms, TroubleKind.STRANGE, text, reply.number)
        elif (ahead := self._ahead(command)) is not None:
            self._held[reply.number] = reply
            text = (
                f"a reply to command {reply.number} before that of command {ahead}, which is "
                "ahead of it"
            )
            self._trouble(now_ms, TroubleKind.STRANGE, text, reply.number)
        elif self._is_late(command, reply, now_ms):
            self.close(reply.number)
            text = f"the reply came after the command was given up: {reply.text}"
            self._trouble(now_ms, TroubleKind.LATE, text, reply.number)
        else:
            self.close(reply.number)
            self.out.append(reply)
            self._release(command.stream)

    def _ahead(self, command: DriverCommand) -> int | None:
        """The first open command ahead in the same queue; a device without a queue has none."""
        if self.lookahead(command.stream) < 2 or command.kind is not CommandKind.STEP:
            return None
        numbers = (
            n for n, open_command in sorted(self.open.items())
            if open_command.stream == command.stream and open_command.kind is CommandKind.STEP
        )  # fmt: skip
        first = next((n for n in numbers if n not in self._held), None)
        return first if first is not None and first < command.number else None

    def _release(self, stream: str) -> None:
        """Give the replies that waited for those ahead of them."""
        for number in sorted(self._held):
            command = self.open.get(number)
            if command is not None and command.stream == stream and self._ahead(command) is None:
                reply = self._held.pop(number)
                self.close(number)
                self.out.append(reply)

    def _is_late(self, command: DriverCommand, reply: Reply, now_ms: int) -> bool:
        if command.timeout_ms is None or self.lookahead(command.stream) > 1:
            return False
        when = reply.at_ms if self.virtual else now_ms
        return when > self._sent[command.number] + command.timeout_ms

    def close(self, number: int) -> None:
        """A command has ended."""
        self.open.pop(number, None)
        self._ended.add(number)

    def _trouble(self, now_ms: int, kind: TroubleKind, text: str, number: int) -> None:
        self.out.append(Trouble(kind, text, now_ms, number))


MAX_ATTEMPTS = 3  # for one question, each over another connection


class ControllerLost(Exception):
    """The controller is lost for good."""


class ControllerDriver:
    """A driver that hands commands on to a controller."""

    def __init__(self, place: ControllerAddress, patience: Patience, run: str) -> None:
        self._run, self._patience = run, patience
        self.link = ControllerLink(place, patience)
        self._pending = PendingCommands(self.lookahead)
        self._lost = ""
        self._now, self._since = 0, time.monotonic()
        self._ready = ControllerReady("", 0, False, 100, {})
        self._greet()

    def _greet(self) -> None:
        """Wait for the connection, and hear what the controller says of itself.

        Raises `InvalidInput` if there is none.
        """
        end = time.monotonic() + self._patience.reconnect_s + self._patience.answer_s
        try:
            self._await_connection(end)
            self._introduce()
        except (ControllerLost, NoAnswer, MalformedLine) as error:
            self.close()
            reason = f"the controller does not answer: {error}"
            raise InvalidInput(
                [Diagnostic(Source("--driver"), "K425", reason, ADDRESS_HINT)]
            ) from None

    def _introduce(self) -> None:
        answer = self.link.ask("hello", **hello_content(self._run))
        if answer["type"] == "refused":
            raise MalformedLine(f"it refuses: {answer.get('why', '')}")
        self._ready = read_ready(answer)
        self._pending.virtual = self._ready.virtual
        self._set_clock(self._ready.now_ms)

    def _await_connection(self, end: float) -> None:
        while True:
            try:
                event = self.link.inbox.get(timeout=max(0.0, end - time.monotonic()))
            except queue.Empty:
                raise ControllerLost("it cannot be reached") from None
            if isinstance(event, ControllerConnected):
                return
            if isinstance(event, ConnectionBroken):
                raise ControllerLost(event.why)

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

    def send(self, commands: Sequence[DriverCommand]) -> None:
        """Send commands. Those that have ended or are open are known already."""
        fresh = self._pending.fresh(commands, self.now_ms())
        if fresh:
            self._ask("send", commands=[command_entry(command) for command in fresh])

    def receive(self, until_ms: int | None) -> Sequence[Message]:
        """What has come until a time, or within a tick."""
        self._take_in()
        if not self._pending.out and not self._lost:
            if self._ready.virtual:
                answer = self._ask("advance", until_ms=until_ms)
                if answer is not None:
                    self._read(lambda: self._set_clock(_controller_time(answer)))
                self._take_in()
            else:
                self._listen(until_ms)
        return self._pending.given()

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
            case MessageCame(content):
                self._read(lambda: self._message(content))
            case UnreadableLine(why):
                self._trouble(TroubleKind.GARBAGE, why)
            case ControllerConnected():
                self._resume()
            case ConnectionBroken(why):
                self._lose(why)

    def _read(self, read_answer: Callable[[], None]) -> None:
        """Do what reads a line; a line that cannot be read is garbage."""
        try:
            read_answer()
        except MalformedLine as error:
            self._trouble(TroubleKind.GARBAGE, str(error))

    def _message(self, content: Mapping[str, Any]) -> None:
        match content["type"]:
            case "reply":
                self._pending.replied(read_reply(content, self.now_ms()), self.now_ms())
            case "part":
                self._pending.part(content)
            case _:
                raise MalformedLine(f"nobody asked for `{content['type']}`")

    def _trouble(self, kind: TroubleKind, text: str) -> None:
        self._pending.out.append(Trouble(kind, text, self.now_ms()))

    def _lose(self, why: str) -> None:
        if not self._lost:
            self._lost = why or "the connection is closed"
            self._trouble(TroubleKind.LOST, self._lost)

    def _ask(self, type_: str, **content: Any) -> dict[str, Any] | None:
        """Ask the controller, over a connection made again if need be.

        None, and the loss is told, if that fails, too.
        """
        why = ""
        for _ in range(MAX_ATTEMPTS):
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
            if not isinstance(event, ControllerConnected):
                self._hear(event)
                continue
            try:
                return self._take_up()
            except NoAnswer as again:
                self._hang_up_on(again)
        return None

    def _hang_up_on(self, error: NoAnswer) -> None:
        """Break a connection that stands but carries no answers."""
        if isinstance(error, NoTimelyAnswer):
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
            numbers = sorted(self._pending.open)
            reports = (
                read_reports(self.link.ask("report", numbers=numbers), self.now_ms())
                if numbers
                else []
            )
        except MalformedLine as error:
            raise NoTimelyAnswer(str(error)) from None
        again = [
            self._pending.open[report.number]
            for report in reports
            if report.fate is Fate.UNKNOWN and report.number in self._pending.open
        ]
        for report in reports:
            if report.reply is not None and report.number in self._pending.open:
                self._pending.replied(report.reply, self.now_ms())
        if again:
            self.link.ask("send", commands=[command_entry(command) for command in again])

    def quiesce(self, within_ms: int) -> Sequence[Message]:
        """Have the controller drop what is queued and bring what moves to its end."""
        self._ask("quiesce", within_ms=within_ms)
        self._take_in()
        return self._pending.given()

    def halt(self) -> None:
        """Stop everything."""
        self._ask("halt")

    def report(self, numbers: Sequence[int]) -> Sequence[Report]:
        """What became of commands; unknown, if the controller is lost."""
        answer = self._ask("report", numbers=list(numbers))
        self._take_in()
        try:
            reports = read_reports(answer, self.now_ms()) if answer is not None else []
        except MalformedLine as error:
            self._trouble(TroubleKind.GARBAGE, str(error))
            reports = []
        known_reports = {report.number: report for report in reports if report.number in numbers}
        self._pending.told(tuple(known_reports.values()), self.now_ms())
        return [known_reports.get(number, Report(number, Fate.UNKNOWN)) for number in numbers]

    def close(self) -> None:
        """Hang up. A controller that listens lives on."""
        self.link.close()


def _controller_time(answer: Mapping[str, Any]) -> int:
    now = answer.get("now_ms")
    if not isinstance(now, int) or isinstance(now, bool):
        raise MalformedLine("`advanced` does not say `now_ms`")
    return now


def external_controller(setup: DriverSetup) -> ControllerDriver:
    """The driver for the controller that the options name. Raises `InvalidInput`."""
    return ControllerDriver(place_of(setup.options), patience_of(setup.options), setup.run)
