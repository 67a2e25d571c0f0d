"""Single commands, outside of any program: what prepares a test, the test itself, a repair, a question to a person."""

from dataclasses import dataclass, replace

from cellwright.engine.model.execution import Command, Fate, Order, Phase, RecordKind, Trouble, TroubleKind
from cellwright.engine.pipelines.execution.course import LOST, Course
from cellwright.engine.pipelines.execution.meeting import take_in
from cellwright.engine.pipelines.execution.progress import Turn
from cellwright.engine.stages.execution.machine import TIMEOUT
from cellwright.kb.terms import Function


@dataclass(frozen=True, slots=True)
class Performed:
    """A command that was carried out, and its reply; `timeout` if none came in time."""

    command: Command
    reply: str


class Interruption(Exception):
    """A step failed while a test or a repair was prepared. `taken` are the steps before it, which had their effects."""

    def __init__(self, step: Function, number: int, reply: str, taken: tuple[Function, ...] = ()) -> None:
        super().__init__(f"{step} was answered '{reply}'")
        self.step, self.number, self.reply, self.taken = step, number, reply, taken


class Ended(Exception):
    """The run ended while it waited for a single command: by order, or because the controller is lost."""

    def __init__(self, turn: Turn) -> None:
        super().__init__(turn.why)
        self.turn = turn


def perform(course: Course, command: Command) -> Performed:
    """Send one command and wait for its reply. Raises `Ended`."""
    number = course.standing.number
    course.standing = replace(course.standing, number=number + 1)
    command = replace(command, number=number)
    known = course.recorder.told(RecordKind.COMMAND)
    course.post(command)
    if known is not None:
        course.outbox.clear()
        if (reply := _known(course, number)) is not None:
            return Performed(command, reply)
        if course.driver.report([number])[0].fate in (Fate.UNKNOWN, Fate.DROPPED):
            return perform(course, command)
    course.flush()
    return Performed(command, _awaited(course, command))


def _known(course: Course, number: int) -> str | None:
    """The reply to a command that was sent before the run was taken up again; None if it has not come yet."""
    told = course.recorder.told(RecordKind.REPLY)
    if told is not None:
        course.recorder.note(RecordKind.REPLY)
        return str(told.content["text"])
    reply = course.driver.report([number])[0].reply
    if reply is not None:
        course.recorder.note(RecordKind.REPLY, command=number, text=reply.text, data=dict(reply.data))
        return reply.text
    return None


def _awaited(course: Course, command: Command) -> str:
    """The reply to a command that was sent; `timeout` if none comes in time. Raises `Ended`."""
    due = None if command.timeout_ms is None else course.driver.now_ms() + command.timeout_ms
    while True:
        if (said := _hear_orders(course, command)) is not None:
            return said
        times = [each for each in (due, course.orders.next_ms()) if each is not None]
        for message in course.driver.receive(min(times, default=None)):
            if isinstance(message, Trouble):
                _trouble(course, message)
            elif message.number == command.number:
                data = dict(message.data)
                course.recorder.note(RecordKind.REPLY, command=command.number, text=message.text, data=data)
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
            course.recorder.note(RecordKind.REPLY, command=command.number, text=TIMEOUT, data={})
            return TIMEOUT


def _hear_orders(course: Course, command: Command) -> str | None:
    """What a person answers to a command that asks one; None if nobody has answered. Raises `Ended`."""
    for given in course.orders.due(course.driver.now_ms()):
        course.recorder.note(RecordKind.ORDER, **given.content())
        if given.order in (Order.STOP, Order.ABORT):
            course.driver.halt()
            raise Ended(Turn(Phase.STOPPED, why="stopped by order"))
        if given.order in (Order.INTERRUPT, Order.CONTINUE):
            course.heed(given.order)
        elif given.order is not Order.ANSWER:
            course.pending.append(given)
        elif command.asks and given.text in command.choices:
            course.recorder.note(RecordKind.REPLY, command=command.number, text=given.text, data={})
            return given.text
        else:
            choices = ", ".join(command.choices) if command.asks else "no person is asked now"
            course.recorder.note(RecordKind.DECISION, what="answer refused", why=f"it is none of: {choices}")
    return None


def _trouble(course: Course, trouble: Trouble) -> None:
    course.recorder.note(
        RecordKind.TROUBLE, trouble=trouble.kind.value, text=trouble.text, command=trouble.number
    )
    if trouble.kind is TroubleKind.LOST:
        raise Ended(Turn(Phase.STOPPED, why=f"{LOST}: {trouble.text}"))
