"""Bringing a cell to rest: whatever ends a run, its driver hears `quiesce`, and `halt` if need be.

A run that is told to end lets motions come to their end within a time, takes in what they reply,
and halts. A run that breaks off halts as well. A run whose work is done has nothing under way; its
driver is told that nothing more will begin.
"""

import time
from dataclasses import replace

from cellwright.engine.model.run_protocol import OperatorCommand, RecordKind, RunPhase
from cellwright.engine.pipelines.execution.cell_rest import REST_MS
from cellwright.engine.pipelines.execution.run_loop import RunLoop

REST_SLACK_S = 1.0  # of real time beside it, for a driver whose clock stands still


def come_to_rest(course: RunLoop, halts: bool) -> None:
    """Have a cell begin nothing more and bring what moves to its end; then halt it, if asked."""
    if course.rest.is_told:
        return
    course.rest.is_told = True
    course.outbox.clear()
    course.standing = replace(course.standing, phase=RunPhase.QUIESCING)  # nothing begins any more
    try:
        if halts:
            _wind_down(course)
        else:
            for message in course.driver.quiesce(0):
                course.hear(message)
    finally:
        if halts:
            course.driver.halt()


def _wind_down(course: RunLoop) -> None:
    """Take in what comes until nothing moves any more, the time is over, or a stop is ordered."""
    driver = course.driver
    end, latest = driver.now_ms() + REST_MS, time.monotonic() + REST_MS / 1000 + REST_SLACK_S
    for message in course.quieten_driver(REST_MS):
        course.hear(message)
    while not course.is_lost and _moves(course) and time.monotonic() < latest:
        if driver.now_ms() >= end or _is_stop_ordered(course):
            return
        for message in driver.receive(end):
            course.hear(message)


def _moves(course: RunLoop) -> bool:
    """Whether something is under way that is no process."""
    activities = course.compiled.program.activities
    return any(
        not activities[running.activity].process for running in course.standing.running.values()
    )


def _is_stop_ordered(course: RunLoop) -> bool:
    """Whether a stop at once is ordered while motions come to their end; all orders are noted."""
    stops = False
    for given_order in course.orders.due(course.driver.now_ms()):
        course.recorder.note(RecordKind.ORDER, **given_order.content())
        stops |= given_order.order in (OperatorCommand.STOP, OperatorCommand.ABORT)
    return stops
