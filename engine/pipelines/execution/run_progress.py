"""Progress of a run: commands sent, replies matched, world model updated, everything noted."""

from collections.abc import Callable, Collection, Iterator, Mapping, MutableSet, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from cellwright.engine.model.run_protocol import (
    NO_MOTION,
    CommandKind,
    DriverCommand,
    NumberSet,
    RecordKind,
    Reply,
    RunPhase,
    RunState,
)
from cellwright.engine.model.verdicts import Spoilt
from cellwright.engine.pipelines.execution.compiled_program import (
    GRACE_MS,
    TIMEOUT_FACTOR,
    CompiledProgram,
)
from cellwright.engine.pipelines.execution.operator_orders import GivenOrder, OrderSource
from cellwright.engine.pipelines.execution.plan_records import read_ground_atom
from cellwright.engine.pipelines.execution.run_journal import Recorder
from cellwright.engine.pipelines.inspection.nominal_values import MeasurementJudge
from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.pipelines.recovery import KeptHistory, StepAchievement, SymbolicWorld
from cellwright.engine.pipelines.recovery.diagnosis_case import DiagnosisCase
from cellwright.engine.pipelines.recovery.symbolic_world import achievement_of
from cellwright.engine.ports import Driver
from cellwright.engine.stages import execution as executive
from cellwright.engine.stages.execution import Activity, ExecutiveState, Failure
from cellwright.engine.stages.execution.start_forecast import Accuracy
from cellwright.engine.stages.lifted.cell_domain import StepChange
from cellwright.kb.asp import AspError, ground_term
from cellwright.kb.model.fault_model import FaultModel
from cellwright.kb.model.measured_results import Measured
from cellwright.kb.model.plan_model import Plan
from cellwright.kb.terms import (
    Atom,
    Function,
    Term,
    Variable,
    is_ground,
    match_term,
    substitute_term,
)

if TYPE_CHECKING:
    from cellwright.engine.pipelines.execution.run_motions import RunPaths


def command_of(number: int, activity: Activity) -> DriverCommand:
    """The command with which an activity begins."""
    return DriverCommand(
        number,
        CommandKind.STEP,
        activity.stream,
        activity.action,
        activity.says,
        activity.expects,
        lasts_ms=activity.lasts_ms,
        timeout_ms=activity.timeout_ms,
        asks=activity.asks,
        looks=activity.looks,
        watches=activity.watches,
    )


def case_command(
    desk: DiagnosisCase, name: str, outcomes: Sequence[str], unit: Fraction
) -> DriverCommand:
    """The command for a test or a repair of a case, or for the question to a person; a unit of
    costs is so many ms.
    """
    model = desk.model
    action = model.tests.get(name) or model.repairs.get(name)
    lasts = int((action.duration or action.cost if action is not None else model.stop) * unit)
    kind = CommandKind.ASK
    if action is not None:
        kind = CommandKind.TEST if name in model.tests else CommandKind.REPAIR
    asks = kind is CommandKind.ASK or (action is not None and action.asks)
    says = desk.says(name) if action is not None else desk.session.diagnosis().question_text
    stream = "person" if asks else "cell"
    timeout = TIMEOUT_FACTOR * lasts + GRACE_MS
    return DriverCommand(
        0, kind, stream, name, says, "", tuple(outcomes), lasts, timeout, asks=asks
    )


class Replies:
    """The reply patterns of a program."""

    def __init__(self, compiled: CompiledProgram) -> None:
        self.compiled = compiled
        self._texts: dict[Term, str] = {}  # of the patterns without variables

    def step(self, activity: int) -> Function:
        """The step of an activity."""
        return read_ground_atom(self.compiled.program.activities[activity].action)

    def is_normal(self, activity: int, text: str) -> bool:
        """Whether a reply is the one that the domain expects."""
        return self._bindings(activity, text) is not None

    def result(self, activity: int, text: str) -> Term | None:
        """The fact that a normal reply gives; None if the domain wants none."""
        result = self.compiled.results.get(activity)
        bindings = None if result is None else self._bindings(activity, text)
        return None if result is None or bindings is None else substitute_term(result, bindings)

    def _bindings(self, activity: int, text: str) -> Mapping[Variable, Term] | None:
        pattern = self.compiled.expects[activity]
        if pattern not in self._texts:
            self._texts[pattern] = str(pattern) if is_ground(pattern) else ""
        if self._texts[pattern]:
            return {} if self._texts[pattern] == text else None
        return match_reply(pattern, text)


