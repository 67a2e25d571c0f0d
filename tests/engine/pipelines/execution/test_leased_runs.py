"""A host that has lost its run sends nothing more, and a controller refuses it besides."""

import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from benchmarks.controllers import Server
from cellwright.engine.model.run_protocol import (
    TAKEN_UP_AGAIN,
    CommandKind,
    DriverCommand,
    Fate,
    JournalRecord,
    OperatorCommand,
    RecordKind,
    Trouble,
    TroubleKind,
)
from cellwright.engine.pipelines.execution import (
    GivenOrder,
    RunRequest,
    TimedOrders,
    begin_run,
    list_run,
    name_run,
    resume_run,
)
from cellwright.engine.pipelines.execution.controllers import ControllerDriver
from cellwright.engine.pipelines.execution.controllers.link import Patience
from cellwright.engine.pipelines.execution.leased_driver import LeasedDriver, under_lease
from cellwright.engine.pipelines.simulators import Simulator
from cellwright.engine.plugins import make_driver
from cellwright.engine.ports import Driver, DriverSetup, Simulated
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.store.journal import Journal, JournalFailure
from cellwright.kb.store.run_lease import LeasePace, RunLease, taken_lease
from tests.engine.pipelines.execution.executed_cells import BEGIN, planned

TARGET = "themse/one"
HURRY = Patience(5, 2, 0.2, 1.5)
LEASE = sys.modules[RunLease.__module__]


@pytest.fixture(autouse=True)
def in_a_hurry(monkeypatch: pytest.MonkeyPatch) -> None:
    """A beat of a lease is soon seen."""
    pace = LeasePace(beat_s=0.02, lapse_s=10, look_s=0.01)
    monkeypatch.setattr(BEGIN, "taken_lease", partial(taken_lease, pace=pace))


@pytest.fixture
def server() -> Iterator[Server]:
    problem, _ = planned(TARGET)
    made = Server(problem)
    yield made
    made.close()


def command(number: int) -> DriverCommand:
    _, ready = planned(TARGET)
    step = ready.plan.steps[number - 1].operator
    return DriverCommand(number, CommandKind.STEP, "arm", str(step), lasts_ms=1000)


def test_a_controller_refuses_whoever_comes_with_an_older_number(server: Server) -> None:
    first = ControllerDriver(server.place, HURRY, "r", 7)
    assert first.fenced
    first.send([command(1)])
    second = ControllerDriver(server.place, HURRY, "r", 8)
    halted = list[int]()
    assert server.cell.simulator is not None
    server.cell.simulator.halt = lambda: halted.append(1)  # type: ignore[method-assign]
    first.halt()
    (told,) = first.receive(None)
    assert isinstance(told, Trouble)
    assert told.kind is TroubleKind.LOST
    assert "another host drives it, with fencing number 8" in told.text
    assert not halted
    first.send([command(2)])
    assert [report.fate for report in second.report([1, 2])] == [Fate.RUNNING, Fate.UNKNOWN]
    with pytest.raises(InvalidInput, match="another host drives it"):
        ControllerDriver(server.place, HURRY, "r", 7)
    first.close()
    second.close()


def test_a_controller_that_is_started_again_still_knows_the_number(tmp_path: Path) -> None:
    problem, _ = planned(TARGET)
    for fence, refused in ((5, False), (4, True), (5, False), (6, False), (5, True)):
        served = Server(problem, log=str(tmp_path / "cell.log"))
        try:
            ControllerDriver(served.place, HURRY, "r", fence).close()
        except InvalidInput:
            assert refused
        else:
            assert not refused
        served.close()


class Deaf:
    """A driver that counts what it is told."""

    def __init__(self, driver: Driver, fenced: bool) -> None:
        self.driver, self.fenced, self.told = driver, fenced, list[str]()

    def now_ms(self) -> int:
        return 0

    def __getattr__(self, name: str) -> Callable[..., object]:
        self.told.append(name)
        return lambda *_: ()


