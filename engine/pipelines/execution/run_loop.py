"""Run loop: waits for replies and orders, and takes each through the table of the executive.

Everything is noted before it takes effect: commands are sent only after the group of records that
holds them is on the disk. What the table wants done, `Progress` does.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from cellwright.engine.model.run_protocol import (
    CommandKind,
    DriverCommand,
    Message,
    OperatorCommand,
    RecordKind,
    RunPhase,
    RunState,
    Trouble,
    TroubleKind,
    Underway,
)
from cellwright.engine.pipelines.execution.obstacles_met import not_begun, take_in
from cellwright.engine.pipelines.execution.operator_orders import GivenOrder
from cellwright.engine.pipelines.execution.run_progress import Checkpoint, LoopTurn, RunProgress
from cellwright.engine.stages import execution as executive

QUIET_MS = 1_000  # a driver may take so long to drop what is queued
CONTROLLER_LOST = "the controller does not answer any more"
STAYS_TOO_LONG = "something will stay too long"
NOTHING_CAN_BEGIN = "nothing is under way and nothing can begin"


@dataclass
class RunLoop(RunProgress):
    """The execution of programs, one after another: the loop that waits for what comes next."""

    def go(self) -> LoopTurn:
        """Execute until something needs more than the table, or the program is done."""
        if self.turn is None:
            self._begin()
        self.flush()
        while self.turn is None:
            if (
                self.standing.phase is RunPhase.RUNNING
                and (turn := self._looks_ahead()) is not None
            ):
                return turn
            self.wait()
            self.flush()
        turn, self.turn = self.turn, None
        return turn

    def _begin(self) -> None:
        """Begin the program; if the run was told to pause before it had a program, go no
        further than that asks for.
        """
        if self.standing.phase is not RunPhase.READY:
            self.take(executive.TimePassed())
        elif self.interrupts:
            self._told(executive.Interrupted(), OperatorCommand.INTERRUPT)
        else:
            self.take(executive.Began())

    def _looks_ahead(self) -> LoopTurn | None:
        """Come back if what is left is to be looked at again, or if something is waited for
        that another thing could serve.
        """
        if self.review:
            why, self.review = self.review, ""
            return LoopTurn(RunPhase.RUNNING, why=why, review=True)
        under_way = frozenset(self.standing.running)
        if self.compiled.program.follows_rules:
            return None  # another order of the steps would be without a policy
        if (
            under_way
            and under_way != self.waited
            and executive.only_waits(self.compiled.program, self.standing)
        ):
            self.waited = under_way
            return LoopTurn(RunPhase.RUNNING, idle=True)
        return None

    def wait(self) -> None:
        """Wait for what comes next, and take it in."""
        if self.unsent:
            self.hear(self.unsent.pop(0))
            return
        waiting, self.pending = self.pending, []
        for given_order in waiting:
            self.order(given_order, noted=True)
        for given_order in self.orders.due(self.driver.now_ms()):
            self.order(given_order)
        if self.turn is not None or self.outbox:
            return  # what an order has begun is sent before anything is waited for
        messages = self.driver.receive(self._until())
        for message in messages:
            self.hear(message)
        if not messages:
            self.take(executive.TimePassed())
            self._stuck()

    def _until(self) -> int | None:
        times = [executive.next_time(self.compiled.program, self.standing), self.orders.next_ms()]
        return min((time for time in times if time is not None), default=None)

    def _stuck(self) -> None:
        """End a wait that nothing can end any more."""
        if self.turn is not None or self.standing.running or self._until() is not None:
            return
        if self.standing.phase is RunPhase.PAUSED:
            if self.driver.tick_ms is None and not self.orders.wait():
                self.turn = LoopTurn(RunPhase.PAUSED, why="paused, and nobody can tell it to go on")
        elif self.driver.tick_ms is None or self.standing.phase is RunPhase.RUNNING:
            self.turn = LoopTurn(RunPhase.HANDLING, why=NOTHING_CAN_BEGIN)

    def hear(self, message: Message) -> None:
        """Take in a message of the driver."""
        if isinstance(message, Trouble):
            self.recorder.note(
                RecordKind.TROUBLE,
                trouble=message.kind.value,
                text=message.text,
                command=message.number,
            )
            if message.kind is TroubleKind.LOST:
                self.turn = LoopTurn(RunPhase.STOPPED, why=f"{CONTROLLER_LOST}: {message.text}")
            return
        self.recorder.note(
            RecordKind.REPLY, command=message.number, text=message.text, data=dict(message.data)
        )
        take_in(self, message)
        running = self.standing.running.get(message.number)
        if running is None:
            return
        if self.replies.is_normal(running.activity, message.text):
            self.result(running.activity, message)
            self.take(executive.Replied(message.number))
        else:
            self.take(executive.CommandFailed(message.number, message.text))

    def order(self, given: GivenOrder, noted: bool = False) -> None:
        """Take in an order. Those that the table does not know are for whoever called `go`."""
        if not noted:
            self.recorder.note(RecordKind.ORDER, **given.content())
        self.heed(given.order)
        event = EVENT_OF_ORDER.get(given.order)
        if event is not None:
            if (
                self.standing.phase is not RunPhase.READY
                or given.order is not OperatorCommand.INTERRUPT
            ):
                self._told(event, given.order)
        elif given.order is OperatorCommand.ANSWER:
            self._answered(given)
        elif self.turn is not None or self.standing.phase in (
            RunPhase.QUIESCING,
            RunPhase.HANDLING,
        ):
            self.pending.append(
                given
            )  # first comes what came before it, or it has to be found out what went wrong
        elif given.order is not OperatorCommand.APPROVE:
            self.turn = LoopTurn(self.standing.phase, given=given)

    def heed(self, order: OperatorCommand) -> None:
        """Keep in mind that the run shall pause, also while it cannot: as long as an exception
        is handled, say.
        """
        if order in (OperatorCommand.INTERRUPT, OperatorCommand.CONTINUE):
            self.interrupts = order is OperatorCommand.INTERRUPT

    def _told(self, event: executive.Event, order: OperatorCommand) -> None:
        """Take an order through the table, and note the phase that it leads to.

        A pause notes itself.
        """
        before = self.standing.phase
        self.take(event)
        if self.standing.phase not in (before, RunPhase.PAUSED):
            self.recorder.note(RecordKind.PHASE, phase=self.standing.phase.value, why=order.value)

    def _answered(self, given: GivenOrder) -> None:
        """Take a step for a person for done that a person has confirmed; the answer names the
        step if several are open.
        """
        asked = {
            n: activity
            for n, r in self.standing.running.items()
            if (activity := self._activity(r)).asks
        }
        named = [
            n for n, activity in asked.items() if given.text.strip() in (str(n), activity.action)
        ]
        if len(numbers := named or (list(asked) if not given.text.strip() else [])) != 1:
            open_ = ", ".join(activity.action for activity in asked.values()) or "nothing"
            self.recorder.note(
                RecordKind.DECISION, what="answer refused", why=f"a person is asked: {open_}"
            )
            return
        self.recorder.note(RecordKind.REPLY, command=numbers[0], text="done", data={})
        self.take(executive.Replied(numbers[0]))

    def _activity(self, running: executive.Running) -> executive.Activity:
        return self.compiled.program.activities[running.activity]

    def take(self, event: executive.Event) -> None:
        """Take an event through the table, and do what comes of it."""
        self.standing, effects = executive.advance_run(
            self.compiled.program, self.standing, event, self.driver.now_ms()
        )
        for effect in effects:
            self._effect(effect)

    def _effect(self, effect: executive.Effect) -> None:
        match effect:
            case executive.Dispatch():
                self.dispatch(effect)
            case executive.Done():
                self.ended(effect)
            case executive.Quiesce():
                self._quiesce()
            case executive.Threatened():
                self.threatened(effect)
                self.review = STAYS_TOO_LONG
            case _:
                self._comes_to_rest(effect)

    def _comes_to_rest(self, effect: executive.Effect) -> None:
        match effect:
            case executive.Handle(failures):
                self.turn = LoopTurn(RunPhase.HANDLING, failures)
            case executive.Halt():
                self.driver.halt()
                self.turn = LoopTurn(RunPhase.STOPPED, why="stopped by order")
            case executive.Paused():
                self.interrupts = False
                self.recorder.note(
                    RecordKind.PHASE, phase=RunPhase.PAUSED.value, why="the current goal is done"
                )
            case executive.Completed():
                self.turn = LoopTurn(RunPhase.FINISHED)
            case _:
                pass

    def _quiesce(self) -> None:
        """Have the driver begin nothing more, and take in what came meanwhile."""
        self.recorder.note(
            RecordKind.PHASE, phase=RunPhase.QUIESCING.value, why="a step has failed"
        )
        self.flush()
        came = self.driver.quiesce(QUIET_MS)
        reports = self.driver.report(sorted(self.standing.running))
        dropped = [
            report.number for report in reports if report.fate.value in ("dropped", "unknown")
        ]
        if dropped:
            not_begun(self, dropped)
            self.take(executive.Withdrawn(tuple(dropped)))
        for message in came:
            self.hear(message)

    def flush(self) -> None:
        """Write what was noted, then send what was posted.

        Raises `JournalFailure`; then nothing was sent.
        """
        if self.checkpoint is not None and self._is_time():
            self.noted = self._saved(self.checkpoint)
        self.recorder.commit()
        if self.outbox:
            commands, self.outbox = self.outbox, []
            self.driver.send(commands)
        if self.look is not None:
            self.look(self.state())

    def _saved(self, checkpoint: Checkpoint) -> int:
        """Note a checkpoint, and before it what is left of the plan if that pays; its number.

        Each page is written before the next one is made, so a long plan is never in memory a second
        time.
        """
        for page in checkpoint.rest():
            number = self.recorder.note(RecordKind.CHECKPOINT, rest=page).number
            self.recorder.commit()
            if "order" in page:
                self.written.plan(number, page)
        number = self.recorder.note(RecordKind.CHECKPOINT, state=checkpoint.state()).number
        self.written.checkpoint, self.written.history = number, len(self.history)
        return number

    def _is_time(self) -> bool:
        """Whether a checkpoint is due; none is written while a case is open."""
        many = self.recorder.last - self.noted >= self.every
        return many and self.standing.phase is RunPhase.RUNNING and not self.recorder.known

    def state(self) -> RunState:
        """How the run stands."""
        program = self.compiled.program
        under_way = tuple(
            Underway(
                DriverCommand(
                    number, CommandKind.STEP, a.stream, a.action, a.says, lasts_ms=a.lasts_ms
                ),
                running.since_ms,
                running.since_ms + a.lasts_ms,
                a.id,
            )
            for number, running in sorted(self.standing.running.items())
            for a in (program.activities[running.activity],)
        )
        return RunState(
            self.run,
            self.standing.phase,
            self.driver.now_ms(),
            under_way,
            self.standing.done,
            len(program.activities),
            program.forecast_ms,
            frozenset(self.world.facts),
        )


EVENT_OF_ORDER: Mapping[OperatorCommand, executive.Event] = {
    OperatorCommand.STOP: executive.StopCommanded(),
    OperatorCommand.INTERRUPT: executive.Interrupted(),
    OperatorCommand.CONTINUE: executive.Continued(),
}


def is_approved(course: RunLoop) -> bool:
    """Whether a person lets the run begin; False if the run is stopped, or if nobody can ever
    say so.
    """
    course.recorder.note(RecordKind.PHASE, phase=RunPhase.READY.value, why="waits for approval")
    course.flush()
    while True:
        for given_order in course.orders.due(course.driver.now_ms()):
            course.order(given_order)
            if given_order.order in (
                OperatorCommand.APPROVE,
                OperatorCommand.STOP,
                OperatorCommand.ABORT,
            ):
                return given_order.order is OperatorCommand.APPROVE
        if not course.orders.wait():
            return False
