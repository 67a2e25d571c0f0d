"""Progress line of a command that takes longer than two seconds: what it does and for how long.

A thread writes it, so that it also moves while a solver or a file keeps the command busy. Nothing
is written in a pipe.
"""

import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

LINE_DELAY_S = 2.0  # until the line appears
PACE_S = 0.5
STOPPABLE = "Ctrl-C stops with the best so far, --time-limit N by itself"
DOING = {
    "cell": ("looking at the cell", "Ctrl-C ends it"),
    "check": ("checking", "--no-reach leaves out what arms reach"),
    "diagnose": ("comparing tests", "--expansions N compares fewer"),
    "explain": ("looking for changes that allow a plan", "--expansions N tries fewer"),
    "handey": ("planning with the scene", "Ctrl-C ends it"),
    "import": ("reading the file", "Ctrl-C ends it"),
    "measurement": ("measuring", "Ctrl-C ends it"),
    "motion": ("looking for motions", "Ctrl-C ends it"),
    "motion plan": ("looking for a motion", "--budget N and --bridges 0 look at less"),
    "place": ("looking for the part and its way", "Ctrl-C ends it"),
    "plan": ("planning", STOPPABLE),
    "prepare": ("planning", STOPPABLE),
    "resume": ("the run goes on", "Ctrl-C pauses it"),
    "revise": ("revising", STOPPABLE),
    "run": ("planning and running", "--watch shows how it goes; Ctrl-C pauses"),
    "schedule": ("scheduling", STOPPABLE),
    "sequence": ("sequencing", STOPPABLE),
    "states": ("generating contact states", "--reduced PART takes some parts alone"),
    "test": ("planning every problem", "name one problem for less"),
    "validate": ("checking the plan", "Ctrl-C ends it"),
}
SILENT = ("driver", "lsp", "monitor")  # they wait for others, for as long as they are wanted


class ProgressLine:
    """The line of one command. `news` is told behind the time."""

    def __init__(self, verb: str, patience_s: float = LINE_DELAY_S) -> None:
        own = DOING.get(verb) or DOING.get(verb.partition(" ")[0])
        self.doing, self.less = own or ("working", "Ctrl-C ends it")
        self.news = ""
        self._began, self._patience_s = time.monotonic(), patience_s
        self._over, self._pen = threading.Event(), threading.RLock()
        self._hushed, self._shown = 0, False

    def start(self) -> None:
        """Begin to look at the clock."""
        threading.Thread(target=self._run, name="progress", daemon=True).start()

    def end(self) -> None:
        """Take the line away, for good."""
        with self._pen:
            self._over.set()
            self._clear()

    @contextmanager
    def hushed(self) -> Iterator[None]:
        """A context without the line, because something else is written, or a person is asked."""
        with self._pen:
            self._hushed += 1
            self._clear()
        try:
            yield
        finally:
            with self._pen:
                self._hushed -= 1

    def text(self, columns: int) -> str:
        """The line as it is now, cut so that it fits."""
        line_text = f"{self.doing}, {time.monotonic() - self._began:.0f} s{self.news}; {self.less}"
        return line_text[: columns - 1]

    def _run(self) -> None:
        if self._over.wait(self._patience_s):
            return
        while not self._over.is_set():
            with self._pen:
                if not (self._over.is_set() or self._hushed):
                    self._shown = True
                    write_past_buffers(f"\r{self.text(_terminal_columns())}\x1b[K")
            self._over.wait(PACE_S)

    def _clear(self) -> None:
        if self._shown:
            self._shown = False
            write_past_buffers("\r\x1b[K")


_line: ProgressLine | None = None


@contextmanager
def showing_progress(verb: str) -> Iterator[None]:
    """A context in which a slow command tells what it does, if standard error is a terminal."""
    global _line
    if verb.partition(" ")[0] in SILENT or not _is_terminal():
        yield
        return
    _line = shown_line = ProgressLine(verb)
    shown_line.start()
    try:
        yield
    finally:
        shown_line.end()
        _line = None


@contextmanager
def hushing_progress() -> Iterator[None]:
    """A context in which no line of progress is written."""
    if _line is None:
        yield
        return
    with _line.hushed():
        yield


def clear_progress() -> None:
    """Take the line away: the answer comes."""
    if _line is not None:
        _line.end()


def tell_progress(news: str) -> None:
    """Say behind the time what is new."""
    if _line is not None:
        _line.news = f", {news}"


def _is_terminal() -> bool:
    try:
        return os.isatty(2)
    except OSError:
        return False


def _terminal_columns() -> int:
    try:
        return os.get_terminal_size(2).columns or 80
    except OSError:
        return 80


def write_past_buffers(text: str) -> None:
    """Write past all buffers: what is lost is no answer."""
    with suppress(OSError):
        os.write(2, text.encode("utf-8", "replace"))
