"""The driver for a controller in another process. Whatever the controller does, each command ends, or the loss is told.

A connection that breaks is made again within a time. Then the controller is asked what became of the commands that are open:
those that it never got are sent again under their numbers, and replies that were missed are given late.
"""

import queue
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from cellwright.engine.model.execution import Command, Fate, Message, Report, Trouble, TroubleKind
from cellwright.engine.pipelines.controllers.link import (
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
from cellwright.engine.pipelines.controllers.pending import Pending
from cellwright.engine.pipelines.controllers.protocol import (
    Garbage,
    Ready,
    command_entry,
    hello,
    read_ready,
    read_reply,
    read_reports,
)
from cellwright.engine.pipelines.controllers.settings import HINT, patience_of, place_of
from cellwright.engine.ports import DriverSetup
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source

ATTEMPTS = 3  # for one question, each over another connection


class Lost(Exception):
    """The controller is lost for good."""


class ControllerDriver:
    """A driver that hands commands on to a controller."""

    def __init__(self, place: Place, patience: Patience, run: str) -> None:
        self._run, self._patience = run, patience
        self.link = Link(place, patience)
        self._pending = Pending(self.lookahead)
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
        self._pending.virtual = self._ready.virtual
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
        fresh = self._pending.fresh(commands, self.now_ms())
        if fresh:
            self._ask("send", commands=[command_entry(each) for each in fresh])

    def receive(self, until_ms: int | None) -> Sequence[Message]:
        """What has come until a time, or within a tick."""
        self._take_in()
        if not self._pending.out and not self._lost:
            if self._ready.virtual:
                answer = self._ask("advance", until_ms=until_ms)
                if answer is not None:
                    self._read(lambda: self._set_clock(_now(answer)))
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
                self._pending.replied(read_reply(content, self.now_ms()), self.now_ms())
            case "part":
                self._pending.part(content)
            case _:
                raise Garbage(f"nobody asked for `{content['type']}`")

    def _trouble(self, kind: TroubleKind, said: str) -> None:
        self._pending.out.append(Trouble(kind, said, self.now_ms()))

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
            numbers = sorted(self._pending.open)
            found = read_reports(self.link.ask("report", numbers=numbers), self.now_ms()) if numbers else []
        except Garbage as error:
            raise Silence(str(error)) from None
        again = [
            self._pending.open[each.number]
            for each in found
            if each.fate is Fate.UNKNOWN and each.number in self._pending.open
        ]
        for each in found:
            if each.reply is not None and each.number in self._pending.open:
                self._pending.replied(each.reply, self.now_ms())
        if again:
            self.link.ask("send", commands=[command_entry(each) for each in again])

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
            found = read_reports(answer, self.now_ms()) if answer is not None else []
        except Garbage as error:
            self._trouble(TroubleKind.GARBAGE, str(error))
            found = []
        known = {each.number: each for each in found if each.number in numbers}
        self._pending.told(tuple(known.values()), self.now_ms())
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
