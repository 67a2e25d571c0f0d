"""Supervision of a run by a person: its events on the display, commands from keys and the
socket.
"""

import contextlib
import json
import os
import select
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cellwright.engine.faces.cli.output.terminal_console import make_console, say_on_stderr
from cellwright.engine.faces.cli.process.process_limits import current_watch
from cellwright.engine.faces.cli.process.progress_line import hushing_progress
from cellwright.engine.formats import report
from cellwright.engine.model.run_protocol import OperatorCommand, RecordKind
from cellwright.engine.pipelines import execution
from cellwright.kb.diagnostics import escape_controls

if TYPE_CHECKING:
    from cellwright.engine.model.run_protocol import JournalRecord
    from cellwright.engine.pipelines.execution.run_journal import Watcher


class RunSupervision:
    """What watches a run from this process: its events, and the orders of the terminal (Ctrl-C) and
    of the socket.

    A display of a run that is taken up again begins with the records `before`.
    """

    def __init__(
        self,
        run: str,
        store: str,
        events: str,
        approve: bool,
        shown: bool = False,
        factor: float = 0.0,
        before: "Sequence[JournalRecord]" = (),
    ) -> None:
        self.channel: execution.OrderChannel = execution.OrderChannel(run, store)
        self._events, self._approve, self._run = events, approve, run
        self._state: dict[str, Any] = {"run": run, "phase": "ready", "at_ms": 0}
        self._out: Any = None
        self._before: Any = None
        self._presses = 0
        self._shown, self._factor, self._past = shown, factor, before
        self._display = ExitStack()
        self._look: list[Watcher] = []

    @property
    def watchers(self) -> "Sequence[Watcher]":
        """What is shown each record once it is on the disk."""
        return [self._follow, self.channel.watch, *self._look]

    def __enter__(self) -> "RunSupervision":
        self.channel.__enter__()
        self.channel.tells(lambda: self._state)
        if self._events:
            self._out = (
                sys.stdout
                if self._events == "-"
                else Path(self._events).open("w", encoding="utf-8")
            )
        self._before = signal.signal(signal.SIGINT, self._pressed)
        if self._shown or self._approve or self._events == "-":
            self._display.enter_context(hushing_progress())
        if watch := current_watch():
            watch.waiting, watch.time_is_up = True, self._stop
        if self._shown:
            seen = watch_records(self._run, self._tell, self._factor, self._past)
            self._look.append(self._display.enter_context(seen))
        return self

    def _tell(self, order: str) -> None:
        self.channel.give(execution.GivenOrder(OperatorCommand(order), "", "terminal"))

    def __exit__(self, *error: object) -> None:
        self._display.close()
        signal.signal(signal.SIGINT, self._before)
        if watch := current_watch():
            watch.waiting = False
        if self._out is not None and self._events != "-":
            self._out.close()
        self.channel.__exit__(None, None, None)

    def _stop(self) -> None:
        self.channel.give(execution.GivenOrder(OperatorCommand.STOP, "", "time limit"))

    def _pressed(self, *_: object) -> None:
        """The first Ctrl-C interrupts, the second stops."""
        self._presses += 1
        self.channel.give(
            execution.GivenOrder(
                OperatorCommand.INTERRUPT if self._presses == 1 else OperatorCommand.STOP,
                "",
                "terminal",
            )
        )
        key_help = "pauses at the end of the current goal; Ctrl-C again stops at once; "
        sys.stderr.write(
            f"\n{key_help}go on with: cellwright continue {self._run}\n"
            if self._presses == 1
            else "\nstops\n"
        )

    def _follow(self, record: "JournalRecord") -> None:
        self._state["at_ms"] = record.at_ms
        if record.kind is RecordKind.PHASE:
            self._state["phase"] = record.content["phase"]
        if record.kind is RecordKind.PLAN:
            self._state["phase"] = "running"
            if self._approve and record.content["why"] == "first":
                self._ask(record)
        if self._out is not None:
            self._write(record)

    def _write(self, record: "JournalRecord") -> None:
        """Write an event. If nobody reads any more, or the disk is full, the run goes on
        without: its journal has all.
        """
        try:
            self._out.write(
                escape_controls(json.dumps(record.entry(self._run), ensure_ascii=False)) + "\n"
            )
            self._out.flush()
        except OSError as error:
            sys.stderr.write(f"no more events: {error.strerror}; the run goes on\n")
            if self._events == "-":
                sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 - what else is told is lost
            self._out = None

    def _ask(self, record: "JournalRecord") -> None:
        """Show the plan, and ask the person at the terminal; without one, somebody else has to
        approve it.
        """
        for step in record.content["steps"]:
            start, lasts = step.get("start_ms", 0) / 1000, step.get("lasts_ms", 0) / 1000
            say_on_stderr(
                f"{start:>10.1f} s {lasts:>8.1f} s  {step['stream']:<16} {step['step']}\n"
            )
        if not sys.stdin.isatty():
            sys.stderr.write(f"waits for: cellwright approve {self._run}\n")
            return
        sys.stderr.write("carry this out? [y/n] ")
        sys.stderr.flush()
        answer_line = sys.stdin.readline().strip().lower()
        self.channel.give(
            execution.GivenOrder(
                OperatorCommand.APPROVE if answer_line in ("y", "yes") else OperatorCommand.ABORT,
                "",
                "terminal",
            )
        )


