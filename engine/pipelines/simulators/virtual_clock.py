"""Simulated driver on a virtual clock: when commands begin and end. Their effects: `true_state`.

With a log, a simulator that is made again for the same run is where the last one was: everything
that was sent is carried out again on the virtual clock, which always ends in the same state.
"""

import heapq
import time
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from cellwright.engine.model.run_protocol import (
    CommandKind,
    DriverCommand,
    Fate,
    Message,
    NumberSet,
    Reply,
    Report,
)
from cellwright.engine.pipelines.simulators.simulated_cell import SimulatedCell
from cellwright.engine.pipelines.simulators.simulator_log import (
    HandChange,
    SentMessage,
    SimulatorLog,
)
from cellwright.engine.pipelines.simulators.simulator_settings import (
    FORECAST,
    SimulatorSettings,
    drawn_duration,
    duration_in_range,
    settings_of,
)
from cellwright.engine.pipelines.simulators.true_state import HiddenCell, step_instance
from cellwright.engine.ports import DriverSetup
from cellwright.kb.loader.fault_base import load_faults
from cellwright.kb.loader.problem_amounts import amounts_of
from cellwright.kb.model.fault_model import FaultModel
from cellwright.kb.model.operator_amounts import Amounts, range_of_step
from cellwright.kb.model.plan_model import INITIAL_STEP, Step
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.syntax import SECONDS_PER_UNIT

if TYPE_CHECKING:
    from cellwright.engine.pipelines.simulators.simulated_cell import PhysicalBody
    from cellwright.engine.pipelines.simulators.true_part import PartTruth
    from cellwright.engine.pipelines.simulators.unmodelled import UnmodelledThings

TICK_S = 0.1  # of real time, where the clock is slowed down
# of the last commands it is known what they were and how they ended; nobody asks about older
# ones
MAX_REMEMBERED_COMMANDS = 10_000


@dataclass
class StepRanges:
    """The ranges of the steps of a problem, and how often each step was begun."""

    problem: Problem
    times: dict[str, int] = field(default_factory=dict)

    def duration_ms(self, settings: SimulatorSettings, action: str, forecast_ms: int) -> int:
        """How long a step takes this time; as it is forecast, where it has no range."""
        lasts = range_of_step(self._amounts, Step(INITIAL_STEP, step_instance(action)))
        if not lasts.varies:
            return forecast_ms
        self.times[action] = self.times.get(action, 0) + 1
        drawn = duration_in_range(settings, action, self.times[action], lasts)
        unit_s = SECONDS_PER_UNIT[self.problem.domain.time_unit]
        return round(drawn * float(unit_s) * 1000)

    @cached_property
    def _amounts(self) -> Amounts:
        return amounts_of(self.problem)


