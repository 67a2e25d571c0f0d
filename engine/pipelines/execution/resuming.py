"""Takes a run up again from its journal, after a stop, a crash or a power failure.

What the journal says is believed. What became of the commands that were under way, the driver is asked; none of them is sent
again unless the driver says that it never came.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from cellwright.engine.model.execution import Order, Phase, Record, RecordKind
from cellwright.engine.model.number_set import NumberSet
from cellwright.engine.model.verdicts import Spoilt
from cellwright.engine.pipelines.execution.adding import addition, extended
from cellwright.engine.pipelines.execution.compiling import Compiled
from cellwright.engine.pipelines.execution.inspector import ALIGNED, there
from cellwright.engine.pipelines.execution.progress import Written, head_of
from cellwright.engine.pipelines.execution.records import activity_of, read_atom, scope_of
from cellwright.engine.pipelines.execution.scope import Scope
from cellwright.engine.pipelines.simulation import Achievement, Memory, SymbolicWorld
from cellwright.engine.pipelines.simulation.world import achievement
from cellwright.engine.stages.execution import unrested_after
from cellwright.engine.stages.execution.outlook import Accuracy
from cellwright.kb.model.results import Measured
from cellwright.kb.terms import Atom

Content = Mapping[str, Any]
REPEATED = (  # what a case notes in the same order whenever it is taken up again
    RecordKind.EXCEPTION,
    RecordKind.COMMAND,
    RecordKind.REPLY,
    RecordKind.FINDING,
    RecordKind.DIAGNOSIS,
    RecordKind.WORLD,
    RecordKind.GIVEN_UP,
)


@dataclass
class Past:
    """What a journal says of a run, up to its last record.

    `plan` is the last one, `done` its steps that have ended (with when), `sent` the commands of it that have no reply.
    `case` are the records since the exception that was being handled when the run ended; empty if none was.
    """

    world: SymbolicWorld
    scope: Scope
    memory: Memory = field(default_factory=Memory)
    plan: Content | None = None
    done: dict[int, int] = field(default_factory=dict)
    sent: dict[int, tuple[Content, int]] = field(default_factory=dict)
    history: list[Achievement] = field(default_factory=list)
    case: list[Record] = field(default_factory=list)
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
    entire: Callable[[], Compiled] | None = None  # the last plan with steps that a checkpoint has left out
    accuracy: Accuracy = field(default_factory=Accuracy)
    steps_by_number: dict[int, Content] = field(default_factory=dict)  # of the plan
    unrested: frozenset[str] = frozenset()  # hands that hold something on the way to a goal
    replans: bool = False  # the last plan leads nowhere any more
    added: str = ""
    additions: list[dict[str, Any]] = field(
        default_factory=list
    )  # further commands, as a checkpoint has them
    since: dict[Atom, int] = field(default_factory=dict)  # when facts became true, and measurements began
    lying: Content = field(default_factory=dict)  # the record that says where the part lies
    measured: list[Measured] = field(default_factory=list)
    spoilt: list[Spoilt] = field(default_factory=list)  # values that do not count any more
    met: dict[str, Any] = field(default_factory=dict)  # bodies that were seen, as records have them
    arms: dict[str, Any] = field(default_factory=dict)  # where the arms are, as records have it

    def __post_init__(self) -> None:
        self.whole = self.scope.problem  # with what was added

    def take(self, record: Record) -> None:
        """Take in a record."""
        self.last, self.at_ms = record.number, record.at_ms
        if record.kind is not RecordKind.END and self.case:
            self._in_case(record)
        move = MOVES.get(record.kind)
        if move is not None:
            move(self, record)

    def _in_case(self, record: Record) -> None:
        if record.kind in REPEATED:
            self.case.append(record)

    def begun(self, record: Record) -> None:
        """The run begins."""
        self.run = record.content

    def planned(self, record: Record) -> None:
        """Another plan: what was left of the old one is forgotten."""
        content = record.content
        if content["why"] == Order.ADD.value:
            behind = {} if self.plan is None else head_of(self.plan)
            self.extend({"given": self.added, "wishes": content.get("wishes", []), "behind": behind})
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

    def aligned(self, record: Record) -> None:
        """It was found out where the part lies: what is pursued from then on is about the part there."""
        if record.content["part"]:
            self.lies({**record.content, "at_ms": record.at_ms})

    def lies(self, content: Content) -> None:
        """The part lies where a record says, which has `at_ms` as well."""
        self.lying = content
        self.scope = there(self.whole, self.scope, content)

    def _closed(self) -> None:
        """The case is over, with a way on: its exceptions count if they come again."""
        for each in (record.content for record in self.case if record.kind is RecordKind.EXCEPTION):
            if each["exception"] != "stays_too_long":
                key = each["exception"], each["action"]
                self.cases[key] = self.cases.get(key, 0) + 1
        self.case = []

    def extend(self, added: dict[str, Any]) -> None:
        """A further command was taken up, behind a plan whose record says `behind` beside its steps."""
        if added["behind"]:
            self.scope = scope_of(self.scope, added["behind"])
        words = addition(self.scope.problem, added["given"]).words
        self.whole = extended(self.whole, words, ())
        wishes = tuple(map(read_atom, added["wishes"]))
        self.scope = replace(self.scope, problem=extended(self.scope.problem, words, wishes))
        self.additions.append(added)

    def follow(self, content: Content, number: int) -> None:
        """The plan in the record of this number is the one that is followed."""
        self.plan, self.plan_number = content, number
        self.steps_by_number = {each["id"]: each for each in content["steps"]}
        self.scope = scope_of(self.scope, content)
        self.world.chains = self.scope.problem.chains
        for chain in self.world.chains:
            self.world.reached.setdefault(chain.name, 0)

    def ordered(self, record: Record) -> None:
        """An order was given; a further command is understood again where a plan took it up."""
        if record.content["order"] == Order.ADD.value:
            self.added = record.content["given"]

    def command(self, record: Record) -> None:
        """A command was noted; it may have been sent."""
        self.number = max(self.number, record.content["command"] + 1)
        self.sent[record.content["command"]] = (record.content, record.at_ms)

    def reply(self, record: Record) -> None:
        """A single command was answered. That of a step is settled when the step is done."""
        content, _ = self.sent.get(record.content["command"], ({}, 0))
        if content.get("step") is None:
            self.sent.pop(record.content["command"], None)

    def did(self, record: Record) -> None:
        """A step has changed the world."""
        content = record.content
        new = [read_atom(each) for each in (*content["adds"], *content["events"])]
        fresh = [atom for atom in new if atom not in self.world.facts]
        self.world.facts -= {read_atom(each) for each in content["ends"]}
        self.world.facts |= {read_atom(each) for each in content["adds"]}
        moved = [(chain, number, read_atom(atom)) for chain, number, atom in content["moved"]]
        for chain, number, _ in moved:
            self.world.reached[chain] = number
        self.arms |= content.get("arms", {})
        self.done[content["step"]] = record.at_ms
        self._ended(content["step"], record.at_ms - content["started_ms"])
        if self.plan is not None and self.plan["timed"]:
            measured, began = self.scope.problem.domain.conventions.measured, content["started_ms"]
            self.since |= {atom: began if atom.name == measured else record.at_ms for atom in fresh}
        self.sent.pop(content["command"], None)
        work = achievement(len(self.history) + 1, read_atom(content["action"]), fresh, moved)
        if self.memory.keeps(work):
            self.history.append(work)

    def _ended(self, step: int, lasted_ms: int) -> None:
        """Follow what is in the hands, and how long steps take beside their forecasts."""
        if self.plan is not None and (entry := self.steps_by_number.get(step)) is not None:
            activity = activity_of(entry)
            self.unrested = unrested_after(self.unrested, activity, self.plan.get("hands", ()))
            self.accuracy = self.accuracy.after(lasted_ms, activity.lasts_ms)

    def corrected(self, record: Record) -> None:
        """The world model was corrected."""
        if self.case:
            return  # the case is taken up again from its beginning, and notes this again
        self._become(record.content)

    def _become(self, content: Content) -> None:
        self.world.facts -= {read_atom(each) for each in content["ends"]}
        self.world.facts |= {read_atom(each) for each in content["adds"]}
        self.world.reached.update(content["reached"])
        self.met |= content.get("bodies", {})

    def failed(self, record: Record) -> None:
        """An exception: what follows belongs to its case, until there is a plan again."""
        if record.content["exception"] == "stays_too_long" or self.case:
            return
        self.exceptions += 1
        self.case = [record]
        self.sent.pop(record.content["command"], None)

    def phase(self, record: Record) -> None:
        """The run paused or went on."""
        self.paused = record.content["phase"] == Phase.PAUSED.value

    def end(self, record: Record) -> None:
        """The run ended. A case that ended it is over: what it has found in the world counts."""
        self.ended = record.content["outcome"]
        self.replans = self.replans or bool(self.case)
        for each in self.case:
            if each.kind is RecordKind.WORLD:
                self._become(each.content)
        self.case = []
        self.cases = {}  # what failed was put right before the run is taken up again
        if self.ended == "stopped":
            self.met = {}  # and what was in the way was taken away

    def under_way(self) -> Mapping[int, tuple[Content, int]]:
        """The commands for steps that have not been settled, and when they were sent."""
        return {number: each for number, each in self.sent.items() if each[0].get("step") is not None}

    def written(self) -> Written:
        """What the journal holds of the plan."""
        assert self.plan is not None
        held = Written(done=NumberSet(self.done), checkpoint=self.checkpoint, history=self.told)
        held.number, held.steps, held.head = self.plan_number, len(self.plan["steps"]), head_of(self.plan)
        return held

    @property
    def next_number(self) -> int:
        """The number of the next command; a case that is taken up again begins with the number it had."""
        numbers = [each.content["command"] for each in self.case if each.kind is RecordKind.COMMAND]
        return min(numbers, default=self.number)


MOVES = {
    RecordKind.RUN: Past.begun,
    RecordKind.PLAN: Past.planned,
    RecordKind.COMMAND: Past.command,
    RecordKind.REPLY: Past.reply,
    RecordKind.DONE: Past.did,
    RecordKind.ALIGNMENT: Past.aligned,
    RecordKind.WORLD: Past.corrected,
    RecordKind.EXCEPTION: Past.failed,
    RecordKind.PHASE: Past.phase,
    RecordKind.ORDER: Past.ordered,
    RecordKind.END: Past.end,
}
