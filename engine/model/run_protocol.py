"""Execution: commands, replies, journal records, the state of a run, and finished steps.

Times in `_ms` are integers: milliseconds of the driver's clock since the run began. All texts that
name steps, facts and replies are ASP terms, as everywhere else.
"""

from collections.abc import Iterable, Iterator, Mapping, MutableSet
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

# in the data of a reply: bodies that the arm has met, or that a sensor has seen
BODIES_SEEN = "seen"
# the reply of an arm that something has stopped: it is where it was before the step
OBSTRUCTED_REPLIES = "obstructed"
# what the journal has for an order to take a run up again, which no run that goes on can be given
TAKEN_UP_AGAIN = "resume"
# what a command has for a reply that began, and of which nobody knows how it ended
UNSURE_REPLY = "outcome_unknown"
# what a step has for a reply that is not sent, because no motion is found for it any more
NO_MOTION = "no_motion"
PROTOCOL_VERSION = 1  # of commands, replies and records; whoever reads a greater number refuses it


class CommandKind(StrEnum):
    """What a command asks for."""

    STEP = "step"  # carry out a step of a plan
    TEST = "test"  # carry out a test of the fault base; the reply is one of `choices`
    # carry out a repair of the fault base; the reply is one of `choices`: cured or not
    REPAIR = "repair"
    ASK = "ask"  # put a question to a person; the reply is one of `choices`
    # begin nothing that stands behind this in the stream's queue until it is continued
    WAIT = "wait"
    CONTINUE = "continue"  # go on behind the WAIT whose number is `about`


@dataclass(frozen=True, slots=True)
class DriverCommand:
    """One command of a run. Numbers ascend; a command that is sent twice has the same number and is
    carried out once.

    `stream` names the device. `action` is the step as an operator instance (`pick(probe_1,
    slot(drawer, 1))`), or the name of a test or repair; `says` is what the domain tells the device,
    or the words for a person. `expects` is the pattern of a normal reply, with variables for what
    is measured. A person is asked (`asks`). `lasts_ms` is a forecast. Without a reply within
    `timeout_ms` of its being sent, or of its turn in a queue, the command counts as failed. The
    device looks at the facts in `looks` before it begins, and at those in `watches` as long as it
    goes on, too; if one is not so, it does not begin, or stops, and replies `not(FACT)`. `part` is
    where the part lies, as the first three rows of a displacement of its model, in metres and in
    the frame of the part: all its points and paths move with it. Empty: as modelled.
    """

    number: int
    kind: CommandKind
    stream: str
    action: str
    says: str = ""
    expects: str = "done"
    choices: tuple[str, ...] = ()
    lasts_ms: int = 0
    timeout_ms: int | None = None
    about: int | None = None
    asks: bool = False
    looks: tuple[str, ...] = ()
    watches: tuple[str, ...] = ()
    part: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class Reply:
    """What a device answers to a command: `done`, `value(812)`, `not_gripped`, the outcome of a
    test.

    Whether it is normal is not the driver's to say: the executive matches it. `at_ms` is when the
    command had ended. `data` is what is too much for a term, such as a depth map, or the name of a
    file that holds it; it goes into the journal.
    """

    number: int
    text: str
    at_ms: int
    data: Mapping[str, Any] = field(default_factory=dict)


class TroubleKind(StrEnum):
    """What went wrong between the executive and a controller."""

    # the controller has died, hangs (no heartbeat), or cannot be reached again in time
    LOST = "lost"
    GARBAGE = "garbage"  # something came that is no reply
    REPEATED = "repeated"  # a second reply to a command; the first one counts
    STRANGE = "strange"  # a reply to a command that was never sent
    LATE = "late"  # a reply after the command was given up
    CLOCK = "clock"  # times that go back, jump, or stand still


@dataclass(frozen=True, slots=True)
class Trouble:
    """A fault of the connection, not of the cell. `number` is the command that it is about, if it
    is about one.

    After LOST nothing more comes. The others do not end a run; they are written in the journal.
    """

    kind: TroubleKind
    text: str
    at_ms: int
    number: int | None = None


Message = Reply | Trouble


class Fate(StrEnum):
    """What became of a command, as the driver knows it after a connection was lost or the
    executive was restarted.
    """

    UNKNOWN = "unknown"  # it was never received: it may be sent
    QUEUED = "queued"  # it waits for its turn
    RUNNING = "running"  # it is being carried out; its reply will come
    ENDED = "ended"  # it has ended; its reply is given again
    DROPPED = "dropped"  # it was taken back before it began
    UNSURE = "unsure"  # it began, and nobody knows whether or how it ended