@dataclass
class Simulator:
    """A driver for a cell that is simulated."""

    cell: SimulatedCell
    settings: SimulatorSettings = field(default_factory=SimulatorSettings)
    ranges: "StepRanges | None" = None

    def __post_init__(self) -> None:
        self._now = 0
        self._real = time.monotonic()
        self._known = NumberSet()  # every command that came
        # the last of them, and those that have not ended
        self._commands: dict[int, DriverCommand] = {}
        self._ended: dict[int, Reply] = {}
        self._lost: set[int] = set()  # under way, and never answered
        self._dropped: set[int] = set()
        self._under_way: dict[int, int] = {}  # when each will end
        self._ends: list[tuple[int, int]] = []
        self._queues: dict[str, deque[int]] = {}
        self._continued: set[int] = set()
        self._times: dict[str, int] = {}
        self._broken: dict[int, str] = {}  # what is not so that a command looks at
        self._out: list[Message] = []
        self._log = SimulatorLog(self.settings.log)
        for entry in self._log.past():
            self._again(entry)
        self._out = [] if self._now else self._out

    def _again(self, past: SentMessage) -> None:
        self._until(past.at_ms)
        if past.halted:
            self._halt()
        elif past.hand is not None:
            self.by_hand(past.hand.adds, past.hand.ends, past.hand.reached)
        else:
            self._take(past.commands)

    @property
    def tick_ms(self) -> int | None:
        """None at full speed, else a tenth of a real second."""
        return max(1, round(TICK_S * 1000 / self.settings.factor)) if self.settings.factor else None

    def now_ms(self) -> int:
        """The virtual time."""
        return self._now

    def lookahead(self, stream: str) -> int:  # noqa: ARG002 - every simulated device has the same queue
        """How many commands each device queues."""
        return self.settings.lookahead

    def send(self, commands: Sequence[DriverCommand]) -> None:
        """Take commands; those that are known are not carried out again."""
        fresh = [command for command in commands if command.number not in self._known]
        if fresh:
            self._log.sent(self._now, fresh)
            self._take(fresh)

    def by_hand(self, adds: Sequence[str], ends: Sequence[str], reached: Mapping[str, int]) -> None:
        """A person has changed something in the cell."""
        self._log.by_hand(self._now, HandChange(tuple(adds), tuple(ends), reached))
        if isinstance(self.cell, HiddenCell):
            self.cell.by_hand(adds, ends, reached)

    def not_come(self) -> Sequence[str]:
        """The faults that were ordered and have not come up."""
        return self.cell.not_come() if isinstance(self.cell, HiddenCell) else ()

    def _take(self, commands: Sequence[DriverCommand]) -> None:
        for command in commands:
            self._known.add(command.number)
            self._commands[command.number] = command
            if command.kind is CommandKind.CONTINUE:
                self._continued.add(command.about or 0)
                self._ended[command.number] = Reply(command.number, "done", self._now)
                self._next(command.stream)
            elif self.settings.lookahead > 1 and command.kind in (
                CommandKind.STEP,
                CommandKind.WAIT,
            ):
                self._queues.setdefault(command.stream, deque()).append(command.number)
                self._next(command.stream)
            else:
                self._begin(command)
        if len(self._ended) > 2 * MAX_REMEMBERED_COMMANDS:
            self._forget()

    def _forget(self) -> None:
        """Forget old commands that have ended, so that memory does not grow with the run.

        They stay known.
        """
        queued = {
            number for queue in self._queues.values() for number in queue
        }  # a WAIT is answered, and stays
        old = [
            number
            for number in list(self._ended)[:-MAX_REMEMBERED_COMMANDS]
            if number not in queued
        ]
        for number in old:
            del self._ended[number]
            self._commands.pop(number, None)
        self._continued.difference_update(old)

    def _next(self, stream: str) -> None:
        """Begin the next command of a queue if its device is free."""
        queue = self._queues.get(stream)
        while queue:
            command = self._commands[queue[0]]
            if any(
                self._commands[number].stream == stream
                for number in (*self._under_way, *self._lost)
            ):
                return
            if command.kind is CommandKind.WAIT:
                if command.number not in self._ended:
                    self._answer(Reply(command.number, "waiting", self._now))
                if command.number not in self._continued:
                    return
                queue.popleft()
                continue
            queue.popleft()
            self._begin(command)

    def _begin(self, command: DriverCommand) -> None:
        lasts = command.lasts_ms
        if self.settings.spread and command.kind is CommandKind.STEP:
            time_ = self._times[command.action] = self._times.get(command.action, 0) + 1
            lasts = drawn_duration(self.settings, command.action, time_, lasts)
        if self.ranges is not None and command.kind is CommandKind.STEP:
            lasts = self.ranges.duration_ms(self.settings, command.action, lasts)
        if broken := self.cell.missing(command.looks):
            self._broken[command.number], lasts = broken, 0
        self._under_way[command.number] = self._now + lasts
        heapq.heappush(self._ends, (self._now + lasts, command.number))

    def receive(self, until_ms: int | None) -> Sequence[Message]:
        """What came until a time; the clock jumps there, or runs slower than real time by the
        factor.
        """
        if not self._out:
            self._pass(self._due(until_ms))
        messages, self._out = self._out, []
        return messages

    def _due(self, until_ms: int | None) -> int:
        """The time to which the clock goes: the next end of a command, the limit, or a tick,
        whichever is first.
        """
        times = [self._ends[0][0]] if self._ends else []
        times += [until_ms] if until_ms is not None else []
        times += [self._now + self.tick_ms] if self.tick_ms is not None else []
        return max(self._now, min(times, default=self._now))

    def _pass(self, due_ms: int) -> None:
        if self.settings.factor:
            time.sleep(max(0.0, (due_ms - self._now) * self.settings.factor / 1000))
        self._until(due_ms)

    def _until(self, due_ms: int) -> None:
        """Carry out everything that ends until a time."""
        while self._ends and self._ends[0][0] <= due_ms:
            when, number = heapq.heappop(self._ends)
            if self._under_way.get(number) != when:
                continue
            self._now = max(self._now, when)
            del self._under_way[number]
            self._end(self._commands[number])
            self._watch()
            self._next(self._commands[number].stream)
        self._now = max(self._now, due_ms)

    def _end(self, command: DriverCommand) -> None:
        text = self._outcome(command)
        self._log.ended(self._now, command, text)
        if text is None:
            self._lost.add(command.number)
        else:
            self._answer(Reply(command.number, text, self._now, self.cell.told()))

    def _watch(self) -> None:
        """End every command at once that watches something which is not so any more."""
        for number in self._under_way:
            if broken := self.cell.missing(self._commands[number].watches):
                self._broken.setdefault(number, broken)
                self._under_way[number] = self._now
                heapq.heappush(self._ends, (self._now, number))

    def _outcome(self, command: DriverCommand) -> str | None:
        if (broken := self._broken.pop(command.number, "")) != "":
            return f"not({broken})"
        match command.kind:
            case CommandKind.STEP:
                return self.cell.take(command.action, command.expects, command.part)
            case CommandKind.TEST | CommandKind.REPAIR:
                return self.cell.answer(command.action)
            case _:
                return self.cell.say(command.choices)

    def _answer(self, reply: Reply) -> None:
        self._ended[reply.number] = reply
        self._out.append(reply)

    def quiesce(self, within_ms: int) -> Sequence[Message]:  # noqa: ARG002 - what is under way ends on the virtual clock
        """Drop what is queued. What is under way is answered by `receive`."""
        for queue in self._queues.values():
            self._dropped.update(queue)
            queue.clear()
        messages, self._out = self._out, []
        return messages

    def halt(self) -> None:
        """Stop everything: what was under way has changed nothing, and is never answered."""
        self._log.halted(self._now)
        self._halt()

    def _halt(self) -> None:
        self._dropped.update(self._under_way, *self._queues.values())
        self._under_way.clear()
        self._ends.clear()
        self._queues.clear()

    def report(self, numbers: Sequence[int]) -> Sequence[Report]:
        """What became of commands."""
        return [self._report(number) for number in numbers]

    def _report(self, number: int) -> Report:
        if number in self._ended:
            return Report(number, Fate.ENDED, self._ended[number])
        if number in self._dropped:
            return Report(number, Fate.DROPPED)
        if number in self._under_way or number in self._lost:
            return Report(number, Fate.RUNNING)
        if number in self._commands:
            return Report(number, Fate.QUEUED)
        return Report(number, Fate.ENDED if number in self._known else Fate.UNKNOWN)

    def close(self) -> None:
        """Close the log."""
        self._log.close()


