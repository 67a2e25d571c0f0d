"""Bringing a cell to rest: whatever ends a run, its driver hears `quiesce`, and `halt` if need be.

A run that is told to end lets motions come to their end within a time, takes in what they reply,
and halts. A run that breaks off halts as well. A run whose work is done has nothing under way; its
driver is told that nothing more will begin.
"""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from cellwright.engine.model.run_protocol import OperatorCommand, RecordKind, RunPhase
from cellwright.engine.ports import Driver

if TYPE_CHECKING:
    from cellwright.engine.pipelines.execution.run_loop import RunLoop

REST_MS = 5_000  # motions may take so long to come to their end when a run is told to end
REST_SLACK_S = 1.0  # of real time beside it, for a driver whose clock stands still
TOLD_TO_END = "told to end"
_open_drivers: list[Driver] = []
_listing = threading.Lock()


@dataclass
class CellRest:
    """Whether the driver of a run has been brought to rest for good."""

    is_told: bool = False

    def break_off(self, driver: Driver) -> None:
        """Have the cell come to rest after an error, whatever the driver makes of it."""
        if self.is_told:
            return
        self.is_told = True
        with suppress(Exception):
            driver.quiesce(0)
        with suppress(Exception):
            driver.halt()


@contextmanager
def leaving_safely(driver: Driver) -> Iterator[CellRest]:
    """A context in which a driver is used. It is brought to rest if an error ends the context, and
    is closed in any case.
    """
    rest = CellRest()
    with _listing:
        _open_drivers.append(driver)
    try:
        yield rest
    except BaseException:
        rest.break_off(driver)
        raise
    finally:
        with _listing:
            _open_drivers.remove(driver)
        driver.close()


def halt_open_drivers() -> bool:
    """Halt what this process drives, from another thread than the one that drives: that one is
    stuck. Whether there was a driver.
    """
    with _listing:
        drivers = list(_open_drivers)
    for driver in drivers:
        with suppress(Exception):
            getattr(driver, "stop_from_outside", driver.halt)()
    return bool(drivers)


def halt_cell(course: "RunLoop") -> None:
    """Stop everything at once."""
    course.rest.is_told = True
    course.driver.halt()


def come_to_rest(course: "RunLoop", halts: bool) -> None:
    """Have a cell begin nothing more and bring what moves to its end; then halt it, if asked."""
    if course.rest.is_told:
        return
    course.rest.is_told = True
    course.outbox.clear()
    try:
        if halts:
            _wind_down(course)
        else:
            course.driver.quiesce(0)
    finally:
        if halts:
            course.driver.halt()


def _wind_down(course: "RunLoop") -> None:
    """Take in what comes until nothing moves any more, the time is over, or a stop is ordered."""
    driver = course.driver
    course.standing = replace(course.standing, phase=RunPhase.QUIESCING)
    end, latest = driver.now_ms() + REST_MS, time.monotonic() + REST_MS / 1000 + REST_SLACK_S
    for message in course.quieten_driver(REST_MS):
        course.hear(message)
    while not course.is_lost and _moves(course) and time.monotonic() < latest:
        if driver.now_ms() >= end or _is_stop_ordered(course):
            return
        for message in driver.receive(end):
            course.hear(message)


def _moves(course: "RunLoop") -> bool:
    """Whether something is under way that is no process."""
    activities = course.compiled.program.activities
    return any(
        not activities[running.activity].process for running in course.standing.running.values()
    )


def _is_stop_ordered(course: "RunLoop") -> bool:
    """Whether a stop at once is ordered while motions come to their end; all orders are noted."""
    stops = False
    for given_order in course.orders.due(course.driver.now_ms()):
        course.recorder.note(RecordKind.ORDER, **given_order.content())
        stops |= given_order.order in (OperatorCommand.STOP, OperatorCommand.ABORT)
    return stops
