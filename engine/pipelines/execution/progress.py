"""How far a run is, and what its steps do to that: commands are posted, the world model follows, everything is noted."""

from collections.abc import Callable, Iterator, Mapping, MutableSet
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from cellwright.engine.model.execution import (
    NO_MOTION,
    Command,
    CommandKind,
    Phase,
    RecordKind,
    Reply,
    RunState,
)
from cellwright.engine.model.number_set import NumberSet
from cellwright.engine.model.verdicts import Spoilt
from cellwright.engine.pipelines.execution.commands import command_of
from cellwright.engine.pipelines.execution.compiling import Compiled
from cellwright.engine.pipelines.execution.orders import Given, Orders
from cellwright.engine.pipelines.execution.recorder import Recorder
from cellwright.engine.pipelines.execution.replies import Replies
from cellwright.engine.pipelines.execution.sending import arms, lasting, refusal
from cellwright.engine.pipelines.gate import PlanGate
from cellwright.engine.pipelines.measuring import Measuring
from cellwright.engine.pipelines.simulation import Achievement, Memory, SymbolicWorld
from cellwright.engine.pipelines.simulation.world import achievement
from cellwright.engine.ports import Driver
from cellwright.engine.stages import execution as executive
from cellwright.engine.stages.execution import Failure, Standing
from cellwright.engine.stages.execution.outlook import Accuracy
from cellwright.engine.stages.macros.lifted.world import StepChange
from cellwright.kb.model.plan import Plan
from cellwright.kb.model.results import Measured
from cellwright.kb.terms import Atom

if TYPE_CHECKING:
    from cellwright.engine.pipelines.execution.paths import Paths

PLACED = (CommandKind.STEP, CommandKind.TEST, CommandKind.REPAIR)  # commands that may move along the part
EVERY = 5_000  # records from one checkpoint to the next
NOTICED_MS = (
    30_000  # by which a step may end later or sooner than forecast before the plan is looked at again
)
OTHERWISE = "steps take longer or less than was forecast"
LONG = (
    "steps",
    "order",
    "dwells",
    "running",
    "full",
    "ahead",
    "pages",
)  # what of a plan's record grows with the plan, or is true only once
VERDICT = (
    "of", "quantity", "value", "unit", "nominal", "lower", "upper", "uncertainty", "risk", "passed", "tool",
)  # fmt: skip


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
    idle: bool = False  # nothing can begin before something ends that needs no hand


def head_of(entry: Mapping[str, Any]) -> dict[str, Any]:
    """What the record of a plan says beside its steps."""
    return {key: value for key, value in entry.items() if key not in LONG}


@dataclass
class Written:
    """What the journal holds of the plan: `number` is that of the record with its steps, of which so many were `steps`.

    `done` are those of them that have ended since. `head` is what the record says beside the steps. `checkpoint` is the number of
    the last checkpoint, until which so much of the run's `history` is written.
    """

    number: int = 0
    head: dict[str, Any] = field(default_factory=dict)
    steps: int = 0
    done: MutableSet[int] = field(default_factory=NumberSet)
    checkpoint: int = 0
    history: int = 0

    def plan(self, number: int, entry: Mapping[str, Any]) -> None:
        """Another plan is in the record of this number."""
        self.number, self.steps, self.done = number, len(entry["order"]), NumberSet()
        self.head = head_of(entry)


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """What a checkpoint holds: how the run stands, and what is left of its plan, page by page, if it is time to write that."""

    state: Callable[[], dict[str, Any]]
    rest: Callable[[], Iterator[dict[str, Any]]]