def fault_base(problem: Problem) -> FaultModel | None:
    """The fault base of a problem's domain; None if it has none."""
    path = Path(problem.domain.path)
    folder = path if path.is_dir() else path.parent
    if not (folder / "faults.yaml").is_file():
        return None
    return load_faults(path)[0]


def simulated_driver(setup: DriverSetup) -> Simulator:
    """The simulator for a run. Options: spread, durations, lookahead, fault (STEP=CAUSE; ...), log,
    truth, obstacles, really.

    Raises `InvalidInput`.
    """
    settings, truth = settings_of(setup, ("obstacles", "really")), truth_of(setup)
    body, unknown = _obstructions(setup)
    base = fault_base(setup.problem)
    cell = HiddenCell(
        setup.problem,
        base,
        settings.injections,
        setup.seed,
        body=body,
        truth=truth,
        unknown=unknown,
    )
    ranges = None if settings.durations == FORECAST else StepRanges(setup.problem)
    return Simulator(cell, settings, ranges)


def _obstructions(setup: DriverSetup) -> "tuple[PhysicalBody | None, UnmodelledThings | None]":
    """The arm, where something stands that nobody knows of."""
    if not {"obstacles", "really"} & setup.options.keys():
        return None, None
    # these need numpy
    from cellwright.engine.pipelines.simulators.obstructed_arm import ObstructedArm
    from cellwright.engine.pipelines.simulators.unmodelled import unknown_of

    unknown = unknown_of(setup.options, setup.problem)
    return (None if unknown is None else ObstructedArm(setup.problem, unknown, setup.seed)), unknown


def truth_of(setup: DriverSetup) -> "PartTruth | None":
    """The hidden truth of the part that a file says; None without such a file. Raises
    `InvalidInput`.
    """
    if "truth" not in setup.options:
        return None
    from cellwright.engine.pipelines.simulators.true_part import read_truth  # it needs numpy

    return read_truth(setup.options["truth"], setup.problem, setup.seed)