@dataclass(frozen=True, slots=True)
class Report:
    """The fate of a command, and its reply if it has ended."""

    number: int
    fate: Fate
    reply: Reply | None = None

    def answer(self, now_ms: int) -> Reply | None:
        """The reply to the command; None if it can still come, or if the command can be given
        again.
        """
        if self.fate is Fate.UNSURE:
            return Reply(self.number, UNSURE_REPLY, now_ms)
        return self.reply if self.fate is Fate.ENDED else None


class RunPhase(StrEnum):
    """What the executive is doing."""

    READY = "ready"  # planned, not approved yet
    RUNNING = "running"
    INTERRUPTING = "interrupting"  # finishes the current goal, then pauses
    QUIESCING = "quiescing"  # begins nothing more, waits for what is under way
    HANDLING = "handling"  # finds out what went wrong, and plans on
    PAUSED = "paused"
    FINISHED = "finished"
    STOPPED = "stopped"  # a safe stop, or a stop by a person: nothing moves


class OperatorCommand(StrEnum):
    """What a person or another program can tell a run while it goes on."""

    STOP = "stop"  # at once
    # what moves comes to its end within a time, then everything halts: the process is to end
    REST = "rest"
    INTERRUPT = "interrupt"  # at the end of the current goal, with an empty gripper
    CONTINUE = "continue"
    SKIP = "skip"  # at a pause: take a step for done; a person has done it
    RETRY = "retry"  # at a pause: the step that failed once more
    BACK = "back"  # at a pause: go back to a step
    CORRECT = "correct"  # at a pause: facts that hold, and facts that do not
    ABORT = "abort"  # at a pause: end the run
    ADD = "add"  # a further command in words, merged without touching the steps that have begun
    APPROVE = "approve"
    # what a person was asked: an outcome of a question, or that a step is done by hand
    ANSWER = "answer"


class RecordKind(StrEnum):
    """What a record of the journal tells. Its content, by key, is described here; every record has
    `at_ms`.

    - RUN: target, problem, domain, goals, command, driver, seed, factor, options, version; it is
      the first record.
    - PLAN: why (first, recovery, reschedule, choice, aligned, again, or the order that asked for
      it), steps [{id, step, stream, says, after, resources, start_ms, lasts_ms, ...; keys that say
      nothing are left out}], order, forecast_ms (the end), goals, chains {name: stages pursued},
      given_up, lost, blocked, hands, full (those that hold something), ahead [[id, start, low,
      high]] (as far as starts can be forecast); it replaces the steps that have not begun.
    - COMMAND: command (its number), command_kind, stream, action, says, expects, choices, lasts_ms,
      timeout_ms, about, asks, step (id in the plan, or null); looks, watches and part, if there are
      any.
    - REPLY: command, text, data. A command that got none in time has the text `timeout`.
    - TROUBLE: trouble (its kind), text, command.
    - DONE: step (id), command, action, started_ms, adds, ends, events: what the step changed in the
      world model; moved: the stages that were reached, [[chain, number, atom]]; arms {name: {q,
      place, inside, straight}}: where those are that have moved, in a run with motion.
    - RESULT: command, action, result (the fact of the result pattern, or empty), and where the
      domain says what is measured of, quantity, value, unit, nominal, lower, upper, uncertainty,
      risk, passed, tool.
    - ALIGNMENT: part (twelve numbers, as in commands; empty if no place of the part fits), centre,
      covariance, wrong (datums that disagree), datums (how many agree), why (none fits): where the
      part lies, from here on.
    - EXCEPTION: exception (its name in the fault base, else the reply), known, step, action,
      command, reply.
    - FINDING: exception, action (test, repair or question), outcome, belief [[hypothesis,
      probability]] before it, expected_cost.
    - DIAGNOSIS: exception, causes [[hypothesis, probability]], cured, isolated, cost.
    - WORLD: why, adds, ends, reached: the world model was corrected; bodies {name: {at, rpy, box}},
      if some were seen.
    - GIVEN_UP: goal, why.
    - GOAL: goal: a stage was reached.
    - ORDER: order, given (what it says besides), origin (terminal, socket), who and when (date and
      time, UTC) if known. Of order `resume` each record says who took the run up again.
    - DECISION: what, why: a choice of the executive between alternatives.
    - PHASE: phase, why.
    - CHECKPOINT: state: from here a resumed run can go on without reading older records; or rest:
      what is left of a long plan, as in PLAN, before the checkpoint that refers to it; more steps
      of it are in so many records before (pages).
    - END: outcome (reached, partly, stopped, aborted, paused), why, goals, open_goals, given_up
      [[goal, why]], makespan_ms.
    """

    RUN = "run"
    PLAN = "plan"
    COMMAND = "command"
    REPLY = "reply"
    TROUBLE = "trouble"
    DONE = "done"
    RESULT = "result"
    ALIGNMENT = "alignment"
    EXCEPTION = "exception"
    FINDING = "finding"
    DIAGNOSIS = "diagnosis"
    WORLD = "world"
    GIVEN_UP = "given_up"
    GOAL = "goal"
    ORDER = "order"
    DECISION = "decision"
    PHASE = "phase"
    CHECKPOINT = "checkpoint"
    END = "end"


