"""The reference controller: the simulated cell behind the protocol, over TCP or the standard streams.

It shows makers of controllers what is asked of one, and it lives on when a run dies, so that the run can be resumed.
"""

import asyncio
import contextlib
import os
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from cellwright.engine.model.execution import VERSION, Message, Reply
from cellwright.engine.pipelines.controllers.protocol import (
    ANSWERS,
    LONGEST,
    Garbage,
    line,
    read_commands,
    read_line,
    reply_entry,
    report_entry,
)
from cellwright.engine.pipelines.simulator import Simulator, simulator
from cellwright.engine.ports import DriverSetup

BEAT_S = 0.01  # how often a real clock is looked at
NAME = "simulated cell"


@dataclass
class Cell:
    """The simulated cell of one run, on its own clock: a virtual one, or real time by a factor."""

    setup: DriverSetup
    simulator: Simulator | None = None
    begun: float = 0.0

    def serve(self, run: str) -> Simulator:
        """The cell of a run. Raises `Garbage` if it serves another."""
        if self.simulator is None:
            self.setup = replace(self.setup, run=run)
            self.simulator = simulator(replace(self.setup, factor=0.0))
            self.begun = time.monotonic() - self.simulator.now_ms() * self.setup.factor / 1000
        if run != self.setup.run:
            raise Garbage(f"this cell serves the run {self.setup.run}")
        return self.simulator

    @property
    def virtual(self) -> bool:
        """Whether its clock jumps from event to event."""
        return not self.setup.factor

    def elapsed(self) -> list[Message]:
        """What has happened until now in real time."""
        found: list[Message] = []
        if self.simulator is not None and not self.virtual:
            until = int((time.monotonic() - self.begun) * 1000 / self.setup.factor)
            while self.simulator.now_ms() < until:
                found += self.simulator.receive(until)
        return found

    def now(self) -> Simulator:
        """The cell that has been greeted. Raises `Garbage`."""
        if self.simulator is None:
            raise Garbage("say hello first")
        return self.simulator


class Conversation:
    """What one connection is answered."""

    def __init__(self, cell: Cell) -> None:
        self.cell = cell

    def answers(self, text: bytes) -> list[bytes]:
        """The lines that answer a line."""
        try:
            asked = read_line(text)
        except Garbage as error:
            return [line("refused", why=str(error))]
        try:
            return self._answers(asked)
        except Garbage as error:
            return [line("refused", id=asked.get("id"), why=str(error))]

    def _answers(self, asked: Mapping[str, Any]) -> list[bytes]:
        type_ = asked["type"]
        if type_ == "bye":
            return []
        if type_ not in ANSWERS:
            raise Garbage(f"unknown: `{type_}`")
        came, content = getattr(self, f"_{type_}")(asked)
        found = [line("reply", **reply_entry(each)) for each in came if isinstance(each, Reply)]
        return [*found, line(ANSWERS[type_], id=asked.get("id"), **content)]

    def _hello(self, asked: Mapping[str, Any]) -> tuple[list[Message], dict[str, Any]]:
        if asked.get("version") != VERSION:
            raise Garbage(f"this controller speaks version {VERSION}")
        cell = self.cell.serve(str(asked.get("run", "")))
        clock: dict[str, Any] = (
            {"clock": "virtual"} if self.cell.virtual else {"clock": "real", "tick_ms": 50}
        )
        depth = cell.lookahead("")
        return [], {
            "version": VERSION,
            "name": NAME,
            "now_ms": cell.now_ms(),
            "lookahead": {"default": depth},
            **clock,
        }

    def _send(self, asked: Mapping[str, Any]) -> tuple[list[Message], dict[str, Any]]:
        commands = read_commands(asked)
        self.cell.now().send(commands)
        return [], {"numbers": [each.number for each in commands]}

    def _advance(self, asked: Mapping[str, Any]) -> tuple[list[Message], dict[str, Any]]:
        until = asked.get("until_ms")
        if not self.cell.virtual or not (until is None or isinstance(until, int)):
            raise Garbage("`advance` is for a virtual clock, until a whole number of milliseconds or null")
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
        if not isinstance(numbers, list) or not all(isinstance(each, int) for each in numbers):
            raise Garbage("`numbers` is no list of whole numbers")
        return [], {"reports": [report_entry(each) for each in self.cell.now().report(numbers)]}

    def _ping(self, _asked: Mapping[str, Any]) -> tuple[list[Message], dict[str, Any]]:
        return [], {}


async def _converse(cell: Cell, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Answer one connection until it ends."""
    conversation = Conversation(cell)
    ticking = asyncio.create_task(_tick(cell, writer))
    try:
        while text := await reader.readline():
            for each in conversation.answers(text):
                writer.write(each)
            await writer.drain()
    except (OSError, ValueError):
        pass
    finally:
        ticking.cancel()
        with contextlib.suppress(OSError):
            writer.close()


async def _tick(cell: Cell, writer: asyncio.StreamWriter) -> None:
    """Send what happens in real time."""
    while True:
        await asyncio.sleep(BEAT_S)
        for each in cell.elapsed():
            if isinstance(each, Reply):
                writer.write(line("reply", **reply_entry(each)))


async def _listen(cell: Cell, host: str, port: int) -> None:
    async def converse(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await _converse(cell, reader, writer)

    server = await asyncio.start_server(converse, host, port, limit=LONGEST)
    for each in server.sockets:
        told = each.getsockname()
        sys.stderr.write(f"listens at {told[0]}:{told[1]}\n")
        sys.stderr.flush()
    async with server:
        await server.serve_forever()


async def _standard(cell: Cell) -> None:
    loop = asyncio.get_running_loop()
    reader = asyncio.StreamReader(limit=LONGEST)
    source, sink = os.fdopen(os.dup(0), "rb", 0), os.fdopen(os.dup(1), "wb", 0)
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), source)
    transport, protocol = await loop.connect_write_pipe(asyncio.streams.FlowControlMixin, sink)
    await _converse(cell, reader, asyncio.StreamWriter(transport, protocol, None, loop))


def serve(setup: DriverSetup, host: str = "", port: int = 0) -> None:
    """Serve a simulated cell until the connection ends, or, at an address, until the process is ended."""
    cell = Cell(setup)
    simulator(
        replace(setup, factor=0.0, options={k: v for k, v in setup.options.items() if k != "log"})
    ).close()
    asyncio.run(_listen(cell, host, port) if host else _standard(cell))
