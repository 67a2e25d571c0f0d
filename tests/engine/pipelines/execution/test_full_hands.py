"""An interruption waits for empty hands also where the run was taken up again, or goes on after
an exception.
"""

import pytest

from cellwright.engine.model.run_protocol import (
    JournalRecord,
    OperatorCommand,
    RecordKind,
    RunPhase,
)
from cellwright.engine.pipelines.execution import GivenOrder, TimedOrders
from cellwright.engine.pipelines.execution.compiled_program import initial_situation
from cellwright.engine.pipelines.execution.plan_records import compiled_of
from cellwright.engine.pipelines.execution.run_goals import RunScope
from cellwright.engine.pipelines.execution.run_loop import RunLoop
from cellwright.engine.pipelines.execution.run_resumption import PastRun, standing_again
from cellwright.engine.pipelines.recovery import SymbolicWorld
from cellwright.engine.pipelines.simulators import Injection
from cellwright.engine.stages.execution.start_forecast import Accuracy
from tests.engine.pipelines.execution.executed_cells import executed, planned

PICK, STORE = "pick(probe_1, slot(drawer, 1))", "put(probe_1, slot(drawer, 1))"
BRING = "put(probe_1, slot(furnace, 1))"
known: dict[int, Accuracy] = {}  # after each group of records
Flushed = list[tuple[int, frozenset[str], bool]]


@pytest.fixture
def flushed(monkeypatch: pytest.MonkeyPatch) -> Flushed:
    """After each group of records: the last one's number, the hands that hold something, and
    whether a case is open.
    """
    seen: Flushed = []
    flush = RunLoop.flush
    known.clear()

    def followed(course: RunLoop) -> None:
        flush(course)
        quiet = course.standing.phase in (RunPhase.QUIESCING, RunPhase.HANDLING)
        seen.append((course.recorder.last, course.standing.unrested, quiet))
        known[course.recorder.last] = course.accuracy

    monkeypatch.setattr(RunLoop, "flush", followed)
    return seen


@pytest.mark.parametrize(
    ("step", "cause"),
    [
        (PICK, "not_gripped"),
        (STORE, "probe_slipped"),
        ("heat(probe_1, slot(furnace, 1), 900)", "furnace_cold"),
    ],
)
def test_what_is_in_the_hands_follows_from_the_journal(
    step: str, cause: str, flushed: Flushed
) -> None:
    problem, _ = planned("themse/one")
    _, records, _ = executed("themse/one", [Injection(step, cause)])
    past, read = (
        PastRun(SymbolicWorld.of(problem, initial_situation(problem).state), RunScope(problem)),
        0,
    )
    for number, full, open_case in flushed:
        for record in records[read:number]:
            past.take(record)
        read = number
        assert past.accuracy == known[number]
        assert (
            open_case
            or standing_again(compiled_of(past.plan or {}), past, past.at_ms).unrested == full
        )
    assert any(full for _, full, _ in flushed)


@pytest.mark.parametrize("order_ms", [10_000, 17_000, 18_000, 30_000])
def test_a_pause_that_was_asked_for_before_or_during_an_exception_comes_once_it_is_put_right(
    order_ms: int,
) -> None:
    orders = TimedOrders(
        [
            (order_ms, GivenOrder(OperatorCommand.INTERRUPT)),
            (100_000, GivenOrder(OperatorCommand.CONTINUE)),
        ]
    )
    ending, records, _ = executed("themse/one", [Injection(PICK, "not_gripped")], orders=orders)
    (paused,) = pauses(records)
    assert (ending.outcome, paused.at_ms) == ("reached", 32_000)  # nothing is in the gripper yet
    assert not [
        each for each in records if each.kind is RecordKind.DONE and 32_000 < each.at_ms < 100_000
    ]


def test_after_an_exception_with_something_in_the_hand_a_pause_waits_until_it_is_put_down() -> None:
    orders = TimedOrders([(17_500, GivenOrder(OperatorCommand.INTERRUPT))])
    _, records, _ = executed("themse/one", [Injection(BRING, "probe_slipped")], orders=orders)
    recovery = next(
        r for r in records if r.kind is RecordKind.PLAN and r.content["why"] == "recovery"
    )
    assert recovery.content["full"] == ["mars_gripper"]
    (paused,) = pauses(records)
    done = [
        r.content["action"]
        for r in records[recovery.number : paused.number]
        if r.kind is RecordKind.DONE
    ]
    assert done == [BRING]


def pauses(records: list[JournalRecord]) -> list[JournalRecord]:
    return [
        each
        for each in records
        if each.kind is RecordKind.PHASE and each.content["phase"] == "paused"
    ]