@dataclass(frozen=True, slots=True)
class JournalRecord:
    """One record of a run's journal, which is also an event of the public stream. Numbers count
    from 1 without gaps.

    `content` is plain JSON. What the keys are, `RecordKind` says.
    """

    number: int
    at_ms: int
    kind: RecordKind
    content: Mapping[str, Any] = field(default_factory=dict)

    def entry(self, run: str) -> dict[str, Any]:
        """The record as one JSON object of the event stream."""
        return {
            "version": PROTOCOL_VERSION,
            "run": run,
            "number": self.number,
            "at_ms": self.at_ms,
            "kind": self.kind.value,
            **self.content,
        }


@dataclass(frozen=True, slots=True)
class Underway:
    """A command that is being carried out: for the step of the plan, if it is one, since when
    and until when probably.
    """

    command: DriverCommand
    started_ms: int
    ends_ms: int
    step: int | None = None


@dataclass(frozen=True, slots=True)
class RunState:
    """How a run stands, for those who watch it.

    `facts` are what the world model holds for true, `forecast_ms` is when the plan is forecast to
    end.
    """

    run: str
    phase: RunPhase
    at_ms: int
    under_way: tuple[Underway, ...] = ()
    done: int = 0
    steps: int = 0
    forecast_ms: int = 0
    facts: frozenset[Any] = frozenset()
    why: str = ""


@dataclass(frozen=True, slots=True)
class Finish:
    """How a run ended: `reached`, `partly`, `stopped`, `aborted` or `paused`, and why. Stopped and
    paused runs can be resumed.

    `goals` are reached, `open_goals` are not; `given_up` says which of them were given up, and why.
    Times are of the run's clock; `forecast_ms` is what the first plan was to take. `story` says of
    each exception what was found and done, what was measured again, and what stayed too long in a
    place.
    """

    run: str
    outcome: str
    why: str = ""
    goals: tuple[str, ...] = ()
    open_goals: tuple[str, ...] = ()
    given_up: tuple[tuple[str, str], ...] = ()
    makespan_ms: int = 0
    forecast_ms: int = 0
    exceptions: int = 0
    steps: int = 0
    story: tuple[str, ...] = ()


class NumberSet(MutableSet[int]):
    """A set of small whole numbers, as bits.

    It iterates in ascending order. Memory grows with the greatest number.
    """

    __slots__ = ("_bits", "_count")

    def __init__(self, numbers: Iterable[int] = ()) -> None:
        self._bits, self._count = bytearray(), 0
        for number in numbers:
            self.add(number)

    def __contains__(self, number: object) -> bool:
        if not isinstance(number, int) or not 0 <= number < 8 * len(self._bits):
            return False
        return bool(self._bits[number >> 3] >> (number & 7) & 1)

    def __iter__(self) -> Iterator[int]:
        for place, byte in enumerate(self._bits):
            if byte:
                yield from (8 * place + bit for bit in range(8) if byte >> bit & 1)

    def __len__(self) -> int:
        return self._count

    def add(self, value: int) -> None:
        """Add a number. Raises `ValueError` if it is negative."""
        if value < 0:
            raise ValueError(f"{value} is negative")
        if value not in self:
            missing = (value >> 3) + 1 - len(self._bits)
            self._bits.extend(bytes(max(0, missing)))
            self._bits[value >> 3] |= 1 << (value & 7)
            self._count += 1

    def discard(self, value: int) -> None:
        """Take a number out if it is in."""
        if value in self:
            self._bits[value >> 3] &= ~(1 << (value & 7))
            self._count -= 1
