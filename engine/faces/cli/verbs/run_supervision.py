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
from cellwright.engine.faces.cli.process.exit_codes import INTERRUPTED, STOPPED
from cellwright.engine.faces.cli.process.process_limits import current_watch, is_own_process
from cellwright.engine.faces.cli.process.progress_line import hushing_progress, write_past_buffers
from cellwright.engine.faces.cli.process.service_manager import notify_service
from cellwright.engine.formats import report
from cellwright.engine.model.run_protocol import OperatorCommand, RecordKind
from cellwright.engine.pipelines import execution
from cellwright.kb import stopping
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
        self._before: dict[signal.Signals, Any] = {}
        self._asking = ExitStack()
        self._presses = self._requests = 0
        self._is_ending, self._over = False, threading.Event()
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
        self._hear_signals()
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
        self._over.set()
        with contextlib.suppress(OSError):  # the terminal may be gone
            self._display.close()
        for signal_number, before in self._before.items():
            # only the ending is left to be told, so a late request to end is passed over
            signal.signal(signal_number, signal.SIG_IGN if is_own_process() else before)
        self._asking.close()
        if watch := current_watch():
            watch.waiting = False
        if self._out is not None and self._events != "-":
            with contextlib.suppress(OSError):
                self._out.close()
        self.channel.__exit__(None, None, None)

    def is_ending(self) -> bool:
        """Whether the process was told to end: nothing is planned any more then."""
        return self._is_ending

    def _hear_signals(self) -> None:
        """Hear Ctrl-C, and requests to end; not a hang-up that whoever started us has shut out."""
        heard: dict[signal.Signals, Callable[..., None]] = {
            signal.SIGINT: self._pressed,
            signal.SIGTERM: self._asked_to_end,
        }
        if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
            heard[signal.SIGHUP] = self._asked_to_end
        for signal_number, handler in heard.items():
            self._before[signal_number] = signal.signal(signal_number, handler)
        before = stopping.current_question()
        question = stopping.asking_to_stop(lambda: self._is_ending or before())
        self._asking.enter_context(question)

    def _asked_to_end(self, signal_number: int, _frame: object) -> None:
        """The first request to end has motions come to their end, the second one halts at once."""
        self._requests += 1
        name = signal.Signals(signal_number).name
        order = OperatorCommand.REST if self._requests == 1 else OperatorCommand.STOP
        self.channel.give(execution.GivenOrder(order, name, "signal"))
        self._end_in_time()
        write_past_buffers(f"\n{name}: the run comes to rest; a second one stops at once\n")

    def _end_in_time(self) -> None:
        """Have planning end, and the process as well, should it not come to rest in time."""
        if not self._is_ending:
            self._is_ending = True
            notify_service("STOPPING=1")
            threading.Thread(target=self._end_when_stuck, daemon=True).start()

    def _end_when_stuck(self) -> None:
        if not self._over.wait(execution.REST_MS / 1000 + STUCK_S):
            os._exit(STOPPED if execution.halt_open_drivers() else INTERRUPTED)

    def _stop(self) -> None:
        self.channel.give(execution.GivenOrder(OperatorCommand.STOP, "", "time limit"))

    def _pressed(self, *_: object) -> None:
        """The first Ctrl-C interrupts, the second stops."""
        self._presses += 1
        order = OperatorCommand.INTERRUPT if self._presses == 1 else OperatorCommand.STOP
        self.channel.give(execution.GivenOrder(order, "", "terminal"))
        if self._presses > 1:
            self._end_in_time()
        key_help = "pauses at the end of the current goal; Ctrl-C again stops at once; "
        write_past_buffers(
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
            notify_service(f"READY=1\nSTATUS=run {self._run}")
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
            write_past_buffers(f"no more events: {error.strerror}; the run goes on\n")
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
            write_past_buffers(f"waits for: cellwright approve {self._run}\n")
            return
        write_past_buffers("carry this out? [y/n] ")
        while not select.select([sys.stdin], [], [], 1 / FRAMES)[0]:
            if self._is_ending:
                return
        answer_line = sys.stdin.readline().strip().lower()
        self.channel.give(
            execution.GivenOrder(
                OperatorCommand.APPROVE if answer_line in ("y", "yes") else OperatorCommand.ABORT,
                "",
                "terminal",
            )
        )


FRAMES = 8  # a second
STUCK_S = 3.0  # beyond the time for motions until a run that has not come to rest is ended by force
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
        with contextlib.suppress(termios.error):  # the terminal may be gone
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._before)

    def _read(self) -> None:
        while not self._over.is_set():
            if select.select([sys.stdin], [], [], 1 / FRAMES)[0]:
                key = sys.stdin.read(1)
                if not key:  # the terminal is gone
                    return
                self._press(key)
