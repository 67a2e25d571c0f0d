"""Interruption of a search by Ctrl-C, a request to end or the time limit; its news meanwhile."""

import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType, TracebackType
from typing import TYPE_CHECKING, Any

from cellwright.engine.faces.cli.process import progress_line
from cellwright.engine.faces.cli.process.process_limits import current_watch
from cellwright.engine.model.noun_wording import count_noun
from cellwright.kb import stopping

if TYPE_CHECKING:
    from cellwright.kb.model.domain_model import Domain
    from cellwright.kb.model.plan_model import Plan


class SearchInterruption:
    """A context in which the first Ctrl-C asks the search to stop with its best answer; the second
    stops everything.

    A request to terminate (SIGTERM), as from a batch system, works like Ctrl-C: it gets the best
    answer so far.

    A search calls it now and then; it returns whether to stop. `seconds` is the time limit, counted
    from the begin of the command.
    """

    def __init__(self, seconds: float | None = None) -> None:
        self.started = time.monotonic()
        self.deadline = self.started + seconds if seconds is not None else None
        if seconds is not None and (watch := current_watch()) and watch.seconds == seconds:
            self.deadline = watch.deadline  # the limit counts from the begin of the command
        self.heard = self.waiting = self.told = False
        self._before: dict[signal.Signals, Callable[[int, FrameType | None], Any] | int | None] = {}

    def __enter__(self) -> "SearchInterruption":
        self._asking = stopping.asking_to_stop(self._while_grounding)
        self._asking.__enter__()
        self._before = {
            signal_number: signal.signal(signal_number, self._hear)
            for signal_number in (signal.SIGINT, signal.SIGTERM)
        }
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._asking.__exit__(kind, value, trace)
        for signal_number, before in self._before.items():
            signal.signal(signal_number, before)

    def __call__(self) -> bool:
        stop = self._is_over()
        if stop:
            self.told = True
            if watch := current_watch():
                watch.heard = True
        return stop

    def _is_over(self) -> bool:
        return self.heard or (self.deadline is not None and time.monotonic() >= self.deadline)

    def _while_grounding(self) -> bool:
        """Whether a grounding shall stop: not once a search has been told to, because its
        answer is still to be checked.
        """
        return not self.told and self._is_over()

    def tell(self, plan: "Plan", domain: "Domain") -> None:
        """Report a better plan for a problem of a domain on standard error."""
        from cellwright.engine.model.task_costs import cost_text

        seconds, cost = time.monotonic() - self.started, cost_text(plan.cost, domain)
        with progress_line.hushing_progress():
            _say_on_stderr(
                f"{count_noun(len(plan.steps), 'step')}, cost {cost}, after {seconds:.1f} s\n"
            )

    def tell_cost(self, cost: int) -> None:
        """Show the cost of the best tour so far in the line of progress."""
        progress_line.tell_progress(f"best cost {cost}")

    @contextmanager
    def while_waiting(self) -> Iterator[None]:
        """A context that waits for a person instead of searching: Ctrl-C ends it at once with
        `KeyboardInterrupt`.
        """
        self.waiting = True
        if watch := current_watch():
            watch.waiting = True
        try:
            with progress_line.hushing_progress():
                yield
        except KeyboardInterrupt:
            self.heard = True
            raise
        finally:
            self.waiting = False
            if watch:
                watch.waiting = False

    def _hear(self, _signal: int, _frame: FrameType | None) -> None:
        if self.heard or self.waiting:
            raise KeyboardInterrupt
        self.heard = True


def _say_on_stderr(text: str) -> None:
    """Write on standard error. If that fails, the answer is still given."""
    with suppress(OSError):
        sys.stderr.write(text)
        sys.stderr.flush()
