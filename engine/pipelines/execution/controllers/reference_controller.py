"""Reference controller: serves the simulated cell behind the protocol, over TCP or streams.

It shows makers of controllers what is asked of one, and it lives on when a run dies, so that the
run can be resumed.
"""

import asyncio
import contextlib
import os
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from cellwright.engine.model.run_protocol import PROTOCOL_VERSION, Message, Reply
from cellwright.engine.pipelines.execution.controllers.protocol import (
    ANSWER_OF_QUESTION,
    MAX_LINE_BYTES,
    MalformedLine,
    protocol_line,
    read_commands,
    read_line,
    reply_entry,
    report_entry,
)
from cellwright.engine.pipelines.simulators import Simulator, simulated_driver
from cellwright.engine.ports import DriverSetup

BEAT_S = 0.01  # how often a real clock is looked at
CONTROLLER_NAME = "simulated cell"


@dataclass
class ServedCell:
    """The simulated cell of one run, on its own clock: a virtual one, or real time by a factor."""

    setup: DriverSetup
    simulator: Simulator | None = None
    begun: float = 0.0

    def serve(self, run: str) -> Simulator:
        """The cell of a run. Raises `MalformedLine` if it serves another."""
        if self.simulator is None:
            self.setup = replace(self.setup, run=run)
            self.simulator = simulated_driver(replace(self.setup, factor=0.0))
            self.begun = time.monotonic() - self.simulator.now_ms() * self.setup.factor / 1000
        if run != self.setup.run:
            raise MalformedLine(f"this cell serves the run {self.setup.run}")
        return self.simulator

    @property
    def virtual(self) -> bool:
        """Whether its clock jumps from event to event."""
        return not self.setup.factor

    def elapsed(self) -> list[Message]:
        """What has happened until now in real time."""
        messages: list[Message] = []
        if self.simulator is not None and not self.virtual:
            until = int((time.monotonic() - self.begun) * 1000 / self.setup.factor)
            while self.simulator.now_ms() < until:
                messages += self.simulator.receive(until)
        return messages

    def now(self) -> Simulator:
        """The cell that has been greeted. Raises `MalformedLine`."""
        if self.simulator is None:
            raise MalformedLine("say hello first")
        return self.simulator