def match_reply(pattern: Term, text: str) -> Mapping[Variable, Term] | None:
    """What the variables of a reply pattern are in a reply; None if it is not the one that is
    expected.
    """
    try:
        return match_term(pattern, ground_term(text), {})
    except AspError:
        return None


def exception_of(base: FaultModel | None, step: Function, reply: str) -> str | None:
    """The exception of the fault base that a reply to a step is; None if it knows none."""
    if base is None:
        return None
    fitting = [
        known_exception
        for known_exception in base.exceptions.values()
        if known_exception.operator is None
        or match_term(known_exception.operator, step, {}) is not None
    ]
    return next(
        (known_exception.name for known_exception in fitting if known_exception.reply == reply),
        None,
    )


def motion_refusal(
    paths: "RunPaths | None",
    facts: Collection[Atom],
    compiled: CompiledProgram,
    standing: ExecutiveState,
    number: int,
    activity: Activity,
) -> str:
    """Why a step has no motion in the cell as it is believed to be, as the command of that number;
    empty if it has one.

    The commands that are before it in the queue of its device will have ended.
    """
    if paths is None:
        return ""
    before = frozenset(facts)
    for _, running in sorted(standing.running.items()):
        earlier = compiled.program.activities[running.activity]
        if earlier.stream == activity.stream and earlier.id != activity.id:
            before = _facts_after(before, compiled.changes[earlier.id])
    return paths.refusal(
        number,
        read_ground_atom(activity.action),
        before,
        _facts_after(before, compiled.changes[activity.id]),
    )


def with_motion_time(paths: "RunPaths | None", number: int, activity: Activity) -> Activity:
    """A step that was looked at as the command of that number, with the time of its motion in
    place of the forecast.
    """
    lasts = paths.lasts_ms(number) if paths is not None else None
    return activity if lasts is None else replace(activity, lasts_ms=lasts)


def _facts_after(facts: frozenset[Atom], change: StepChange) -> frozenset[Atom]:
    return (facts - frozenset(change.ends)) | frozenset(change.adds)


def arms_entry(paths: "RunPaths | None", number: int) -> dict[str, Any]:
    """Where the arms are that a step has moved, as its record has it."""
    places = paths.done(number) if paths is not None else {}
    return {"arms": places} if places else {}


