"""The supervision of a run from this process: its events go out, orders come in from the terminal and the socket."""

import os
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cellwright.engine.faces.cli.slow import hushed
from cellwright.engine.faces.cli.watchdog import current

if TYPE_CHECKING:
    from cellwright.engine.model.execution import Record
    from cellwright.engine.pipelines.execution.recorder import Watcher


class Watching:
    """What watches a run from this process: its events, and the orders of the terminal (Ctrl-C) and of the socket.

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
        before: "Sequence[Record]" = (),
    ) -> None:
        from cellwright.engine.pipelines.execution.channel import Channel

        self.channel: Channel = Channel(run, store)
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

    def __enter__(self) -> "Watching":
        import signal

        self.channel.__enter__()
        self.channel.tells(lambda: self._state)
        if self._events:
            self._out = sys.stdout if self._events == "-" else Path(self._events).open("w", encoding="utf-8")
        self._before = signal.signal(signal.SIGINT, self._pressed)
        if self._shown or self._approve or self._events == "-":
            self._display.enter_context(hushed())
        if watch := current():
            watch.waiting, watch.time_is_up = True, self._stop
        if self._shown:
            from cellwright.engine.faces.cli.watching import watched

            seen = watched(self._run, self._tell, self._factor, self._past)
            self._look.append(self._display.enter_context(seen))
        return self

    def _tell(self, order: str) -> None:
        from cellwright.engine.model.execution import Order
        from cellwright.engine.pipelines.execution import Given

        self.channel.give(Given(Order(order), "", "terminal"))

    def __exit__(self, *error: object) -> None:
        import signal

        self._display.close()
        signal.signal(signal.SIGINT, self._before)
        if watch := current():
            watch.waiting = False
        if self._out is not None and self._events != "-":
            self._out.close()
        self.channel.__exit__(None, None, None)

    def _stop(self) -> None:
        from cellwright.engine.model.execution import Order
        from cellwright.engine.pipelines.execution import Given

        self.channel.give(Given(Order.STOP, "", "time limit"))

    def _pressed(self, *_: object) -> None:
        """The first Ctrl-C interrupts, the second stops."""
        from cellwright.engine.model.execution import Order
        from cellwright.engine.pipelines.execution import Given

        self._presses += 1
        self.channel.give(Given(Order.INTERRUPT if self._presses == 1 else Order.STOP, "", "terminal"))
        said = "pauses at the end of the current goal; Ctrl-C again stops at once; "
        sys.stderr.write(
            f"\n{said}go on with: cellwright continue {self._run}\n" if self._presses == 1 else "\nstops\n"
        )

    def _follow(self, record: "Record") -> None:
        from cellwright.engine.model.execution import RecordKind

        self._state["at_ms"] = record.at_ms
        if record.kind is RecordKind.PHASE:
            self._state["phase"] = record.content["phase"]
        if record.kind is RecordKind.PLAN:
            self._state["phase"] = "running"
            if self._approve and record.content["why"] == "first":
                self._ask(record)
        if self._out is not None:
            self._write(record)

    def _write(self, record: "Record") -> None:
        """Write an event. If nobody reads any more, or the disk is full, the run goes on without: its journal has all."""
        import json

        from cellwright.kb.diagnostics import escaped

        try:
            self._out.write(escaped(json.dumps(record.entry(self._run), ensure_ascii=False)) + "\n")
            self._out.flush()
        except OSError as error:
            sys.stderr.write(f"no more events: {error.strerror}; the run goes on\n")
            if self._events == "-":
                sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 - what else is told is lost
            self._out = None

    def _ask(self, record: "Record") -> None:
        """Show the plan, and ask the person at the terminal; without one, somebody else has to approve it."""
        from cellwright.engine.faces.cli.terminal import say
        from cellwright.engine.model.execution import Order
        from cellwright.engine.pipelines.execution import Given

        for step in record.content["steps"]:
            start, lasts = step.get("start_ms", 0) / 1000, step.get("lasts_ms", 0) / 1000
            say(f"{start:>10.1f} s {lasts:>8.1f} s  {step['stream']:<16} {step['step']}\n")
        if not sys.stdin.isatty():
            sys.stderr.write(f"waits for: cellwright approve {self._run}\n")
            return
        sys.stderr.write("carry this out? [y/n] ")
        sys.stderr.flush()
        said = sys.stdin.readline().strip().lower()
        self.channel.give(Given(Order.APPROVE if said in ("y", "yes") else Order.ABORT, "", "terminal"))