class Conversation:
    """What one connection is answered."""

    def __init__(self, cell: ServedCell) -> None:
        self.cell = cell

    def answers(self, text: bytes) -> list[bytes]:
        """The lines that answer a line."""
        try:
            asked = read_line(text)
        except MalformedLine as error:
            return [protocol_line("refused", why=str(error))]
        try:
            return self._answers(asked)
        except MalformedLine as error:
            return [protocol_line("refused", id=asked.get("id"), why=str(error))]

    def _answers(self, asked: Mapping[str, Any]) -> list[bytes]:
        type_ = asked["type"]
        if type_ == "bye":
            return []
        if type_ not in ANSWER_OF_QUESTION:
            raise MalformedLine(f"unknown: `{type_}`")
        came, content = getattr(self, f"_{type_}")(asked)
        lines = [
            protocol_line("reply", **reply_entry(message))
            for message in came
            if isinstance(message, Reply)
        ]
        return [*lines, protocol_line(ANSWER_OF_QUESTION[type_], id=asked.get("id"), **content)]

    def _hello(self, asked: Mapping[str, Any]) -> tuple[list[Message], dict[str, Any]]:
        if asked.get("version") != PROTOCOL_VERSION:
            raise MalformedLine(f"this controller speaks version {PROTOCOL_VERSION}")
        cell = self.cell.serve(str(asked.get("run", "")))
        clock: dict[str, Any] = (
            {"clock": "virtual"} if self.cell.virtual else {"clock": "real", "tick_ms": 50}
        )
        depth = cell.lookahead("")
        return [], {
            "version": PROTOCOL_VERSION,
            "name": CONTROLLER_NAME,
            "now_ms": cell.now_ms(),
            "lookahead": {"default": depth},
            **clock,
        }

    def _send(self, asked: Mapping[str, Any]) -> tuple[list[Message], dict[str, Any]]:
        commands = read_commands(asked)
        self.cell.now().send(commands)
        return [], {"numbers": [command.number for command in commands]}

    def _advance(self, asked: Mapping[str, Any]) -> tuple[list[Message], dict[str, Any]]:
        until = asked.get("until_ms")
        if not self.cell.virtual or not (until is None or isinstance(until, int)):
            raise MalformedLine(
                "`advance` is for a virtual clock, until a whole number of milliseconds or null"
            )
        cell = self.cell.now()
        return list(cell.receive(until)), {"now_ms": cell.now_ms()}

    def _quiesce(self, asked: Mapping[str, Any]) -> tuple[list[Message], dict[str, Any]]:
        cell = self.cell.now()
        return list(cell.quiesce(int(asked.get("within_ms", 0)))), {"now_ms": cell.now_ms()}

    def _halt(self, _asked: Mapping[str, Any]) -> tuple[list[Message], dict[str, Any]]:
        self.cell.now().halt()
        return [], {}

    def _report(self, asked: Mapping[str, Any]) -> tuple[list[Message], dict[str, Any]]:
        numbers = asked.get("numbers")
        if not isinstance(numbers, list) or not all(isinstance(number, int) for number in numbers):
            raise MalformedLine("`numbers` is no list of whole numbers")
        return [], {"reports": [report_entry(report) for report in self.cell.now().report(numbers)]}

    def _ping(self, _asked: Mapping[str, Any]) -> tuple[list[Message], dict[str, Any]]:
        return [], {}


async def _answer_connection(
    cell: ServedCell, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
) -> None:
    """Answer one connection until it ends."""
    conversation = Conversation(cell)
    ticking = asyncio.create_task(_send_ticks(cell, writer))
    try:
        while text := await reader.readline():
            for answer in conversation.answers(text):
                writer.write(answer)
            await writer.drain()
    except (OSError, ValueError):
        pass
    finally:
        ticking.cancel()
        with contextlib.suppress(OSError):
            writer.close()


async def _send_ticks(cell: ServedCell, writer: asyncio.StreamWriter) -> None:
    """Send what happens in real time."""
    while True:
        await asyncio.sleep(BEAT_S)
        for message in cell.elapsed():
            if isinstance(message, Reply):
                writer.write(protocol_line("reply", **reply_entry(message)))


async def _listen_at(cell: ServedCell, host: str, port: int) -> None:
    async def converse(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await _answer_connection(cell, reader, writer)

    server = await asyncio.start_server(converse, host, port, limit=MAX_LINE_BYTES)
    for socket in server.sockets:
        address = socket.getsockname()
        sys.stderr.write(f"listens at {address[0]}:{address[1]}\n")
        sys.stderr.flush()
    async with server:
        await server.serve_forever()


async def _serve_standard_streams(cell: ServedCell) -> None:
    loop = asyncio.get_running_loop()
    reader = asyncio.StreamReader(limit=MAX_LINE_BYTES)
    source, sink = os.fdopen(os.dup(0), "rb", 0), os.fdopen(os.dup(1), "wb", 0)
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), source)
    transport, protocol = await loop.connect_write_pipe(asyncio.streams.FlowControlMixin, sink)
    await _answer_connection(cell, reader, asyncio.StreamWriter(transport, protocol, None, loop))


def serve_controller(setup: DriverSetup, host: str = "", port: int = 0) -> None:
    """Serve a simulated cell until the connection ends, or, at an address, until the process is
    ended.
    """
    cell = ServedCell(setup)
    simulated_driver(
        replace(setup, factor=0.0, options={k: v for k, v in setup.options.items() if k != "log"})
    ).close()
    asyncio.run(_listen_at(cell, host, port) if host else _serve_standard_streams(cell))
