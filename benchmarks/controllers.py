"""Controllers with manners of their own, for the table of mishaps and for tests."""

import json
import socket
import threading
from collections.abc import Callable
from contextlib import suppress

from cellwright.engine.pipelines.execution.controllers.link import ControllerAddress
from cellwright.engine.pipelines.execution.controllers.reference_controller import (
    Conversation,
    ServedCell,
)
from cellwright.engine.ports import DriverSetup
from cellwright.kb.model.planning_problem import Problem

Lines = list[bytes]
Manners = Callable[[int, Lines], Lines | None]  # what is sent instead of some lines; None hangs up


class Server:
    """A controller in this process, whose answers go through `manners`.

    It counts the lines that it has heard.
    """

    def __init__(
        self,
        problem: Problem,
        manners: Manners = lambda _, lines: lines,
        factor: float = 0.0,
        **options: str,
    ) -> None:
        self.cell = ServedCell(DriverSetup(problem, "", 0, factor, options))
        self.manners, self.heard = manners, 0
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.place = ControllerAddress("", "127.0.0.1", self.listener.getsockname()[1])
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        with suppress(OSError):
            while True:
                line, _ = self.listener.accept()
                threading.Thread(target=self._answer, args=(line,), daemon=True).start()

    def _answer(self, line: socket.socket) -> None:
        with line, suppress(OSError):
            self._converse(line)

    def _converse(self, line: socket.socket) -> None:
        conversation = Conversation(self.cell)
        for text in line.makefile("rb"):
            self.heard += 1
            said = self.manners(self.heard, conversation.answers(text))
            if said is None:
                line.shutdown(socket.SHUT_RDWR)
                return
            line.sendall(b"".join(said))

    def close(self) -> None:
        """Hear nothing more."""
        self.listener.close()
        if self.cell.simulator is not None:
            self.cell.simulator.close()


def at_reply(number: int, instead: Callable[[bytes], Lines]) -> Manners:
    """Something else in the place of the reply to one command."""

    def is_it(text: bytes) -> bool:
        content = json.loads(text)
        return bool(content["type"] == "reply" and content["number"] == number)

    return lambda _, lines: [
        new for each in lines for new in (instead(each) if is_it(each) else [each])
    ]


def later(line: bytes) -> Lines:
    """The reply with a time far ahead."""
    return [json.dumps({**json.loads(line), "at_ms": 99_999_999}).encode() + b"\n"]


def ahead(line: bytes) -> Lines:
    """The reply to the next command, and then the right one."""
    content = json.loads(line)
    return [json.dumps({**content, "number": content["number"] + 1}).encode() + b"\n", line]
