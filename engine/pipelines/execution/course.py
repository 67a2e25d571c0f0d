"""A program on its way: the loop that waits for replies, and takes each through the table of the executive.

Everything is noted before it takes effect: commands are sent only after the group of records that holds them is on the disk.
What the table wants done, `effects` does.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from engine.model.execution import (
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
from engine.pipelines.execution import effects
from engine.pipelines.execution.compiling import Compiled
from engine.pipelines.execution.orders import Given, Orders
from engine.pipelines.execution.recorder import Recorder
from engine.pipelines.execution.replies import Replies
from engine.pipelines.measuring import Measuring
from engine.pipelines.simulation import Achievement, World
from engine.ports import Driver
from engine.stages import execution as executive
from engine.stages.execution import Failure, Standing
from kb.terms import Atom

EVERY = 5_000  # records from one checkpoint to the next
LOST = "the controller does not answer any more"
STAYS = "something will stay too long"
STUCK = "nothing is under way and nothing can begin"


@dataclass(frozen=True, slots=True)
class Turn:
    """Why the loop came back: every step is done, something failed, an order needs more than the table, the rest of the plan
    is to be reviewed, or the run is over.
    """

    phase: Phase
    failures: tuple[Failure, ...] = ()
    given: Given | None = None
    why: str = ""
    review: bool = False


@dataclass
class Course:
    """The execution of programs, one after another, in one world."""

    run: str
    driver: Driver
    recorder: Recorder
    orders: Orders
    world: World
    compiled: Compiled
    standing: Standing
    history: list[Achievement] = field(default_factory=list)
    keeps_history: bool = True
    measuring: Measuring | None = None
    done: set[int] = field(default_factory=set)
    outbox: list[Command] = field(default_factory=list)
    pending: list[Given] = field(default_factory=list)  # orders that came while an exception was handled
    sent: dict[int, tuple[dict[str, Any], int]] = field(
        default_factory=dict
    )  # under way, as noted, since when
    plan_number: int = 0  # of the record of the program
    noted: int = 0  # the last checkpoint
    every: int = EVERY
    checkpoint: Callable[[], dict[str, Any]] | None = None
    turn: Turn | None = None
    review: str = ""  # why what is left of the plan is to be looked at again
    off_ms: int = 0  # how far behind its forecast the run was when the plan was made, or last reviewed
    since: dict[Atom, int] = field(default_factory=dict)  # when facts became true, where stays are limited
    look: Callable[[RunState], None] | None = None

    def __post_init__(self) -> None:
        self.replies = Replies(self.compiled)

    def follow(self, compiled: Compiled, standing: Standing) -> None:
        """Go on with another program."""
        self.compiled, self.standing = compiled, standing
        self.replies = Replies(compiled)
        self.done, self.review, self.off_ms = set(), "", 0
        self.sent = {number: self._renumbered(number) for number in standing.running}
        self.plan_number = self.recorder.last

    def _renumbered(self, number: int) -> tuple[dict[str, Any], int]:
        """What was noted of a command that is under way, for the number that its step has now."""
        content, at_ms = self.sent[number]
        return {**content, "step": self.standing.running[number].activity}, at_ms

    def go(self) -> Turn:
        """Execute until something needs more than the table, or the program is done."""
        if self.turn is None:
            self.take(executive.Began() if self.standing.phase is Phase.READY else executive.Passed())
        self.flush()
        while self.turn is None:
            self.wait()
            self.flush()
            if self.turn is None and self.review and self.standing.phase is Phase.RUNNING:
                self.turn = Turn(Phase.RUNNING, why=self.review, review=True)
                self.review = ""
        turn, self.turn = self.turn, None
        return turn

    def wait(self) -> None:
        """Wait for what comes next, and take it in."""
        waiting, self.pending = self.pending, []
        for given in waiting:
            self.order(given, noted=True)
        for given in self.orders.due(self.driver.now_ms()):
            self.order(given)
        if self.turn is not None:
            return
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
        running = self.standing.running.get(message.number)
        if running is None:
            return
        if self.replies.is_normal(running.activity, message.text):
            effects.result(self, running.activity, message)
            self.take(executive.Replied(message.number))
        else:
            self.take(executive.Failed(message.number, message.text))

    def order(self, given: Given, noted: bool = False) -> None:
        """Take in an order. Those that the table does not know are for whoever called `go`."""
        if not noted:
            self.recorder.note(RecordKind.ORDER, **given.content())
        event = TABLE.get(given.order)
        if event is not None:
            before = self.standing.phase
            self.take(event)
            if before is not self.standing.phase:
                self.recorder.note(RecordKind.PHASE, phase=self.standing.phase.value, why=given.order.value)
        elif self.standing.phase in (Phase.QUIESCING, Phase.HANDLING):
            self.pending.append(given)  # first it has to be found out what went wrong
        elif given.order is not Order.APPROVE:
            self.turn = Turn(self.standing.phase, given=given)

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
                effects.dispatch(self, effect)
            case executive.Done():
                effects.done(self, effect)
            case executive.Quiesce():
                effects.quiesce(self)
            case executive.Threatened():
                effects.threatened(self, effect)
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
                self.recorder.note(RecordKind.PHASE, phase=Phase.PAUSED.value, why="the current goal is done")
            case executive.Completed():
                self.turn = Turn(Phase.FINISHED)
            case _:
                pass

    def post(self, command: Command, step: int | None = None) -> None:
        """Note a command, to be sent once the note is on the disk."""
        record = self.recorder.note(
            RecordKind.COMMAND,
            command=command.number,
            command_kind=command.kind.value,
            stream=command.stream,
            action=command.action,
            says=command.says,
            expects=command.expects,
            choices=list(command.choices),
            lasts_ms=command.lasts_ms,
            timeout_ms=command.timeout_ms,
            about=command.about,
            asks=command.asks,
            step=step,
        )
        self.sent[command.number] = (dict(record.content), record.at_ms)
        self.outbox.append(command)

    def flush(self) -> None:
        """Write what was noted, then send what was posted. Raises `JournalFailure`; then nothing was sent."""
        if self.checkpoint is not None and self._is_time():
            self.noted = self.recorder.note(RecordKind.CHECKPOINT, state=self.checkpoint()).number
        self.recorder.commit()
        if self.outbox:
            commands, self.outbox = self.outbox, []
            self.driver.send(commands)
        if self.look is not None:
            self.look(self.state())

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