PLACED_KINDS = (
    CommandKind.STEP,
    CommandKind.TEST,
    CommandKind.REPAIR,
)  # commands that may move along the part
RECORDS_PER_CHECKPOINT = 5_000  # records from one checkpoint to the next
# by which a step may end later or sooner than forecast before the plan is looked at again
NOTICED_MS = 30_000
FORECAST_MISSED = "steps take longer or less than was forecast"
GROWING_KEYS = (
    "steps",
    "order",
    "dwells",
    "running",
    "full",
    "ahead",
    "pages",
)  # what of a plan's record grows with the plan, or is true only once
VERDICT_FIELDS = (
    "of", "quantity", "value", "unit", "nominal", "lower", "upper", "uncertainty", "risk",
    "passed", "tool",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class LoopTurn:
    """Why the loop came back: every step is done, something failed, an order needs more than the
    table, the rest of the plan is to be reviewed, or the run is over.
    """

    phase: RunPhase
    failures: tuple[Failure, ...] = ()
    given: GivenOrder | None = None
    why: str = ""
    review: bool = False
    idle: bool = False  # nothing can begin before something ends that needs no hand


def head_of(entry: Mapping[str, Any]) -> dict[str, Any]:
    """What the record of a plan says beside its steps."""
    return {key: value for key, value in entry.items() if key not in GROWING_KEYS}


@dataclass
class WrittenPlan:
    """What the journal holds of the plan: `number` is that of the record with its steps, of which
    so many were `steps`.

    `done` are those of them that have ended since. `head` is what the record says beside the steps.
    `checkpoint` is the number of the last checkpoint, until which so much of the run's `history` is
    written.
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
    """What a checkpoint holds: how the run stands, and what is left of its plan, page by page,
    if it is time to write that.
    """

    state: Callable[[], dict[str, Any]]
    rest: Callable[[], Iterator[dict[str, Any]]]


@dataclass
class RunProgress:
    """How far the execution of programs, one after another, is in one world."""

    run: str
    driver: Driver
    recorder: Recorder
    orders: OrderSource
    world: SymbolicWorld
    compiled: CompiledProgram
    standing: ExecutiveState
    history: list[StepAchievement] = field(default_factory=list)
    memory: KeptHistory = field(default_factory=KeptHistory)
    measuring: MeasurementJudge | None = None
    values: list[Measured] = field(default_factory=list)  # all that were measured in the run
    spoilt: list[Spoilt] = field(default_factory=list)  # those of them that do not count any more
    told: list[str] = field(default_factory=list)  # what the end of the run tells
    part: tuple[float, ...] = ()  # where the part lies, if it was found out
    done: MutableSet[int] = field(default_factory=NumberSet)
    written: WrittenPlan = field(default_factory=WrittenPlan)
    outbox: list[DriverCommand] = field(default_factory=list)
    # orders that came while an exception was handled
    pending: list[GivenOrder] = field(default_factory=list)
    sent: dict[int, tuple[dict[str, Any], int]] = field(
        default_factory=dict
    )  # under way, as noted, since when
    noted: int = 0  # the record from which those to the next checkpoint count
    every: int = RECORDS_PER_CHECKPOINT
    checkpoint: Checkpoint | None = None
    entire: Callable[[], CompiledProgram] | None = (
        None  # the program with steps that were done before the run was taken up again
    )
    turn: LoopTurn | None = None
    # of the forecasts of this run, as far as it is
    accuracy: Accuracy = field(default_factory=Accuracy)
    interrupts: bool = False  # it was told to pause, and has not yet
    review: str = ""  # why what is left of the plan is to be looked at again
    # how far behind its forecast the run was when the plan was made, or last reviewed
    off_ms: int = 0
    calm: int = 1  # twice as much as before has to change after each review that came to nothing
    looked: tuple[int, frozenset[int]] | None = (
        None  # how it stood when the plan was last reviewed for nothing
    )
    way: tuple[tuple[Atom, ...], frozenset[Atom], Plan | None] | None = (
        None  # how to take something away, as asked last
    )
    waited: frozenset[int] = frozenset()  # what was under way when something was last waited for
    # when facts became true, and measurements began
    since: dict[Atom, int] = field(default_factory=dict)
    measured: str = ""  # what facts of measurements that are made are called
    look: Callable[[RunState], None] | None = None
    paths: "RunPaths | None" = None  # of a run with motion: what the arm can do
    unsent: list[Reply] = field(
        default_factory=list
    )  # to commands that are not sent, because they have no motion
    gate: PlanGate = field(default_factory=PlanGate)  # it keeps what it knows of the cell

    def __post_init__(self) -> None:
        self.replies = Replies(self.compiled)

    def follow(self, compiled: CompiledProgram, standing: ExecutiveState) -> None:
        """Go on with another program."""
        self.compiled, self.standing = compiled, standing
        self.replies = Replies(compiled)
        self.done, self.review, self.off_ms = NumberSet(), "", 0
        self.waited, self.looked = frozenset(), None
        self.sent = {number: self._renumbered(number) for number in standing.running}
        self.entire = None

    def whole(self) -> CompiledProgram:
        """The program with all steps of the plan, also those that were done before the run was
        taken up again.
        """
        return self.compiled if self.entire is None else self.entire()

    def planned(self, entry: dict[str, Any]) -> None:
        """Note the plan that is followed from now on."""
        number = self.recorder.note(RecordKind.PLAN, **entry).number
        self.written.plan(number, entry)

    def _renumbered(self, number: int) -> tuple[dict[str, Any], int]:
        """What was noted of a command that is under way, for the number that its step has now."""
        content, at_ms = self.sent[number]
        return {**content, "step": self.standing.running[number].activity}, at_ms

    def post(self, command: DriverCommand, step: int | None = None, sent: bool = True) -> None:
        """Note a command, to be sent once the note is on the disk; unless it is not to be sent."""
        command = (
            replace(command, part=self.part)
            if self.part and command.kind in PLACED_KINDS
            else command
        )
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
            **looks_entry(command),
        )
        self.sent[command.number] = (dict(record.content), record.at_ms)
        self.outbox += [command] if sent else []

    def dispatch(self, sent: executive.Dispatch) -> None:
        """Post the command of an activity, a WAIT or a CONTINUE."""
        if sent.activity is None:
            kind = CommandKind.WAIT if sent.about is None else CommandKind.CONTINUE
            self.post(DriverCommand(sent.number, kind, sent.stream, kind.value, about=sent.about))
            return
        activity = self.compiled.program.activities[sent.activity]
        why = motion_refusal(
            self.paths, self.world.facts, self.compiled, self.standing, sent.number, activity
        )
        self.post(
            command_of(sent.number, with_motion_time(self.paths, sent.number, activity)),
            activity.id,
            sent=not why,
        )
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
                atom: ended.started_ms if atom.name == self.measured else self.standing.now_ms
                for atom in new
            }
        self._look_at_the_forecast(activity, ended.started_ms)
        self.sent.pop(ended.number, None)
        work = achievement_of(len(self.history) + 1, self.replies.step(activity), new, moved)
        if self.memory.keeps(work):
            self.history.append(work)
        self.recorder.note(
            RecordKind.DONE,
            step=activity,
            command=ended.number,
            action=self.compiled.program.activities[activity].action,
            started_ms=ended.started_ms,
            **_change_entry(change),
            moved=[[chain, number, str(atom)] for chain, number, atom in moved],
            **arms_entry(self.paths, ended.number),
        )
        for chain, _, atom in moved:
            self.recorder.note(RecordKind.GOAL, goal=f"{atom} of {chain}")

    def _look_at_the_forecast(self, activity: int, started_ms: int) -> None:
        """Ask for a review of the plan if this step has ended much later, or sooner, than it
        was forecast to.
        """
        own_activity = self.compiled.program.activities[activity]
        self.accuracy = self.accuracy.after(
            self.standing.now_ms - started_ms, own_activity.lasts_ms
        )
        longest = own_activity.longest_ms
        if own_activity.rule is not None and (
            longest is None or self.standing.now_ms - started_ms <= longest
        ):
            return  # a policy has reckoned with it
        off = self.standing.now_ms - (own_activity.start_ms + own_activity.lasts_ms)
        if abs(off - self.off_ms) >= self.calm * max(NOTICED_MS, own_activity.lasts_ms // 10):
            self.off_ms, self.review = off, self.review or FORECAST_MISSED

    def result(self, activity: int, reply: Reply) -> None:
        """Note the fact that a reply gives, and the value that was measured with its verdict."""
        fact_given, step = self.replies.result(activity, reply.text), self.replies.step(activity)
        measured = (
            self.measuring.heard(step, reply.text, reply.at_ms)
            if self.measuring is not None
            else None
        )
        if fact_given is None and measured is None:
            return
        if measured is not None:
            self.values.append(measured)
        verdict = (
            {} if measured is None else {name: getattr(measured, name) for name in VERDICT_FIELDS}
        )
        action = self.compiled.program.activities[activity].action
        fact = "" if fact_given is None else str(fact_given)
        self.recorder.note(
            RecordKind.RESULT, command=reply.number, action=action, result=fact, **verdict
        )

    def threatened(self, threat: executive.Threatened) -> None:
        """Tell that something stays too long, or will."""
        target = self.compiled.program.activities[threat.dwell.target]
        thing = threat.dwell.thing or f"what {target.action} takes away"
        place = f"in {threat.dwell.place}" if threat.dwell.place else "in its place"
        late = f"at least {round(threat.late_ms / 1000, 3):g} s too long {place}"
        if threat.over:
            self.told.append(f"{thing} was {late}")
        self.recorder.note(
            RecordKind.EXCEPTION,
            exception="stays_too_long",
            known=True,
            step=threat.dwell.target,
            action=target.action,
            command=None,
            reply=f"{thing} is {late}"
            if threat.over
            else f"as things stand, {thing} will be {late}",
        )


@lru_cache(1 << 12)
def _change_entry(change: StepChange) -> Mapping[str, list[str]]:
    """What a step changes, as a record has it."""
    return {
        "adds": list(map(str, change.adds)),
        "ends": list(map(str, change.ends)),
        "events": list(map(str, change.events)),
    }


def looks_entry(command: DriverCommand) -> dict[str, list[Any]]:
    """What a command's device looks at, and where the part lies, as a record has it; nothing
    where nothing is said.
    """
    entry: dict[str, list[Any]] = {
        "looks": list(command.looks),
        "watches": list(command.watches),
        "part": list(command.part),
    }
    return {key: value for key, value in entry.items() if value}
