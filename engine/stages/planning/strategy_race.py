"""Race of several strategies at the same time, each in its own process.

The first answer counts, and the other processes are stopped.
"""

import multiprocessing
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess

from cellwright.engine.model.ground_task import GroundTask
from cellwright.engine.model.outcome import Found, GaveUp, Infeasible, Outcome
from cellwright.engine.stages.planning.search_control import SearchLimits
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
    """The running processes.

    Each process sends its plans and its answer through a pipe. `running` has the process of each
    pipe.
    """

    def __init__(self, task: GroundTask, limits: SearchLimits, plan: Planner) -> None:
        self.task, self.limits, self.plan = task, limits, plan
        self.waiting = list(RACING_STRATEGIES)
        self.running: dict[Connection, BaseProcess] = {}

    def fill(self) -> bool:
        """Starts strategies as long as there are free processors.

        Returns whether any process runs.
        """
        while self.waiting and len(self.running) < (os.cpu_count() or 1):
            self._start(self.waiting.pop(0))
        return bool(self.running)

    def _start(self, strategy: str) -> None:
        receiver, sender = multiprocessing.Pipe(duplex=False)
        home = os.getpid()
        limits = replace(
            self.limits,
            strategy=strategy,
            interrupted=lambda: os.getppid() != home,  # stops if the parent process has ended
            improved=sender.send,
        )
        context = multiprocessing.get_context("fork")  # a forked process has the task already
        process = context.Process(
            target=_run_lane, args=(sender, self.plan, self.task, limits), daemon=True
        )
        process.start()
        sender.close()
        self.running[receiver] = process

    def heard(self) -> Iterator[Plan | Outcome]:
        """The messages that arrive within `PAUSE` seconds.

        A process that ends without an answer counts as one that gave up.
        """
        for end in wait(list(self.running), STOP_CHECK_PAUSE_S):
            assert isinstance(end, Connection)
            try:
                message: Plan | Outcome = end.recv()
            except EOFError:
                message = GaveUp("a strategy ran out of memory", "memory")
            if not isinstance(message, Plan):
                self.running.pop(end).join()
            yield message

    def stop(self) -> None:
        """Stops all processes that still run."""
        for process in self.running.values():
            process.kill()
        for process in self.running.values():
            process.join()


@contextmanager
def _open_lanes(task: GroundTask, limits: SearchLimits, plan: Planner) -> Iterator[_RaceProcesses]:
    lanes = _RaceProcesses(task, limits, plan)
    try:
        yield lanes
    finally:
        lanes.stop()


def _run_lane(answer: Connection, plan: Planner, task: GroundTask, limits: SearchLimits) -> None:
    try:
        answer.send(plan(task, limits))
    except (MemoryError, StoppedByCaller):  # the others go on
        pass
    finally:
        answer.close()