FRAMES = 8  # a second
Give = Callable[[str], None]  # gives an order by its name


def print_record(record: "JournalRecord") -> None:
    """Print what a record tells, on standard error."""
    for line in report.narrate_record(record):
        say_on_stderr(f"{line}\n")


@contextlib.contextmanager
def watch_records(
    run: str, give: Give, factor: float, before: "Sequence[JournalRecord]" = ()
) -> "Iterator[Callable[[JournalRecord], None]]":
    """A watcher for the records of a run: a live display on a terminal if its clock is slowed down,
    else plain lines.

    At full speed there is nothing to watch: a display would be gone before it is read. The display
    of a run that is taken up again begins with the records `before`.
    """
    if not (factor and sys.stderr.isatty() and sys.stdin.isatty()):
        yield print_record
        return
    from rich.live import Live

    came = [time.monotonic()]
    display = report.RunDisplay(run, passed_ms=lambda: (time.monotonic() - came[0]) * 1000 / factor)
    for record in before:
        display.take(record)
    live = Live(display, console=make_console(stderr=True), refresh_per_second=FRAMES)
    keys = TerminalKeys(lambda key: _handle_key(key, display, live, give))

    def follow(record: "JournalRecord") -> None:
        came[0] = time.monotonic()
        display.take(record)
        if not live.is_started:
            print_record(record)

    with keys, live:
        yield follow


def _handle_key(key: str, display: Any, live: Any, give: Give) -> None:
    match key:
        case "p":
            give(display.toggled())
        case "i":
            give("interrupt")
        case "s":
            give("stop")
        case "q":
            live.stop()
        case _:
            pass


class TerminalKeys:
    """Reads single keys from the terminal while it is entered, and leaves the terminal as it
    was.
    """

    def __init__(self, press: Callable[[str], None]) -> None:
        self._press = press
        self._over = threading.Event()
        self._before: Any = None

    def __enter__(self) -> "TerminalKeys":
        import termios
        import tty

        self._before = termios.tcgetattr(sys.stdin)
        tty.setcbreak(sys.stdin)
        threading.Thread(target=self._read, daemon=True).start()
        return self

    def __exit__(self, *error: object) -> None:
        import termios

        self._over.set()
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._before)

    def _read(self) -> None:
        while not self._over.is_set():
            if select.select([sys.stdin], [], [], 1 / FRAMES)[0]:
                self._press(sys.stdin.read(1))
