"""Single commands outside a program: tests, repairs, questions, and commands without a reply."""

from dataclasses import dataclass, replace
from typing import Any

from cellwright.engine.model.run_protocol import (
    DriverCommand,
    Fate,
    OperatorCommand,
    RecordKind,
    Reply,
    RunPhase,
    Trouble,
    TroubleKind,
)
from cellwright.engine.pipelines.execution.obstacles_met import take_in
from cellwright.engine.pipelines.execution.run_loop import CONTROLLER_LOST, RunLoop
from cellwright.engine.pipelines.execution.run_progress import LoopTurn
from cellwright.engine.stages import execution as executive
from cellwright.engine.stages.execution.transition_table import TIMEOUT_REPLY
from cellwright.kb.terms import Function


@dataclass(frozen=True, slots=True)
class PerformedCommand:
    """A command that was carried out, and its reply; `timeout` if none came in time."""

    command: DriverCommand
    reply: str


class CommandInterruption(Exception):
    """A step failed while a test or a repair was prepared.

    `taken` are the steps before it, which had their effects.
    """

    def __init__(
        self, step: Function, number: int, reply: str, taken: tuple[Function, ...] = ()
    ) -> None:
        super().__init__(f"{step} was answered '{reply}'")
        self.step, self.number, self.reply, self.taken = step, number, reply, taken


class RunEnded(Exception):
    """The run ended while it waited for a single command: by order, or because the controller
    is lost.
    """

    def __init__(self, turn: LoopTurn) -> None:
        super().__init__(turn.why)
        self.turn = turn


def perform_command(course: RunLoop, command: DriverCommand) -> PerformedCommand:
    """Send one command and wait for its reply. Raises `RunEnded`."""
    number = course.standing.number
    course.standing = replace(course.standing, number=number + 1)
    command = replace(command, number=number)
    known_command = course.recorder.told(RecordKind.COMMAND)
    course.post(command)
    if known_command is not None:
        course.outbox.clear()
        if (reply := _known_reply(course, number)) is not None:
            return PerformedCommand(command, reply)
        if course.driver.report([number])[0].fate in (Fate.UNKNOWN, Fate.DROPPED):
            return perform_command(course, command)
    course.flush()
    return PerformedCommand(command, _await_reply(course, command))


def _known_reply(course: RunLoop, number: int) -> str | None:
    """The reply to a command that was sent before the run was taken up again; None if it has
    not come yet.
    """
    known_reply = course.recorder.told(RecordKind.REPLY)
    if known_reply is not None:
        course.recorder.note(RecordKind.REPLY)
        return str(known_reply.content["text"])
    reply = course.driver.report([number])[0].reply
    if reply is not None:
        course.recorder.note(
            RecordKind.REPLY, command=number, text=reply.text, data=dict(reply.data)
        )
        return reply.text
    return None


def _await_reply(course: RunLoop, command: DriverCommand) -> str:
    """The reply to a command that was sent; `timeout` if none comes in time. Raises `RunEnded`."""
    due = None if command.timeout_ms is None else course.driver.now_ms() + command.timeout_ms
    while True:
        if (answer := _hear_orders(course, command)) is not None:
            return answer
        times = [time for time in (due, course.orders.next_ms()) if time is not None]
        for message in course.driver.receive(min(times, default=None)):
            if isinstance(message, Trouble):
                _note_trouble(course, message)
            elif message.number == command.number:
                data = dict(message.data)
                course.recorder.note(
                    RecordKind.REPLY, command=command.number, text=message.text, data=data
                )
                take_in(course, message)
                return message.text
        if due is not None and course.driver.now_ms() >= due:
            if (
                late := course.driver.report([command.number])[0].reply
            ) is not None:  # only its reply was lost
                course.recorder.note(
                    RecordKind.REPLY, command=late.number, text=late.text, data=dict(late.data)
                )
                return late.text
            course.recorder.note(
                RecordKind.REPLY, command=command.number, text=TIMEOUT_REPLY, data={}
            )
            return TIMEOUT_REPLY


def _hear_orders(course: RunLoop, command: DriverCommand) -> str | None:
    """What a person answers to a command that asks one; None if nobody has answered. Raises
    `RunEnded`.
    """
    for given_order in course.orders.due(course.driver.now_ms()):
        course.recorder.note(RecordKind.ORDER, **given_order.content())
        if given_order.order in (OperatorCommand.STOP, OperatorCommand.ABORT):
            course.driver.halt()
            raise RunEnded(LoopTurn(RunPhase.STOPPED, why="stopped by order"))
        if given_order.order in (OperatorCommand.INTERRUPT, OperatorCommand.CONTINUE):
            course.heed(given_order.order)
        elif given_order.order is not OperatorCommand.ANSWER:
            course.pending.append(given_order)
        elif command.asks and given_order.text in command.choices:
            course.recorder.note(
                RecordKind.REPLY, command=command.number, text=given_order.text, data={}
            )
            return given_order.text
        else:
            choices = ", ".join(command.choices) if command.asks else "no person is asked now"
            course.recorder.note(
                RecordKind.DECISION, what="answer refused", why=f"it is none of: {choices}"
            )
    return None


def _note_trouble(course: RunLoop, trouble: Trouble) -> None:
    course.recorder.note(
        RecordKind.TROUBLE, trouble=trouble.kind.value, text=trouble.text, command=trouble.number
    )
    if trouble.kind is TroubleKind.LOST:
        raise RunEnded(LoopTurn(RunPhase.STOPPED, why=f"{CONTROLLER_LOST}: {trouble.text}"))


REPLY_TIMEOUT = executive.TIMEOUT_REPLY
CONTROLLER_ASKED = "the controller is asked"
REPLY_LOST, NEVER_CAME = "the reply was lost", "the command never came"


def cleared_up(course: RunLoop, step: Function, activity: int, number: int) -> str:
    """What was wrong with a command without a reply, if the controller knows; a step that has
    ended is done then.
    """
    report = course.driver.report([number])[0]
    if report.fate is Fate.ENDED and report.reply is not None:
        if not course.replies.is_normal(activity, report.reply.text):
            return ""
        _note_diagnosis(course, report.fate, REPLY_LOST)
        _take_as_done(course, activity, report.reply)
        return f"{step}: {REPLY_TIMEOUT}; the controller has its reply; cause: {REPLY_LOST}"
    if report.fate in (Fate.UNKNOWN, Fate.DROPPED):
        _note_diagnosis(course, report.fate, NEVER_CAME)
        return f"{step}: {REPLY_TIMEOUT}; the controller does not have it; cause: {NEVER_CAME}"
    return ""


def _note_diagnosis(course: RunLoop, fate: Fate, cause: str) -> None:
    note = course.recorder.note
    content: dict[str, Any] = {
        "action": CONTROLLER_ASKED,
        "outcome": fate.value,
        "belief": [],
        "expected_cost": 0,
    }
    note(RecordKind.FINDING, exception=REPLY_TIMEOUT, **content)
    note(
        RecordKind.DIAGNOSIS,
        exception=REPLY_TIMEOUT,
        causes=[[cause, 1.0]],
        cured=None,
        isolated=True,
        cost=0,
    )


def _take_as_done(course: RunLoop, activity: int, reply: Reply) -> None:
    _, since_ms = course.sent.get(reply.number, ({}, course.driver.now_ms()))
    course.result(activity, reply)
    course.ended(executive.Done(activity, reply.number, since_ms))
