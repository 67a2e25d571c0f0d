"""A program on its way: the loop that waits for replies, and takes each through the table of the executive.

Everything is noted before it takes effect: commands are sent only after the group of records that holds them is on the disk.
What the table wants done, `Progress` does.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from cellwright.engine.model.execution import (
    Command,
    CommandKind,
    Message,
    Order,
    Phase,
    RecordKind,
    RunState,
    Trouble,
    TroubleKind,
    Underway,
)
from cellwright.engine.pipelines.execution.meeting import not_begun, take_in
from cellwright.engine.pipelines.execution.orders import Given
from cellwright.engine.pipelines.execution.progress import Checkpoint, Progress, Turn
from cellwright.engine.stages import execution as executive

QUIET_MS = 1_000  # a driver may take so long to drop what is queued
LOST = "the controller does not answer any more"
STAYS = "something will stay too long"
STUCK = "nothing is under way and nothing can begin"


@dataclass
class Course(Progress):
    """The execution of programs, one after another: the loop that waits for what comes next."""

    def go(self) -> Turn:
        """Execute until something needs more than the table, or the program is done."""
        if self.turn is None:
            self._begin()
        self.flush()
        while self.turn is None:
            if self.standing.phase is Phase.RUNNING and (turn := self._looks_ahead()) is not None:
                return turn
            self.wait()
            self.flush()
        turn, self.turn = self.turn, None
        return turn

    def _begin(self) -> None:
        """Begin the program; if the run was told to pause before it had a program, go no further than that asks for."""
        if self.standing.phase is not Phase.READY:
            self.take(executive.Passed())
        elif self.interrupts:
            self._told(executive.Interrupted(), Order.INTERRUPT)
        else:
            self.take(executive.Began())

    def _looks_ahead(self) -> Turn | None:
        """Come back if what is left is to be looked at again, or if something is waited for that another thing could serve."""
        if self.review:
            why, self.review = self.review, ""
            return Turn(Phase.RUNNING, why=why, review=True)
        under_way = frozenset(self.standing.running)
        if under_way and under_way != self.waited and executive.waits(self.compiled.program, self.standing):
            self.waited = under_way
            return Turn(Phase.RUNNING, idle=True)
        return None

    def wait(self) -> None:
        """Wait for what comes next, and take it in."""
        if self.unsent:
            self.hear(self.unsent.pop(0))
            return
        waiting, self.pending = self.pending, []
        for given in waiting:
            self.order(given, noted=True)
        for given in self.orders.due(self.driver.now_ms()):
            self.order(given)
        if self.turn is not None or self.outbox:
            return  # what an order has begun is sent before anything is waited for
        messages = self.driver.receive(self._until())
        for message in messages:
            self.hear(message)
        if not messages:
            self.take(executive.Passed())
            self._stuck()

    def _until(self) -> int | None:
        times = [executive.next_time(self.compiled.program, self.standing), self.orders.next_ms()]
        return min((each for each in times if each is not None), default=None)

    def _stuck(self) -> None:
        """End a wait that nothing can end any more."""
        if self.turn is not None or self.standing.running or self._until() is not None:
            return
        if self.standing.phase is Phase.PAUSED:
            if self.driver.tick_ms is None and not self.orders.wait():
                self.turn = Turn(Phase.PAUSED, why="paused, and nobody can tell it to go on")
        elif self.driver.tick_ms is None or self.standing.phase is Phase.RUNNING:
            self.turn = Turn(Phase.HANDLING, why=STUCK)

    def hear(self, message: Message) -> None:
        """Take in a message of the driver."""
        if isinstance(message, Trouble):
            self.recorder.note(
                RecordKind.TROUBLE, trouble=message.kind.value, text=message.text, command=message.number
            )
            if message.kind is TroubleKind.LOST:
                self.turn = Turn(Phase.STOPPED, why=f"{LOST}: {message.text}")
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
            self.take(executive.Failed(message.number, message.text))

    def order(self, given: Given, noted: bool = False) -> None:
        """Take in an order. Those that the table does not know are for whoever called `go`."""
        if not noted:
            self.recorder.note(RecordKind.ORDER, **given.content())
        self.heed(given.order)
        event = TABLE.get(given.order)
        if event is not None:
            if self.standing.phase is not Phase.READY or given.order is not Order.INTERRUPT:
                self._told(event, given.order)
        elif given.order is Order.ANSWER:
            self._answered(given)
        elif self.turn is not None or self.standing.phase in (Phase.QUIESCING, Phase.HANDLING):
            self.pending.append(
                given
            )  # first comes what came before it, or it has to be found out what went wrong
        elif given.order is not Order.APPROVE:
            self.turn = Turn(self.standing.phase, given=given)

    def heed(self, order: Order) -> None:
        """Keep in mind that the run shall pause, also while it cannot: as long as an exception is handled, say."""
        if order in (Order.INTERRUPT, Order.CONTINUE):
            self.interrupts = order is Order.INTERRUPT

    def _told(self, event: executive.Event, order: Order) -> None:
        """Take an order through the table, and note the phase that it leads to. A pause notes itself."""
        before = self.standing.phase
        self.take(event)
        if self.standing.phase not in (before, Phase.PAUSED):
            self.recorder.note(RecordKind.PHASE, phase=self.standing.phase.value, why=order.value)

    def _answered(self, given: Given) -> None:
        """Take a step for a person for done that a person has confirmed; the answer names the step if several are open."""
        asked = {n: each for n, r in self.standing.running.items() if (each := self._activity(r)).asks}
        named = [n for n, each in asked.items() if given.text.strip() in (str(n), each.action)]
        if len(found := named or (list(asked) if not given.text.strip() else [])) != 1:
            open_ = ", ".join(each.action for each in asked.values()) or "nothing"
            self.recorder.note(RecordKind.DECISION, what="answer refused", why=f"a person is asked: {open_}")
            return
        self.recorder.note(RecordKind.REPLY, command=found[0], text="done", data={})
        self.take(executive.Replied(found[0]))

    def _activity(self, running: executive.Running) -> executive.Activity:
        return self.compiled.program.activities[running.activity]

    def take(self, event: executive.Event) -> None:
        """Take an event through the table, and do what comes of it."""
        self.standing, found = executive.advance(
            self.compiled.program, self.standing, event, self.driver.now_ms()
        )
        for effect in found:
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
                self.review = STAYS
            case _:
                self._comes_to_rest(effect)

    def _comes_to_rest(self, effect: executive.Effect) -> None:
        match effect:
            case executive.Handle(failures):
                self.turn = Turn(Phase.HANDLING, failures)
            case executive.Halt():
                self.driver.halt()
                self.turn = Turn(Phase.STOPPED, why="stopped by order")
            case executive.Paused():
                self.interrupts = False
                self.recorder.note(RecordKind.PHASE, phase=Phase.PAUSED.value, why="the current goal is done")
            case executive.Completed():
                self.turn = Turn(Phase.FINISHED)
            case _:
                pass

    def _quiesce(self) -> None:
        """Have the driver begin nothing more, and take in what came meanwhile."""
        self.recorder.note(RecordKind.PHASE, phase=Phase.QUIESCING.value, why="a step has failed")
        self.flush()
        came = self.driver.quiesce(QUIET_MS)
        reports = self.driver.report(sorted(self.standing.running))
        dropped = [each.number for each in reports if each.fate.value in ("dropped", "unknown")]
        if dropped:
            not_begun(self, dropped)
            self.take(executive.Withdrawn(tuple(dropped)))
        for message in came:
            self.hear(message)

    def flush(self) -> None:
        """Write what was noted, then send what was posted. Raises `JournalFailure`; then nothing was sent."""
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

        Each page is written before the next one is made, so a long plan is never in memory a second time.
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
        return many and self.standing.phase is Phase.RUNNING and not self.recorder.known

    def state(self) -> RunState:
        """How the run stands."""
        program = self.compiled.program
        under_way = tuple(
            Underway(
                Command(number, CommandKind.STEP, a.stream, a.action, a.says, lasts_ms=a.lasts_ms),
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


TABLE: Mapping[Order, executive.Event] = {
    Order.STOP: executive.Stopped(),
    Order.INTERRUPT: executive.Interrupted(),
    Order.CONTINUE: executive.Continued(),
}