@pytest.mark.parametrize("fenced", [False, True])
@pytest.mark.parametrize("state", ["held", "lost", "nobody knows"])
def test_only_who_holds_the_lease_tells_a_driver_anything(
    state: str, fenced: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lease = taken_lease(str(tmp_path / "j.db"), "r")

    def unknown() -> None:
        raise JournalFailure("the server is gone")

    if state == "lost":
        lease.lose()
    elif state == "nobody knows":
        monkeypatch.setattr(lease, "require", unknown)
    deaf = Deaf(Simulator.__new__(Simulator), fenced)
    driver = LeasedDriver(deaf, lease)  # type: ignore[arg-type]
    driver.send(())
    came = [*driver.receive(None), *driver.quiesce(1)]
    reports = driver.report((4,))
    driver.halt()
    if state == "held":
        assert deaf.told == ["send", "receive", "quiesce", "report", "halt"]
    else:
        assert deaf.told == (["quiesce", "halt"] if fenced and state != "lost" else [])
        assert {message.kind for message in came} == {TroubleKind.LOST}  # type: ignore[union-attr]
        assert [report.fate for report in reports] == [Fate.UNKNOWN]
    lease.close()


def test_a_simulated_cell_stays_one_under_a_lease(tmp_path: Path) -> None:
    problem, _ = planned(TARGET)
    made = make_driver("sim", DriverSetup(problem))
    with taken_lease(str(tmp_path / "j.db"), "r") as lease:
        assert isinstance(under_lease(made, lease), Simulated)
        assert under_lease(made, None) is made


def test_a_run_that_another_host_has_taken_ends_without_a_word(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, ready = planned(TARGET)
    monkeypatch.setattr(BEGIN, "first_plan", lambda *_: ready)
    store, records, halted = str(tmp_path / "j.db"), list[JournalRecord](), list[int]()
    monkeypatch.setattr(Simulator, "halt", lambda _: halted.append(1))
    wanted = name_run(RunRequest(TARGET, store=store, run="r"), problem)
    assert wanted.lease is not None

    def taken_away(record: JournalRecord) -> None:
        records.append(record)
        if record.kind is RecordKind.DONE and len(thieves) == 0:
            assert wanted.lease is not None
            wanted.lease.stop_beat()
            with monkeypatch.context() as context:
                context.setattr(LEASE, "is_gone", lambda _: True)
                thieves.append(taken_lease(store, "r", pace=LeasePace(beat_s=0.02)))

    thieves: list[RunLease] = []
    ending = begin_run(wanted, problem, TimedOrders(), [taken_away])
    assert not isinstance(ending, type(None))
    assert ending.outcome == "stopped"  # type: ignore[union-attr]
    assert "another process drives the run r now" in ending.why  # type: ignore[union-attr]
    assert not halted
    with Journal(store) as journal:
        assert journal.last("r") == records[-1].number
        assert not journal.last("r", "end")
    with pytest.raises(InvalidInput, match="is driven by"):
        resume_run(store, "r", TimedOrders())
    thieves[0].close()
    assert resume_run(store, "r", TimedOrders()).outcome == "reached"


def test_the_journal_tells_who_has_taken_a_run_up_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, ready = planned(TARGET)
    monkeypatch.setattr(BEGIN, "first_plan", lambda *_: ready)
    store = str(tmp_path / "j.db")
    wanted = name_run(RunRequest(TARGET, store=store, run="r"), problem)
    begin_run(wanted, problem, TimedOrders([(20_000, GivenOrder(OperatorCommand.STOP))]))
    monkeypatch.setattr(BEGIN, "account_name", lambda: "eva@lab")
    assert resume_run(store, "r", TimedOrders()).outcome == "reached"
    with Journal(store) as journal:
        orders = [line.content for line in journal.lines("r", kinds=["order"])]
        times = [line.at_ms for line in journal.lines("r")]
    assert [order["order"] for order in orders] == ["stop", TAKEN_UP_AGAIN]
    assert orders[-1]["who"] == "eva@lab"
    assert times == sorted(times)


def test_a_run_that_was_killed_while_it_was_planned_gives_its_name_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, _ = planned(TARGET)
    wanted = RunRequest(TARGET, store=str(tmp_path / "j.db"))
    killed = [name_run(wanted, problem), name_run(replace(wanted, run="mine"), problem)]
    assert [request.run for request in killed] == [f"{problem.name}-1", "mine"]
    with pytest.raises(InvalidInput, match="there is a run mine already"):
        name_run(replace(wanted, run="mine"), problem)
    for request in killed:
        assert request.lease is not None
        request.lease.stop_beat()
    monkeypatch.setattr(LEASE, "is_gone", lambda _: True)
    again = [name_run(wanted, problem), name_run(replace(wanted, run="mine"), problem)]
    assert [request.run for request in again] == [request.run for request in killed]
    for request in (*killed, *again):
        assert request.lease is not None
        request.lease.close()


def test_who_has_lost_a_name_does_not_take_it_off_the_list(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, _ = planned(TARGET)
    wanted = RunRequest(TARGET, store=str(tmp_path / "j.db"), run="r")
    monkeypatch.setattr(LEASE, "is_gone", lambda _: True)
    with list_run(wanted, problem) as listed:
        assert listed.lease is not None
        listed.lease.stop_beat()
        other = name_run(wanted, problem)
    with Journal(wanted.store) as journal:
        assert journal.run("r") is not None
    assert other.lease is not None
    other.lease.close()