@dataclass
class Progress:
    """How far the execution of programs, one after another, is in one world."""

    run: str
    driver: Driver
    recorder: Recorder
    orders: Orders
    world: SymbolicWorld
    compiled: Compiled
    standing: Standing
    history: list[Achievement] = field(default_factory=list)
    memory: Memory = field(default_factory=Memory)
    measuring: Measuring | None = None
    values: list[Measured] = field(default_factory=list)  # all that were measured in the run
    spoilt: list[Spoilt] = field(default_factory=list)  # those of them that do not count any more
    told: list[str] = field(default_factory=list)  # what the end of the run tells
    part: tuple[float, ...] = ()  # where the part lies, if it was found out
    done: MutableSet[int] = field(default_factory=NumberSet)
    written: Written = field(default_factory=Written)
    outbox: list[Command] = field(default_factory=list)
    pending: list[Given] = field(default_factory=list)  # orders that came while an exception was handled
    sent: dict[int, tuple[dict[str, Any], int]] = field(
        default_factory=dict
    )  # under way, as noted, since when
    noted: int = 0  # the record from which those to the next checkpoint count
    every: int = EVERY
    checkpoint: Checkpoint | None = None
    entire: Callable[[], Compiled] | None = (
        None  # the program with steps that were done before the run was taken up again
    )
    turn: Turn | None = None
    accuracy: Accuracy = field(default_factory=Accuracy)  # of the forecasts of this run, as far as it is
    interrupts: bool = False  # it was told to pause, and has not yet
    review: str = ""  # why what is left of the plan is to be looked at again
    off_ms: int = 0  # how far behind its forecast the run was when the plan was made, or last reviewed
    calm: int = 1  # twice as much as before has to change after each review that came to nothing
    looked: tuple[int, frozenset[int]] | None = (
        None  # how it stood when the plan was last reviewed for nothing
    )
    way: tuple[tuple[Atom, ...], frozenset[Atom], Plan | None] | None = (
        None  # how to take something away, as asked last
    )
    waited: frozenset[int] = frozenset()  # what was under way when something was last waited for
    since: dict[Atom, int] = field(default_factory=dict)  # when facts became true, and measurements began
    measured: str = ""  # what facts of measurements that are made are called
    look: Callable[[RunState], None] | None = None
    paths: "Paths | None" = None  # of a run with motion: what the arm can do
    unsent: list[Reply] = field(
        default_factory=list
    )  # to commands that are not sent, because they have no motion
    gate: PlanGate = field(default_factory=PlanGate)  # it keeps what it knows of the cell

    def __post_init__(self) -> None:
        self.replies = Replies(self.compiled)

    def follow(self, compiled: Compiled, standing: Standing) -> None:
        """Go on with another program."""
        self.compiled, self.standing = compiled, standing
        self.replies = Replies(compiled)
        self.done, self.review, self.off_ms = NumberSet(), "", 0
        self.waited, self.looked = frozenset(), None
        self.sent = {number: self._renumbered(number) for number in standing.running}
        self.entire = None

    def whole(self) -> Compiled:
        """The program with all steps of the plan, also those that were done before the run was taken up again."""
        return self.compiled if self.entire is None else self.entire()

    def planned(self, entry: dict[str, Any]) -> None:
        """Note the plan that is followed from now on."""
        number = self.recorder.note(RecordKind.PLAN, **entry).number
        self.written.plan(number, entry)

    def _renumbered(self, number: int) -> tuple[dict[str, Any], int]:
        """What was noted of a command that is under way, for the number that its step has now."""
        content, at_ms = self.sent[number]
        return {**content, "step": self.standing.running[number].activity}, at_ms

    def post(self, command: Command, step: int | None = None, sent: bool = True) -> None:
        """Note a command, to be sent once the note is on the disk; unless it is not to be sent."""
        command = replace(command, part=self.part) if self.part and command.kind in PLACED else command
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
            **looked_at(command),
        )
        self.sent[command.number] = (dict(record.content), record.at_ms)
        self.outbox += [command] if sent else []

    def dispatch(self, sent: executive.Dispatch) -> None:
        """Post the command of an activity, a WAIT or a CONTINUE."""
        if sent.activity is None:
            kind = CommandKind.WAIT if sent.about is None else CommandKind.CONTINUE
            self.post(Command(sent.number, kind, sent.stream, kind.value, about=sent.about))
            return
        each = self.compiled.program.activities[sent.activity]
        why = refusal(self.paths, self.world.facts, self.compiled, self.standing, sent.number, each)
        self.post(command_of(sent.number, lasting(self.paths, sent.number, each)), each.id, sent=not why)
        if why:
            self.unsent.append(Reply(sent.number, NO_MOTION, self.driver.now_ms(), {"why": why}))

    def ended(self, ended: executive.Done) -> None:
        """Let the world model follow a step that has ended, and note what it has changed."""
        activity, change = ended.activity, self.compiled.changes[ended.activity]
        new = [atom for atom in (*change.adds, *change.events) if atom not in self.world.facts]
        moved = self.world.apply(change)
        self.done.add(activity)
        self.written.done.add(activity)
        if self.compiled.program.timed:
            self.since |= {
                atom: ended.started_ms if atom.name == self.measured else self.standing.now_ms for atom in new
            }
        self._look_at_the_forecast(activity, ended.started_ms)
        self.sent.pop(ended.number, None)
        work = achievement(len(self.history) + 1, self.replies.step(activity), new, moved)
        if self.memory.keeps(work):
            self.history.append(work)
        self.recorder.note(
            RecordKind.DONE,
            step=activity,
            command=ended.number,
            action=self.compiled.program.activities[activity].action,
            started_ms=ended.started_ms,
            **_changes(change),
            moved=[[chain, number, str(atom)] for chain, number, atom in moved],
            **arms(self.paths, ended.number),
        )
        for chain, _, atom in moved:
            self.recorder.note(RecordKind.GOAL, goal=f"{atom} of {chain}")

    def _look_at_the_forecast(self, activity: int, started_ms: int) -> None:
        """Ask for a review of the plan if this step has ended much later, or sooner, than it was forecast to."""
        each = self.compiled.program.activities[activity]
        self.accuracy = self.accuracy.after(self.standing.now_ms - started_ms, each.lasts_ms)
        off = self.standing.now_ms - (each.start_ms + each.lasts_ms)
        if abs(off - self.off_ms) >= self.calm * max(NOTICED_MS, each.lasts_ms // 10):
            self.off_ms, self.review = off, self.review or OTHERWISE

    def result(self, activity: int, reply: Reply) -> None:
        """Note the fact that a reply gives, and the value that was measured with its verdict."""
        said, step = self.replies.result(activity, reply.text), self.replies.step(activity)
        found = self.measuring.heard(step, reply.text, reply.at_ms) if self.measuring is not None else None
        if said is None and found is None:
            return
        if found is not None:
            self.values.append(found)
        verdict = {} if found is None else {name: getattr(found, name) for name in VERDICT}
        action = self.compiled.program.activities[activity].action
        fact = "" if said is None else str(said)
        self.recorder.note(RecordKind.RESULT, command=reply.number, action=action, result=fact, **verdict)

    def threatened(self, threat: executive.Threatened) -> None:
        """Tell that something stays too long, or will."""
        target = self.compiled.program.activities[threat.dwell.target]
        said = "it stays too long" if threat.over else "as things stand, it will stay too long"
        late = f"by {round(threat.late_ms / 1000, 3):g} s at least"
        if threat.over:
            self.told.append(f"what {target.action} takes away stayed too long (longest_stay), {late}")
        self.recorder.note(
            RecordKind.EXCEPTION,
            exception="stays_too_long",
            known=True,
            step=threat.dwell.target,
            action=target.action,
            command=None,
            reply=f"{said}: {late}",
        )


@lru_cache(1 << 12)
def _changes(change: StepChange) -> Mapping[str, list[str]]:
    """What a step changes, as a record has it."""
    return {
        "adds": list(map(str, change.adds)),
        "ends": list(map(str, change.ends)),
        "events": list(map(str, change.events)),
    }


def looked_at(command: Command) -> dict[str, list[Any]]:
    """What a command's device looks at, and where the part lies, as a record has it; nothing where nothing is said."""
    found: dict[str, list[Any]] = {
        "looks": list(command.looks),
        "watches": list(command.watches),
        "part": list(command.part),
    }
    return {key: value for key, value in found.items() if value}
