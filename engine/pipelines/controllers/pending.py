"""The commands that a controller has and has not answered, and what it says about them: in order, once, and in time."""

from collections.abc import Callable, Mapping, MutableSet, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from cellwright.engine.model.execution import (
    Command,
    CommandKind,
    Fate,
    Message,
    Reply,
    Report,
    Trouble,
    TroubleKind,
)
from cellwright.engine.model.number_set import NumberSet
from cellwright.engine.pipelines.controllers.protocol import Garbage


@dataclass
class Pending:
    """What is open at a controller. `lookahead` says how many commands a stream queues; `virtual` is its clock.

    `out` are the messages that are to be given to the executive.
    """

    lookahead: Callable[[str], int]
    virtual: bool = False
    open: dict[int, Command] = field(default_factory=dict)
    out: list[Message] = field(default_factory=list)
    _sent: dict[int, int] = field(default_factory=dict)  # when each open command was sent
    _ended: MutableSet[int] = field(default_factory=NumberSet)
    _parts: dict[tuple[int, str], list[str]] = field(default_factory=dict)
    _held: dict[int, Reply] = field(default_factory=dict)  # came before those of commands ahead in the queue

    def fresh(self, commands: Sequence[Command], now_ms: int) -> list[Command]:
        """The commands that have neither ended nor been sent; they are open from now on."""
        found = [each for each in commands if each.number not in self.open and each.number not in self._ended]
        for each in found:
            if each.kind is not CommandKind.CONTINUE:
                self.open[each.number] = each
                self._sent[each.number] = now_ms
        return found

    def given(self) -> list[Message]:
        """The messages that have come since the last call."""
        found, self.out = self.out, []
        return found

    def told(self, reports: Sequence[Report], now_ms: int) -> None:
        """Take in what the controller says became of commands."""
        for each in reports:
            if each.fate is Fate.ENDED:
                self.close(each.number)
            elif each.fate in (Fate.RUNNING, Fate.QUEUED) and each.number not in self.open:
                self.open[each.number] = Command(each.number, CommandKind.STEP, "", "")
                self._sent[each.number] = now_ms
            elif each.fate is Fate.DROPPED:
                self.open.pop(each.number, None)

    def part(self, content: Mapping[str, Any]) -> None:
        """Take in a piece of bulk data. Raises `Garbage`."""
        number, name, text = content.get("number"), content.get("name"), content.get("text")
        if not (isinstance(number, int) and isinstance(name, str) and isinstance(text, str)):
            raise Garbage("a part without number, name or text")
        if number in self.open:
            self._parts.setdefault((number, name), []).append(text)

    def _joined(self, number: int) -> dict[str, str]:
        """The data that came in parts before a reply."""
        keys = [key for key in self._parts if key[0] == number]
        return {name: "".join(self._parts.pop((number, name))) for _, name in keys}

    def replied(self, reply: Reply, now_ms: int) -> None:
        """Take in a reply with the pieces that came before it; one that cannot be is told as trouble."""
        reply = replace(reply, data={**reply.data, **self._joined(reply.number)})
        command = self.open.get(reply.number)
        if reply.number in self._ended:
            said = f"a second reply to command {reply.number}: {reply.text}"
            self._trouble(now_ms, TroubleKind.REPEATED, said, reply.number)
        elif command is None:
            said = f"a reply to command {reply.number}, which was never sent: {reply.text}"
            self._trouble(now_ms, TroubleKind.STRANGE, said, reply.number)
        elif (ahead := self._ahead(command)) is not None:
            self._held[reply.number] = reply
            said = f"a reply to command {reply.number} before that of command {ahead}, which is ahead of it"
            self._trouble(now_ms, TroubleKind.STRANGE, said, reply.number)
        elif self._is_late(command, reply, now_ms):
            self.close(reply.number)
            said = f"the reply came after the command was given up: {reply.text}"
            self._trouble(now_ms, TroubleKind.LATE, said, reply.number)
        else:
            self.close(reply.number)
            self.out.append(reply)
            self._release(command.stream)

    def _ahead(self, command: Command) -> int | None:
        """The first open command ahead in the same queue; a device without a queue has none."""
        if self.lookahead(command.stream) < 2 or command.kind is not CommandKind.STEP:
            return None
        numbers = (
            n for n, each in sorted(self.open.items())
            if each.stream == command.stream and each.kind is CommandKind.STEP
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

    def _is_late(self, command: Command, reply: Reply, now_ms: int) -> bool:
        if command.timeout_ms is None or self.lookahead(command.stream) > 1:
            return False
        when = reply.at_ms if self.virtual else now_ms
        return when > self._sent[command.number] + command.timeout_ms

    def close(self, number: int) -> None:
        """A command has ended."""
        self.open.pop(number, None)
        self._ended.add(number)

    def _trouble(self, now_ms: int, kind: TroubleKind, said: str, number: int) -> None:
        self.out.append(Trouble(kind, said, now_ms, number))
