"""Plans that are passed on while the search continues."""

import time
from collections.abc import Callable, Iterator
from queue import SimpleQueue
from threading import Event, Thread

from unified_planning.engines import PlanGenerationResultStatus as Status
from unified_planning.engines.results import PlanGenerationResult

from cellwright.engine.kernels.cancellation import Interrupted, never
from cellwright.kb.model.plan import Plan

Solve = Callable[[Interrupted, Callable[[PlanGenerationResult], None]], PlanGenerationResult]


def until(timeout: float | None) -> Interrupted:
    """A function that returns whether `timeout` seconds have passed since this call."""
    if timeout is None:
        return never
    deadline = time.monotonic() + timeout
    return lambda: time.monotonic() >= deadline


def cheaper(tell: Callable[[Plan], None]) -> Callable[[Plan], None]:
    """A function that passes on only plans that are cheaper than all plans before."""
    costs: list[int] = []

    def better(plan: Plan) -> None:
        if not costs or plan.cost < min(costs):
            costs.append(plan.cost)
            tell(plan)

    return better


def streamed(solve: Solve, interrupted: Interrupted) -> Iterator[PlanGenerationResult]:
    """The results that `solve` reports while it works, each at once, and finally the result that it returns.

    It works in its own thread, and is asked to stop when the results are no longer read.
    """
    results: SimpleQueue[PlanGenerationResult | Exception] = SimpleQueue()
    abandoned = Event()

    def work() -> None:
        try:
            results.put(solve(lambda: abandoned.is_set() or interrupted(), results.put))
        except Exception as error:  # raised again where the results are read
            results.put(error)

    Thread(target=work, daemon=True).start()
    try:
        while isinstance(result := results.get(), PlanGenerationResult):
            yield result
            if result.status is not Status.INTERMEDIATE:
                return
        raise result
    finally:
        abandoned.set()
