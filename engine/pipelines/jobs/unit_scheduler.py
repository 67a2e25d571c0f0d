"""Scheduler of units over worker processes, whatever happens to these processes."""

from collections import Counter, deque
from collections.abc import Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from typing import Any, Generic, Protocol, TypeVar

from cellwright.engine.kernels.cancellation import Interrupted
from cellwright.engine.pipelines.jobs.work_units import WorkKind, WorkUnit

J = TypeVar("J")
R = TypeVar("R")

UNIT_INTERRUPTED = "interrupted"
OUT_OF_MEMORY = "out of memory"
STOP_CHECK_S = 0.2  # seconds between two looks whether to stop


class UnitWorkers(Protocol):
    """Processes that carry units out.

    `deaths` are the errors of a unit whose process has died. `patience` is how often a unit may die
    when it is alone.
    """

    deaths: tuple[type[BaseException], ...]
    patience: int

    @property
    def width(self) -> int:
        """How many units may be under way at a time."""
        ...

    def give(self, kind: WorkKind[Any, Any], unit: WorkUnit[Any]) -> Future[Any]:
        """Have a unit carried out."""
        ...

    def renew(self) -> None:
        """Replace what has died."""
        ...

    def gone(self) -> str:
        """Why nothing more can be carried out; empty as long as it can."""
        ...

    def stop(self, running: Sequence[Future[Any]]) -> None:
        """Have what runs stop, and return soon: what is not done then will never be."""
        ...


class UnitScheduler(Generic[J, R]):
    """Units on their way.

    When a process dies, nobody knows which of the units under way has killed it. All of them are
    tried again, one at a time, and one that kills its process alone `patience` times is given up.
    """

    def __init__(
        self, kind: WorkKind[J, R], units: Sequence[WorkUnit[J]], hands: UnitWorkers
    ) -> None:
        self._kind, self._hands = kind, hands
        self._todo = deque(units)
        self._suspects: deque[WorkUnit[J]] = deque()
        self._deaths: Counter[str] = Counter()
        self._running: dict[Future[R], WorkUnit[J]] = {}

    def results(self, interrupted: Interrupted) -> Generator[tuple[WorkUnit[J], R], None, None]:
        """The units with their results, as they are finished."""
        while (self._todo or self._suspects or self._running) and not (
            interrupted() or self._hands.gone()
        ):
            self._fill()
            done, _ = wait(self._running, timeout=STOP_CHECK_S, return_when=FIRST_COMPLETED)
            for future in done:
                yield from self._settled(future)
        why = self._hands.gone() or UNIT_INTERRUPTED
        if self._running:
            self._hands.stop(list(self._running))
        for future, unit in self._running.items():
            yield unit, self._late(future, unit, why)
        for unit in (*self._suspects, *self._todo):
            yield unit, self._kind.lost(unit.job, why)

    def _fill(self) -> None:
        if self._suspects:
            if not self._running:
                self._give(self._suspects.popleft())
            return
        while self._todo and len(self._running) < self._hands.width:
            self._give(self._todo.popleft())

    def _give(self, unit: WorkUnit[J]) -> None:
        try:
            self._running[self._hands.give(self._kind, unit)] = unit
        except self._hands.deaths:  # seen here first: what runs is settled by its own errors
            self._suspects.appendleft(unit)
            self._hands.renew()

    def _settled(self, future: Future[R]) -> Generator[tuple[WorkUnit[J], R], None, None]:
        alone, unit = len(self._running) == 1, self._running.pop(future)
        try:
            yield unit, future.result()
        except MemoryError:
            yield unit, self._kind.lost(unit.job, OUT_OF_MEMORY)
        except CancelledError:
            self._suspects.append(unit)
        except self._hands.deaths:
            self._deaths[unit.name] += alone
            if self._deaths[unit.name] >= self._hands.patience:
                yield (
                    unit,
                    self._kind.lost(
                        unit.job, "its process died again and again: out of memory perhaps"
                    ),
                )
            else:
                self._suspects.append(unit)
            self._hands.renew()

    def _late(self, future: Future[R], unit: WorkUnit[J], why: str) -> R:
        """The result of a unit that ran when all was stopped."""
        if not future.done() or future.cancelled() or future.exception() is not None:
            return self._kind.lost(unit.job, why)
        return future.result()
