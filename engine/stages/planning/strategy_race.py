"""Race of several strategies at the same time, each in its own process.

The first answer counts, and the other processes are stopped.
"""

import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from multiprocessing.connection import Connection, wait

from cellwright.engine.kernels.cancellation import never
from cellwright.engine.model.ground_task import GroundTask
from cellwright.engine.model.outcome import Found, GaveUp, Infeasible, Outcome
from cellwright.engine.stages.planning.search_control import SearchLimits, ignore_plan
from cellwright.kb.clean_process import CleanProcess
from cellwright.kb.model.plan_model import Plan
from cellwright.kb.stopping import StoppedByCaller

RACING_STRATEGIES = ("auto", "asp", "landmarks", "forward", "backward")
STOP_CHECK_PAUSE_S = 0.1  # seconds between two checks whether to stop


Planner = Callable[[GroundTask, SearchLimits], Outcome]


def race_strategies(task: GroundTask, limits: SearchLimits, plan: Planner) -> Outcome:
    """The first answer of any strategy; each strategy is run by `plan`.

    As many strategies run at a time as there are processors. Which one is first may vary. With
    `limits.thorough` all strategies run until interrupted, and the best plan of all counts.
    """
    best: Plan | None = None
    gave_up = GaveUp("no strategy ran", "time")
    with _open_lanes(task, limits, plan) as lanes:
        while lanes.fill():
            for heard in lanes.heard():
                if isinstance(heard, Infeasible) or (
                    isinstance(heard, Found) and not limits.thorough
                ):
                    return heard
                if isinstance(heard, GaveUp):
                    gave_up = heard
                    continue
                outcome = heard.plan if isinstance(heard, Found) else heard
                if best is None or (outcome.cost, len(outcome.steps)) < (
                    best.cost,
                    len(best.steps),
                ):
                    best = outcome
                    limits.improved(best)
            if limits.interrupted():
                gave_up = GaveUp("interrupted while several strategies ran", "time")
                break
    return gave_up if best is None else Found(best)


class _RaceProcesses:
    """The running processes, by the connection to each.

    Each process sends its plans and its answer.
    """

    def __init__(self, task: GroundTask, limits: SearchLimits, plan: Planner) -> None:
        self.task, self.plan = task, plan
        self.limits = replace(limits, interrupted=never, improved=ignore_plan)
        self.waiting = list(RACING_STRATEGIES)
        self.running: dict[Connection, CleanProcess] = {}

    def fill(self) -> bool:
        """Starts strategies as long as there are free processors.

        Returns whether any process runs.
        """
        while self.waiting and len(self.running) < (os.cpu_count() or 1):
            self._start(self.waiting.pop(0))
        return bool(self.running)

    def _start(self, strategy: str) -> None:
        process = CleanProcess(run_strategy)
        self.running[process.connection] = process
        with suppress(BrokenPipeError):  # it has ended: `heard` notices
            process.connection.send((self.plan, self.task, replace(self.limits, strategy=strategy)))

    def heard(self) -> Iterator[Plan | Outcome]:
        """The messages that arrive within `STOP_CHECK_PAUSE_S` seconds.

        A process that ends without an answer counts as one that gave up.
        """
        for end in wait(list(self.running), STOP_CHECK_PAUSE_S):
            assert isinstance(end, Connection)
            try:
                message: Plan | Outcome = end.recv()
            except (EOFError, ConnectionResetError):
                message = GaveUp("a strategy ran out of memory", "memory")
            if not isinstance(message, Plan):
                self.running.pop(end).kill()
            yield message

    def stop(self) -> None:
        """Stops all processes that still run."""
        for process in self.running.values():
            process.kill()


@contextmanager
def _open_lanes(task: GroundTask, limits: SearchLimits, plan: Planner) -> Iterator[_RaceProcesses]:
    lanes = _RaceProcesses(task, limits, plan)
    try:
        yield lanes
    finally:
        lanes.stop()


def run_strategy(parent: Connection) -> None:
    """In the process of one strategy: plan, and send each better plan and the answer.

    The process ends at once when its parent has ended.
    """
    plan, task, limits = parent.recv()
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    with suppress(MemoryError, StoppedByCaller):  # the others go on
        parent.send(plan(task, replace(limits, improved=parent.send)))


def _end_with(parent: Connection) -> None:
    """Wait until the parent process closes the connection: it never sends anything more."""
    parent.poll(None)
    os._exit(1)
