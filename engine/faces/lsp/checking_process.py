"""A process that reads and checks domains for the editor; it is killed when it takes too long."""

import asyncio
import contextlib
import multiprocessing
import signal
from collections.abc import Callable, Mapping
from multiprocessing.connection import Connection

from cellwright.engine.authoring.editor_view import EditorFindings

Work = Callable[[str, tuple[str, ...], Mapping[str, str]], EditorFindings]
SPAWN_CONTEXT = multiprocessing.get_context("spawn")


class CheckingProcess:
    """A process for one kind of work, which is started when it is first needed."""

    def __init__(self, work: Work, seconds: float) -> None:
        self._work, self._seconds = work, seconds
        self._process: multiprocessing.process.BaseProcess | None = None
        self._connection: Connection | None = None

    async def ask(
        self, domain: str, edited: tuple[str, ...], unsaved: Mapping[str, str]
    ) -> EditorFindings | None:
        """What the work finds; None if it fails or takes too long. One question at a time."""
        connection = self._started()
        loop = asyncio.get_running_loop()
        try:
            connection.send((domain, edited, dict(unsaved)))
            answer = await asyncio.wait_for(
                loop.run_in_executor(None, connection.recv), self._seconds
            )
        except (TimeoutError, EOFError, OSError):
            self.stop()
            return None
        return answer if isinstance(answer, EditorFindings) else None

    def _started(self) -> Connection:
        if self._connection is None or self._process is None or not self._process.is_alive():
            self.stop()
            self._connection, child_end = SPAWN_CONTEXT.Pipe()
            self._process = SPAWN_CONTEXT.Process(
                target=_answer_questions, args=(self._work, child_end), daemon=True
            )
            self._process.start()
            child_end.close()
        assert self._connection is not None
        return self._connection

    def stop(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.join()
        if self._connection is not None:
            self._connection.close()
        self._process = self._connection = None


def _answer_questions(work: Work, connection: Connection) -> None:
    """Answer questions until nobody asks any more. A failure is an answer, too."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with contextlib.suppress(EOFError, OSError):
        while True:
            domain, edited, unsaved = connection.recv()
            try:
                answer: EditorFindings | str = work(domain, edited, unsaved)
            except Exception as error:
                answer = f"{type(error).__name__}: {error}"
            connection.send(answer)
