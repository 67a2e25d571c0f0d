"""A run that is killed is taken up again: it reaches the same goals, and nothing is done twice."""

import itertools
from pathlib import Path

import pytest
from _pytest.mark import ParameterSet

from cellwright.engine.model.run_protocol import JournalRecord, OperatorCommand, RecordKind
from cellwright.engine.pipelines.execution import (
    GivenOrder,
    RunRequest,
    TimedOrders,
    begin_run,
    name_run,
    resume_run,
)
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.store.journal import Journal
from tests.engine.pipelines.execution.executed_cells import ended, killed_and_resumed, planned

FAULT = "pick(probe_1, slot(drawer, 1))=not_gripped"


def check(folder: Path, group: int, written: bool, fault: str) -> bool:
    """Kill a run once and compare; whether it was killed at all."""
    ending, did = killed_and_resumed("themse/one", folder, group, written, fault)
    assert len({each.split(" ")[0] for each in did}) == len(did)
    if ending is not None:
        assert (ending.outcome, len(ending.goals)) == ("reached", 3)
    return ending is not None


def slowly(group: int, written: bool) -> ParameterSet:
    return pytest.param(group, written, marks=pytest.mark.slow)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("group", "written"),
    [(2, True), slowly(5, False), slowly(6, True), slowly(9, True), (27, False)],
)
def test_a_run_killed_with_a_fault_in_it_reaches_its_goals(
    tmp_path: Path, group: int, written: bool
) -> None:
    assert check(tmp_path, group, written, FAULT)


@pytest.mark.parametrize(("group", "written"), [slowly(14, False), (20, True), slowly(24, True)])
def test_a_run_goes_on_from_a_checkpoint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, group: int, written: bool
) -> None:
    monkeypatch.setattr(
        "cellwright.engine.pipelines.execution.run_control.RECORDS_PER_CHECKPOINT", 15
    )
    assert check(tmp_path, group, written, FAULT)
    with Journal(str(tmp_path / "j.db")) as journal:
        assert journal.last("one-1", "checkpoint")


@pytest.mark.slow
@pytest.mark.parametrize("group", [20, 25])
def test_a_run_goes_on_from_a_checkpoint_that_holds_what_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, group: int
) -> None:
    monkeypatch.setattr(
        "cellwright.engine.pipelines.execution.run_control.RECORDS_PER_CHECKPOINT", 12
    )
    monkeypatch.setattr("cellwright.engine.pipelines.execution.checkpoints.MIN_PAGED_STEPS", 3)
    assert check(tmp_path, group, True, FAULT)
    with Journal(str(tmp_path / "j.db")) as journal:
        assert any("rest" in each.content for each in journal.lines("one-1", kinds=["checkpoint"]))


@pytest.mark.slow
def test_one_can_go_back_to_a_step_that_was_done_before_a_checkpoint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "cellwright.engine.pipelines.execution.run_control.RECORDS_PER_CHECKPOINT", 6
    )
    monkeypatch.setattr("cellwright.engine.pipelines.execution.checkpoints.MIN_PAGED_STEPS", 3)
    problem, ready = planned("themse/one")
    wanted = name_run(RunRequest("themse/one", store=str(tmp_path / "j.db")), problem)
    late = ready.makespan * 1000 - 10_000
    assert (
        begin_run(wanted, problem, TimedOrders([(late, GivenOrder(OperatorCommand.STOP))])).outcome
        == "stopped"
    )
    orders = [
        (0, GivenOrder(OperatorCommand.INTERRUPT)),
        (late + 40_000, GivenOrder(OperatorCommand.BACK, "1")),
        (late + 41_000, GivenOrder(OperatorCommand.CONTINUE)),
    ]
    ending = resume_run(wanted.store, wanted.run, TimedOrders(orders))
    with Journal(wanted.store) as journal:
        told = [each.content for each in journal.lines(wanted.run, kinds=["decision", "plan"])]
    assert not any("no step 1" in str(each.get("why")) for each in told)
    assert ending.outcome in ("reached", "paused")


@pytest.mark.slow
def test_a_run_can_be_killed_at_any_group_of_records(tmp_path: Path) -> None:
    """At every third group, before or after it is written in turn; `benchmarks/kills.py` kills
    at every one.
    """
    for group in itertools.count(2, 3):
        folder = tmp_path / str(group)
        folder.mkdir()
        if not check(folder, group, group % 2 == 0, FAULT):
            return


@pytest.mark.slow
def test_a_run_that_is_killed_behind_its_end_is_over(tmp_path: Path) -> None:
    problem, _ = planned("themse/one")
    wanted = name_run(RunRequest("themse/one", store=str(tmp_path / "j.db")), problem)
    groups = 0

    def count(record: JournalRecord) -> None:
        nonlocal groups
        groups += record.kind is RecordKind.END

    assert begin_run(wanted, problem, TimedOrders(), [count]).outcome == "reached"
    assert groups == 1
    ending = ended(wanted)
    assert ending is not None
    assert ending.outcome == "reached"


@pytest.mark.slow
def test_a_stopped_run_is_taken_up_again(tmp_path: Path) -> None:
    problem, _ = planned("themse/one")
    wanted = name_run(RunRequest("themse/one", store=str(tmp_path / "j.db")), problem)
    ending = begin_run(wanted, problem, TimedOrders([(20_000, GivenOrder(OperatorCommand.STOP))]))
    assert ending.outcome == "stopped"
    assert resume_run(wanted.store, wanted.run, TimedOrders()).outcome == "reached"
    with pytest.raises(InvalidInput, match="is over"):
        resume_run(wanted.store, wanted.run, TimedOrders())
