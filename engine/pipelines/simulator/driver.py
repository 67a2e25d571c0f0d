"""The simulated driver: when commands begin and end on its clock. What they do in the cell, `hidden` says.

With a log, a simulator that is made again for the same run is where the last one was: everything that was sent is carried out
again on the virtual clock, which always ends in the same state.
"""

import heapq
import random
import time
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from engine.model.execution import Command, CommandKind, Fate, Message, Reply, Report
from engine.pipelines.simulator.hidden import HiddenCell
from engine.pipelines.simulator.injections import Injection, injection
from engine.pipelines.simulator.log import Log, Sent
from engine.pipelines.simulator.physical import SimulatedCell
from engine.ports import DriverSetup
from kb.diagnostics import Diagnostic, InvalidInput, Source
from kb.loader.faults import load_faults
from kb.model.faults import FaultModel
from kb.model.problem import Problem
from kb.numbers import NumberError, decimal

if TYPE_CHECKING:
    from engine.pipelines.simulator.truth import Truth

TICK_S = 0.1  # of real time, where the clock is slowed down


@dataclass(frozen=True, slots=True)
class Settings:
    """How a simulated cell behaves. Durations are spread evenly by a share around the forecast."""

    seed: int = 0
    factor: float = 0.0
    spread: float = 0.0
    lookahead: int = 1
    injections: tuple[Injection, ...] = ()
    log: str = ""


@dataclass
class Simulator:
    """A driver for a cell that is simulated."""

    cell: SimulatedCell
    settings: Settings = field(default_factory=Settings)

    def __post_init__(self) -> None:
        self._now = 0
        self._real = time.monotonic()
        self._commands: dict[int, Command] = {}
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
        self._log = Log(self.settings.log)
        for each in self._log.past():
            self._again(each)
        self._out = [] if self._now else self._out

    def _again(self, past: Sent) -> None:
        self._until(past.at_ms)
        if past.halted:
            self._halt()
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

    def send(self, commands: Sequence[Command]) -> None:
        """Take commands; those that are known are not carried out again."""
        fresh = [each for each in commands if each.number not in self._commands]
        if fresh:
            self._log.sent(self._now, fresh)
            self._take(fresh)

    def _take(self, commands: Sequence[Command]) -> None:
        for command in commands:
            self._commands[command.number] = command
            if command.kind is CommandKind.CONTINUE:
                self._continued.add(command.about or 0)
                self._ended[command.number] = Reply(command.number, "done", self._now)
                self._next(command.stream)
            elif self.settings.lookahead > 1 and command.kind in (CommandKind.STEP, CommandKind.WAIT):
                self._queues.setdefault(command.stream, deque()).append(command.number)
                self._next(command.stream)
            else:
                self._begin(command)

    def _next(self, stream: str) -> None:
        """Begin the next command of a queue if its device is free."""
        queue = self._queues.get(stream)
        while queue:
            command = self._commands[queue[0]]
            if any(self._commands[each].stream == stream for each in (*self._under_way, *self._lost)):
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

    def _begin(self, command: Command) -> None:
        lasts = command.lasts_ms
        if self.settings.spread and command.kind is CommandKind.STEP:
            time_ = self._times[command.action] = self._times.get(command.action, 0) + 1
            lasts = drawn(self.settings, command.action, time_, lasts)
        if broken := self.cell.missing(command.looks):
            self._broken[command.number], lasts = broken, 0
        self._under_way[command.number] = self._now + lasts
        heapq.heappush(self._ends, (self._now + lasts, command.number))

    def receive(self, until_ms: int | None) -> Sequence[Message]:
        """What came until a time; the clock jumps there, or runs slower than real time by the factor."""
        if not self._out:
            self._pass(self._due(until_ms))
        found, self._out = self._out, []
        return found

    def _due(self, until_ms: int | None) -> int:
        """The time to which the clock goes: the next end of a command, the limit, or a tick, whichever is first."""
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

    def _end(self, command: Command) -> None:
        text = self._outcome(command)
        self._log.ended(self._now, command, text)
        if text is None:
            self._lost.add(command.number)
        else:
            self._answer(Reply(command.number, text, self._now))

    def _watch(self) -> None:
        """End every command at once that watches something which is not so any more."""
        for number in self._under_way:
            if broken := self.cell.missing(self._commands[number].watches):
                self._broken.setdefault(number, broken)
                self._under_way[number] = self._now
                heapq.heappush(self._ends, (self._now, number))

    def _outcome(self, command: Command) -> str | None:
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
        found, self._out = self._out, []
        return found

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
        return Report(number, Fate.QUEUED if number in self._commands else Fate.UNKNOWN)

    def close(self) -> None:
        """Close the log."""
        self._log.close()


def drawn(settings: Settings, action: str, time_: int, lasts_ms: int) -> int:
    """How long an action takes the n-th time: always the same for the same seed."""
    share = random.Random(f"{settings.seed} {action} {time_}").uniform(-1.0, 1.0)
    return max(0, round(lasts_ms * (1.0 + settings.spread * share)))


def fault_base(problem: Problem) -> FaultModel | None:
    """The fault base of a problem's domain; None if it has none."""
    path = Path(problem.domain.path)
    folder = path if path.is_dir() else path.parent
    if not (folder / "faults.yaml").is_file():
        return None
    return load_faults(path)[0]


def simulator(setup: DriverSetup) -> Simulator:
    """The simulator for a run. Options: spread, lookahead, fault (STEP=CAUSE; ...), log, truth. Raises `InvalidInput`."""
    settings = settings_of(setup)
    truth = truth_of(setup)
    cell = HiddenCell(setup.problem, fault_base(setup.problem), settings.injections, setup.seed, truth=truth)
    return Simulator(cell, settings)


def truth_of(setup: DriverSetup) -> "Truth | None":
    """The hidden truth of the part that a file says; None without such a file. Raises `InvalidInput`."""
    if "truth" not in setup.options:
        return None
    from engine.pipelines.simulator.truth import read_truth  # it needs numpy

    return read_truth(setup.options["truth"], setup.problem, setup.seed)


def settings_of(setup: DriverSetup, more: Sequence[str] = ()) -> Settings:
    """How a simulated cell behaves. `more` are options that its driver has beside these. Raises `InvalidInput`."""
    known = ("spread", "lookahead", "fault", "log", "truth", *more)
    if unknown := [name for name in setup.options if name not in known]:
        hint = f"one of: {', '.join(known)}"
        raise InvalidInput(
            [Diagnostic(Source("--option"), "K408", f"the simulator has no option '{unknown[0]}'", hint)]
        )
    return Settings(
        setup.seed,
        setup.factor,
        number_of(setup.options, "spread"),
        max(1, int(number_of(setup.options, "lookahead", 1))),
        tuple(injection(each.strip()) for each in setup.options.get("fault", "").split(";") if each.strip()),
        setup.options.get("log", ""),
    )


def number_of(options: Mapping[str, str], name: str, default: float = 0.0) -> float:
    """An option of a driver as a number. Raises `InvalidInput`."""
    try:
        return decimal(options[name]) if name in options else default
    except NumberError as error:
        said = f"'{options[name][:40]}' {error}"
        raise InvalidInput([Diagnostic(Source("--option"), "K107", said, f"write {name}=0.2")]) from None
