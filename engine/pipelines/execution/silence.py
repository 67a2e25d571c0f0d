"""A command without a reply in its time: the controller is asked what became of it before anything in the cell is suspected.

If it says that the command has ended, only the reply was lost, and the step is done. If it never had the command, nothing was
done, and the step is taken again. If it does not know more, the fault base is needed.
"""

from typing import Any

from cellwright.engine.model.execution import Fate, RecordKind, Reply
from cellwright.engine.pipelines.execution.course import Course
from cellwright.engine.stages import execution as executive
from cellwright.kb.terms import Function

TIMEOUT = executive.TIMEOUT
ASKED = "the controller is asked"
LOST, NEVER = "the reply was lost", "the command never came"


def cleared_up(course: Course, step: Function, activity: int, number: int) -> str:
    """What was wrong with a command without a reply, if the controller knows; a step that has ended is done then."""
    report = course.driver.report([number])[0]
    if report.fate is Fate.ENDED and report.reply is not None:
        if not course.replies.is_normal(activity, report.reply.text):
            return ""
        _diagnosed(course, report.fate, LOST)
        _done(course, activity, report.reply)
        return f"{step}: {TIMEOUT}; the controller has its reply; cause: {LOST}"
    if report.fate in (Fate.UNKNOWN, Fate.DROPPED):
        _diagnosed(course, report.fate, NEVER)
        return f"{step}: {TIMEOUT}; the controller does not have it; cause: {NEVER}"
    return ""


def _diagnosed(course: Course, fate: Fate, cause: str) -> None:
    note = course.recorder.note
    found: dict[str, Any] = {"action": ASKED, "outcome": fate.value, "belief": [], "expected_cost": 0}
    note(RecordKind.FINDING, exception=TIMEOUT, **found)
    note(RecordKind.DIAGNOSIS, exception=TIMEOUT, causes=[[cause, 1.0]], cured=None, isolated=True, cost=0)


def _done(course: Course, activity: int, reply: Reply) -> None:
    _, since_ms = course.sent.get(reply.number, ({}, course.driver.now_ms()))
    course.result(activity, reply)
    course.ended(executive.Done(activity, reply.number, since_ms))
