"""Resuming a run from its journal: what it says, and what became of commands under way.

What the journal says is believed. What became of the commands that were under way, the driver is
asked; none of them is sent again unless the driver says that it never came.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from cellwright.engine.model.run_protocol import (
    CommandKind,
    DriverCommand,
    Fate,
    JournalRecord,
    NumberSet,
    OperatorCommand,
    RecordKind,
    Reply,
    Report,
    RunPhase,
)
from cellwright.engine.model.verdicts import Spoilt
from cellwright.engine.pipelines.execution.compiled_program import CompiledProgram, with_queues
from cellwright.engine.pipelines.execution.inspector import ALIGNED, scope_of_located_part
from cellwright.engine.pipelines.execution.plan_records import (
    activity_of,
    compiled_of,
    read_ground_atom,
    scope_of,
)
from cellwright.engine.pipelines.execution.run_goals import RunScope, extend_problem, read_addition
from cellwright.engine.pipelines.execution.run_loop import RunLoop
from cellwright.engine.pipelines.execution.run_progress import WrittenPlan, head_of
from cellwright.engine.pipelines.recovery import KeptHistory, StepAchievement, SymbolicWorld
from cellwright.engine.pipelines.recovery.symbolic_world import achievement_of
from cellwright.engine.ports import Driver, Simulated
from cellwright.engine.stages import execution as executive
from cellwright.engine.stages.execution import ExecutiveState, Running, standing_of, unrested_after
from cellwright.engine.stages.execution.start_forecast import Accuracy
from cellwright.kb.garbage_collection import no_search_for_cycles
from cellwright.kb.model.measured_results import Measured
from cellwright.kb.terms import Atom

Content = Mapping[str, Any]
RENOTED_KINDS = (  # what a case notes in the same order whenever it is taken up again
    RecordKind.EXCEPTION,
    RecordKind.COMMAND,
    RecordKind.REPLY,
    RecordKind.FINDING,
    RecordKind.DIAGNOSIS,
    RecordKind.WORLD,
    RecordKind.GIVEN_UP,
)


@dataclass
class PastRun:
    """What a journal says of a run, up to its last record.

    `plan` is the last one, `done` its steps that have ended (with when), `sent` the commands of it
    that have no reply. `case` are the records since the exception that was being handled when the
    run ended; empty if none was.
    """

    world: SymbolicWorld
    scope: RunScope
    memory: KeptHistory = field(default_factory=KeptHistory)
    plan: Content | None = None
    done: dict[int, int] = field(default_factory=dict)
    sent: dict[int, tuple[Content, int]] = field(default_factory=dict)
    history: list[StepAchievement] = field(default_factory=list)
    case: list[JournalRecord] = field(default_factory=list)
    cases: dict[tuple[str, str], int] = field(default_factory=dict)
    number: int = 1  # of the next command
    last: int = 0
    at_ms: int = 0
    forecast_ms: int = 0
    exceptions: int = 0
    steps: int = 0
    ended: str = ""
    paused: bool = False
    run: Content = field(default_factory=dict)  # what it was begun with
    plan_number: int = 0  # of the record that holds the steps of the last plan
    checkpoint: int = 0  # the number of the last one
    told: int = 0  # so much of the history was written before it
    entire: Callable[[], CompiledProgram] | None = (
        None  # the last plan with steps that a checkpoint has left out
    )
    accuracy: Accuracy = field(default_factory=Accuracy)
    steps_by_number: dict[int, Content] = field(default_factory=dict)  # of the plan
    unrested: frozenset[str] = frozenset()  # hands that hold something on the way to a goal
    replans: bool = False  # the last plan leads nowhere any more
    added: str = ""
    additions: list[dict[str, Any]] = field(
        default_factory=list
    )  # further commands, as a checkpoint has them
    # when facts became true, and measurements began
    since: dict[Atom, int] = field(default_factory=dict)
    lying: Content = field(default_factory=dict)  # the record that says where the part lies
    measured: list[Measured] = field(default_factory=list)
    spoilt: list[Spoilt] = field(default_factory=list)  # values that do not count any more
    met: dict[str, Any] = field(default_factory=dict)  # bodies that were seen, as records have them
    arms: dict[str, Any] = field(default_factory=dict)  # where the arms are, as records have it

    def __post_init__(self) -> None:
        self.whole = self.scope.problem  # with what was added

    def take(self, record: JournalRecord) -> None:
        """Take in a record."""
        self.last, self.at_ms = record.number, record.at_ms
        if record.kind is not RecordKind.END and self.case:
            self._in_case(record)
        move = READER_OF_RECORD.get(record.kind)
        if move is not None:
            move(self, record)

    def _in_case(self, record: JournalRecord) -> None:
        if record.kind in RENOTED_KINDS:
            self.case.append(record)

    def begun(self, record: JournalRecord) -> None:
        """The run begins."""
        self.run = record.content

    def planned(self, record: JournalRecord) -> None:
        """Another plan: what was left of the old one is forgotten."""
        content = record.content
        if content["why"] == OperatorCommand.ADD.value:
            behind = {} if self.plan is None else head_of(self.plan)
            self.extend(
                {"given": self.added, "wishes": content.get("wishes", []), "behind": behind}
            )
        first = not self.forecast_ms or content["why"] == ALIGNED
        self.forecast_ms = content["forecast_ms"] if first else self.forecast_ms
        self.steps += len(self.done)
        self.entire = None
        self._closed()
        self.done = {}
        self.sent = {
            number: ({**self.sent[number][0], "step": step}, self.sent[number][1])
            for number, step in content.get("running", ())
        }
        self.paused = self.replans = False
        self.unrested = frozenset(content.get("full", ()))
        self.follow(content, record.number)

    def aligned(self, record: JournalRecord) -> None:
        """It was found out where the part lies: what is pursued from then on is about the part
        there.
        """
        if record.content["part"]:
            self.lies({**record.content, "at_ms": record.at_ms})

    def lies(self, content: Content) -> None:
        """The part lies where a record says, which has `at_ms` as well."""
        self.lying = content
        self.scope = scope_of_located_part(self.whole, self.scope, content)

    def _closed(self) -> None:
        """The case is over, with a way on: its exceptions count if they come again."""
        for content in (
            record.content for record in self.case if record.kind is RecordKind.EXCEPTION
        ):
            if content["exception"] != "stays_too_long":
                key = content["exception"], content["action"]
                self.cases[key] = self.cases.get(key, 0) + 1
        self.case = []

    def extend(self, added: dict[str, Any]) -> None:
        """A further command was taken up, behind a plan whose record says `behind` beside its
        steps.
        """
        if added["behind"]:
            self.scope = scope_of(self.scope, added["behind"])
        words = read_addition(self.scope.problem, added["given"]).words
        self.whole = extend_problem(self.whole, words, ())
        wishes = tuple(map(read_ground_atom, added["wishes"]))
        self.scope = replace(self.scope, problem=extend_problem(self.scope.problem, words, wishes))
        self.additions.append(added)

    def follow(self, content: Content, number: int) -> None:
        """The plan in the record of this number is the one that is followed."""
        self.plan, self.plan_number = content, number
        self.steps_by_number = {step["id"]: step for step in content["steps"]}
        self.scope = scope_of(self.scope, content)
        self.world.chains = self.scope.problem.chains
        for chain in self.world.chains:
            self.world.reached.setdefault(chain.name, 0)

    def ordered(self, record: JournalRecord) -> None:
        """An order was given; a further command is understood again where a plan took it up."""
        if record.content["order"] == OperatorCommand.ADD.value:
            self.added = record.content["given"]

    def command(self, record: JournalRecord) -> None:
        """A command was noted; it may have been sent."""
        self.number = max(self.number, record.content["command"] + 1)
        self.sent[record.content["command"]] = (record.content, record.at_ms)

    def reply(self, record: JournalRecord) -> None:
        """A single command was answered. That of a step is settled when the step is done."""
        content, _ = self.sent.get(record.content["command"], ({}, 0))
        if content.get("step") is None:
            self.sent.pop(record.content["command"], None)

    def did(self, record: JournalRecord) -> None:
        """A step has changed the world."""
        content = record.content
        new = [read_ground_atom(atom) for atom in (*content["adds"], *content["events"])]
        fresh = [atom for atom in new if atom not in self.world.facts]
        self.world.facts -= {read_ground_atom(atom) for atom in content["ends"]}
        self.world.facts |= {read_ground_atom(atom) for atom in content["adds"]}
        moved = [
            (chain, number, read_ground_atom(atom)) for chain, number, atom in content["moved"]
        ]
        for chain, number, _ in moved:
            self.world.reached[chain] = number
        self.arms |= content.get("arms", {})
        self.done[content["step"]] = record.at_ms
        self._ended(content["step"], record.at_ms - content["started_ms"])
        if self.plan is not None and self.plan["timed"]:
            measured, began = self.scope.problem.domain.conventions.measured, content["started_ms"]
            self.since |= {atom: began if atom.name == measured else record.at_ms for atom in fresh}
        self.sent.pop(content["command"], None)
        work = achievement_of(
            len(self.history) + 1, read_ground_atom(content["action"]), fresh, moved
        )
        if self.memory.keeps(work):
            self.history.append(work)

    def _ended(self, step: int, lasted_ms: int) -> None:
        """Follow what is in the hands, and how long steps take beside their forecasts."""
        if self.plan is not None and (entry := self.steps_by_number.get(step)) is not None:
            activity = activity_of(entry)
            self.unrested = unrested_after(self.unrested, activity, self.plan.get("hands", ()))
            self.accuracy = self.accuracy.after(lasted_ms, activity.lasts_ms)

    def corrected(self, record: JournalRecord) -> None:
        """The world model was corrected."""
        if self.case:
            return  # the case is taken up again from its beginning, and notes this again
        self._become(record.content)

    def _become(self, content: Content) -> None:
        self.world.facts -= {read_ground_atom(atom) for atom in content["ends"]}
        self.world.facts |= {read_ground_atom(atom) for atom in content["adds"]}
        self.world.reached.update(content["reached"])
        self.met |= content.get("bodies", {})

    def failed(self, record: JournalRecord) -> None:
        """An exception: what follows belongs to its case, until there is a plan again."""
        if record.content["exception"] == "stays_too_long" or self.case:
            return
        self.exceptions += 1
        self.case = [record]
        self.sent.pop(record.content["command"], None)

    def phase(self, record: JournalRecord) -> None:
        """The run paused or went on."""
        self.paused = record.content["phase"] == RunPhase.PAUSED.value

    def end(self, record: JournalRecord) -> None:
        """The run ended. A case that ended it is over: what it has found in the world counts."""
        self.ended = record.content["outcome"]
        self.replans = self.replans or bool(self.case)
        for case_record in self.case:
            if case_record.kind is RecordKind.WORLD:
                self._become(case_record.content)
        self.case = []
        self.cases = {}  # what failed was put right before the run is taken up again
        if self.ended == "stopped":
            self.met = {}  # and what was in the way was taken away

    def under_way(self) -> Mapping[int, tuple[Content, int]]:
        """The commands for steps that have not been settled, and when they were sent."""
        return {
            number: command
            for number, command in self.sent.items()
            if command[0].get("step") is not None
        }

    def written(self) -> WrittenPlan:
        """What the journal holds of the plan."""
        assert self.plan is not None
        state_written = WrittenPlan(
            done=NumberSet(self.done), checkpoint=self.checkpoint, history=self.told
        )
        state_written.number, state_written.steps, state_written.head = (
            self.plan_number,
            len(self.plan["steps"]),
            head_of(self.plan),
        )
        return state_written

    @property
    def next_number(self) -> int:
        """The number of the next command; a case that is taken up again begins with the number
        it had.
        """
        numbers = [
            record.content["command"] for record in self.case if record.kind is RecordKind.COMMAND
        ]
        return min(numbers, default=self.number)


READER_OF_RECORD = {
    RecordKind.RUN: PastRun.begun,
    RecordKind.PLAN: PastRun.planned,
    RecordKind.COMMAND: PastRun.command,
    RecordKind.REPLY: PastRun.reply,
    RecordKind.DONE: PastRun.did,
    RecordKind.ALIGNMENT: PastRun.aligned,
    RecordKind.WORLD: PastRun.corrected,
    RecordKind.EXCEPTION: PastRun.failed,
    RecordKind.PHASE: PastRun.phase,
    RecordKind.ORDER: PastRun.ordered,
    RecordKind.END: PastRun.end,
}


def settle_commands(course: RunLoop, past: PastRun) -> None:
    """Take in what has ended meanwhile, send what never came, and wait on for what goes on.

    The clock is brought to where the journal ends first. Failures are taken in before anything
    else, so that nothing begins.
    """
    heard: list[Reply] = []
    while course.driver.now_ms() < past.at_ms:
        came = course.driver.receive(past.at_ms)
        heard += [message for message in came if isinstance(message, Reply)]
        if not came and course.driver.tick_ms is None:
            break
    course.standing = replace(course.standing, now_ms=course.driver.now_ms())
    numbers = sorted(past.under_way())
    reports = course.driver.report(numbers)
    ended = {
        report.number: report.reply
        for report in reports
        if report.fate is Fate.ENDED and report.reply is not None
    }
    ended |= {reply.number: reply for reply in heard if reply.number in course.standing.running}
    _send_again(course, past, reports)
    for reply in sorted(
        ended.values(), key=lambda answer: (_is_normal(course, answer), answer.at_ms, answer.number)
    ):
        course.hear(reply)
    course.flush()


def _is_normal(course: RunLoop, reply: Reply) -> bool:
    running = course.standing.running.get(reply.number)
    return running is not None and course.replies.is_normal(running.activity, reply.text)


def _send_again(course: RunLoop, past: PastRun, reports: Sequence[Report]) -> None:
    """Send the commands that the driver has never received; those that it has dropped can begin
    anew.
    """
    under_way = past.under_way()
    lost = [report.number for report in reports if report.fate is Fate.UNKNOWN]
    course.outbox += [_command_from(under_way[number][0]) for number in lost]
    dropped = {report.number for report in reports if report.fate is Fate.DROPPED}
    if dropped:
        standing = course.standing
        running = {n: command for n, command in standing.running.items() if n not in dropped}
        course.standing = executive.standing_of(
            course.compiled.program,
            standing.now_ms,
            standing.number,
            standing.phase,
            past.done,
            running,
            past.done,
            standing.unrested,
        )


def _command_from(entry: Content) -> DriverCommand:
    return DriverCommand(
        entry["command"],
        CommandKind(entry["command_kind"]),
        entry["stream"],
        entry["action"],
        entry["says"],
        entry["expects"],
        tuple(entry["choices"]),
        entry["lasts_ms"],
        entry["timeout_ms"],
        entry["about"],
        entry["asks"],
        tuple(entry.get("looks", ())),
        tuple(entry.get("watches", ())),
    )


def taken_up(
    past: PastRun, lookahead: Callable[[str], int], now_ms: int
) -> tuple[CompiledProgram, ExecutiveState]:
    """The last program of a run, and where it stood.

    `lookahead` tells how many commands a stream takes at once.
    """
    assert past.plan is not None
    with no_search_for_cycles():
        compiled = with_queues(compiled_of(past.plan), lookahead)
        return compiled, standing_again(compiled, past, now_ms)


def standing_again(compiled: CompiledProgram, past: PastRun, now_ms: int) -> ExecutiveState:
    """Where the last plan of a run stood when its journal ended: what was done, and what was
    under way.
    """
    running = {
        number: Running(entry["step"], at_ms) for number, (entry, at_ms) in past.under_way().items()
    }
    phase, number, unrested = RunPhase.RUNNING, past.next_number, frozenset(past.unrested)
    return standing_of(
        compiled.program, now_ms, number, phase, past.done, running, past.done, unrested
    )


def restore_loop(course: RunLoop, past: PastRun) -> None:
    """Give a course what the journal of its run holds: the plan's number, commands without a
    reply, steps that are done.
    """
    course.written = past.written()
    course.entire = past.entire
    course.sent = {number: (dict(entry), at_ms) for number, (entry, at_ms) in past.sent.items()}
    course.noted, course.since = course.recorder.last, dict(past.since)
    course.accuracy = past.accuracy
    course.done, course.history = NumberSet(past.done), past.history


def left_out(driver: Driver) -> tuple[str, ...]:
    """The faults that were ordered for a simulated cell, and for which there were too few steps."""
    unused = driver.not_come() if isinstance(driver, Simulated) else ()
    return tuple(f"{fault} did not come up: there were fewer such steps" for fault in unused)
