"""Whatever ends a run, the cell comes to rest: `quiesce`, and `halt` if the run is not done."""

from collections.abc import Sequence
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis.strategies import integers, sampled_from

from benchmarks.endings import WAYS, try_way
from cellwright.engine.model.run_protocol import (
    DriverCommand,
    Finish,
    JournalRecord,
    Message,
    OperatorCommand,
    RecordKind,
    Report,
)
from cellwright.engine.pipelines.execution import GivenOrder, RunExecution, TimedOrders
from cellwright.engine.pipelines.execution.cell_rest import leaving_safely
from cellwright.engine.pipelines.execution.compiled_program import initial_situation
from cellwright.engine.pipelines.execution.run_journal import Recorder
from cellwright.engine.pipelines.execution.run_loop import RunLoop
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.pipelines.recovery import SymbolicWorld
from cellwright.engine.pipelines.simulators import HiddenCell, Injection, Simulator
from cellwright.engine.pipelines.simulators.virtual_clock import fault_base
from cellwright.kb.store.journal import JournalFailure
from tests.engine.pipelines.execution.executed_cells import Kept, planned

TARGET = "themse/one"
INJECTIONS = (Injection("pick", "not_gripped"), Injection("put", "low_voltage"))


class ListeningDriver:
    """A simulated cell that notes what it is told."""

    def __init__(self, *injections: Injection) -> None:
        problem, _ = planned(TARGET)
        self.inner = Simulator(HiddenCell(problem, fault_base(problem), injections))
        self.heard: list[str] = []
        self.tick_ms = None
        self.is_closed = False

    def now_ms(self) -> int:
        return self.inner.now_ms()

    def lookahead(self, stream: str) -> int:
        return self.inner.lookahead(stream)

    def send(self, commands: Sequence[DriverCommand]) -> None:
        self.heard += [command.kind.value for command in commands]
        self.inner.send(commands)

    def receive(self, until_ms: int | None) -> Sequence[Message]:
        return self.inner.receive(until_ms)

    def quiesce(self, within_ms: int) -> Sequence[Message]:
        self.heard.append("quiesce")
        return self.inner.quiesce(within_ms)

    def halt(self) -> None:
        self.heard.append("halt")
        self.inner.halt()

    def report(self, numbers: Sequence[int]) -> Sequence[Report]:
        return self.inner.report(numbers)

    def close(self) -> None:
        self.is_closed = True


class Full(Kept):
    """A journal that takes so many groups."""

    def __init__(self, groups: int) -> None:
        super().__init__()
        self.groups = groups

    def append(self, records: Sequence[JournalRecord]) -> None:
        self.groups -= 1
        if self.groups < 0:
            raise JournalFailure("the disk is full")
        super().append(records)


def run(
    driver: ListeningDriver, kept: Kept, orders: Sequence[tuple[int, OperatorCommand]] = ()
) -> Finish:
    problem, ready = planned(TARGET)
    given = TimedOrders([(when, GivenOrder(order, "SIGTERM")) for when, order in orders])
    execution = RunExecution(
        "r", problem, driver, Recorder(kept, driver.now_ms), given, fault_base(problem)
    )
    return execution.start(ready, SymbolicWorld.of(problem, initial_situation(problem).state))


def test_a_run_that_is_done_tells_its_driver_that_nothing_more_begins() -> None:
    driver = ListeningDriver()
    assert run(driver, Kept()).outcome == "reached"
    assert driver.heard[-1] == "quiesce"
    assert "halt" not in driver.heard


@pytest.mark.parametrize("when", [0, 1, 30_000, 400_000, 900_000])
def test_a_run_that_is_told_to_end_lets_motions_end_and_halts(when: int) -> None:
    driver, kept = ListeningDriver(), Kept()
    ending = run(driver, kept, [(when, OperatorCommand.REST)])
    assert (ending.outcome, ending.why) == ("stopped", "told to end (SIGTERM)")
    assert driver.heard[-2:] == ["quiesce", "halt"]
    assert kept.records[-1].kind is RecordKind.END
    assert ending.makespan_ms <= when + 5_000


def test_a_reply_that_comes_while_motions_end_is_noted() -> None:
    whole = Kept()
    run(ListeningDriver(), whole)
    first = next(record for record in whole.records if record.kind is RecordKind.DONE)
    kept = Kept()
    run(ListeningDriver(), kept, [(first.at_ms - 1, OperatorCommand.REST)])
    assert [r.content for r in kept.records if r.kind is RecordKind.DONE] == [first.content]


def test_a_stop_halts_at_once_and_sends_nothing_more() -> None:
    driver = ListeningDriver()
    orders = [(30_000, OperatorCommand.CONTINUE), (30_000, OperatorCommand.STOP)]
    assert run(driver, Kept(), orders).outcome == "stopped"
    assert driver.heard[-1] == "halt"
    assert "quiesce" not in driver.heard


@pytest.mark.parametrize("groups", [0, 1, 2, 5, 9])
def test_a_full_disk_brings_the_cell_to_rest(groups: int) -> None:
    driver, kept = ListeningDriver(), Full(groups)
    ending = run(driver, kept)
    assert ending.why == "the journal cannot be written: the disk is full"
    assert driver.heard[-2:] == ["quiesce", "halt"]


@pytest.mark.parametrize("method", ["hear", "take", "flush", "dispatch", "ended"])
def test_an_error_of_ours_brings_the_cell_to_rest_and_is_noted(
    method: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    driver, kept, calls = ListeningDriver(), Kept(), []
    function = getattr(RunLoop, method)

    def breaking(*arguments: object) -> object:
        calls.append(arguments)
        if len(calls) == 3:
            raise ZeroDivisionError("broken on purpose")
        return function(*arguments)

    monkeypatch.setattr(RunLoop, method, breaking)
    with pytest.raises(ZeroDivisionError):
        run(driver, kept)
    assert driver.heard[-2:] == ["quiesce", "halt"]
    assert kept.records[-1].content["why"].endswith("ZeroDivisionError: broken on purpose")
    assert [record.number for record in kept.records] == list(range(1, len(kept.records) + 1))


def test_a_driver_is_brought_to_rest_and_closed_whatever_happens_before_the_run() -> None:
    driver = ListeningDriver()

    def leave() -> None:
        with leaving_safely(driver):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        leave()
    assert (driver.heard, driver.is_closed) == (["quiesce", "halt"], True)


def test_one_who_watches_and_whose_terminal_is_gone_sees_no_more() -> None:
    seen: list[int] = []

    def watch(record: JournalRecord) -> None:
        seen.append(record.number)
        raise OSError(5, "input/output error")

    recorder = Recorder(Kept(), lambda: 0, [watch])
    for _ in range(3):
        recorder.note(RecordKind.GOAL, goal="g")
        recorder.commit()
    assert seen == [1]


@given(when=integers(0, 1_300_000), injection=sampled_from(INJECTIONS))
@settings(max_examples=20)
def test_a_run_with_a_fault_comes_to_rest_at_any_time(when: int, injection: Injection) -> None:
    driver, kept = ListeningDriver(injection), Kept()
    ending = run(driver, kept, [(when, OperatorCommand.REST)])
    told = driver.heard[-2:] == ["quiesce", "halt"]
    assert told if ending.outcome == "stopped" else driver.heard[-1] == "quiesce"
    assert kept.records[-1].kind is RecordKind.END


@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS)
def test_each_way_to_end_a_process_is_a_safe_end(way: str, tmp_path: Path) -> None:
    outcome, wrong = try_way(problem_of(TARGET), TARGET, way, 2, 7)
    assert wrong == "", (outcome, tmp_path)
