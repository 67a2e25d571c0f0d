"""An interruption waits for empty hands also where the run was taken up again, or goes on after an exception."""

import pytest

from cellwright.engine.model.execution import Order, Phase, Record, RecordKind
from cellwright.engine.pipelines.execution import Given, Timed
from cellwright.engine.pipelines.execution.compiling import situation_of
from cellwright.engine.pipelines.execution.course import Course
from cellwright.engine.pipelines.execution.records import compiled_of
from cellwright.engine.pipelines.execution.resuming import Past
from cellwright.engine.pipelines.execution.scope import Scope
from cellwright.engine.pipelines.execution.settling import standing_again
from cellwright.engine.pipelines.simulation import SymbolicWorld
from cellwright.engine.pipelines.simulator import Injection
from cellwright.engine.stages.execution.outlook import Accuracy
from tests.engine.pipelines.execution.cells import executed, planned

PICK, STORE = "pick(probe_1, slot(drawer, 1))", "put(probe_1, slot(drawer, 1))"
BRING = "put(probe_1, slot(furnace, 1))"
known: dict[int, Accuracy] = {}  # after each group of records
Flushed = list[tuple[int, frozenset[str], bool]]


@pytest.fixture
def flushed(monkeypatch: pytest.MonkeyPatch) -> Flushed:
    """After each group of records: the last one's number, the hands that hold something, and whether a case is open."""
    seen: Flushed = []
    flush = Course.flush
    known.clear()

    def followed(course: Course) -> None:
        flush(course)
        quiet = course.standing.phase in (Phase.QUIESCING, Phase.HANDLING)
        seen.append((course.recorder.last, course.standing.unrested, quiet))
        known[course.recorder.last] = course.accuracy

    monkeypatch.setattr(Course, "flush", followed)
    return seen


@pytest.mark.parametrize(
    ("step", "cause"),
    [
        (PICK, "not_gripped"),
        (STORE, "probe_slipped"),
        ("heat(probe_1, slot(furnace, 1), 900)", "furnace_cold"),
    ],
)
def test_what_is_in_the_hands_follows_from_the_journal(step: str, cause: str, flushed: Flushed) -> None:
    problem, _ = planned("themse/one")
    _, records, _ = executed("themse/one", [Injection(step, cause)])
    past, read = Past(SymbolicWorld.of(problem, situation_of(problem).state), Scope(problem)), 0
    for number, full, open_case in flushed:
        for record in records[read:number]:
            past.take(record)
        read = number
        assert past.accuracy == known[number]
        assert open_case or standing_again(compiled_of(past.plan or {}), past, past.at_ms).unrested == full
    assert any(full for _, full, _ in flushed)


@pytest.mark.parametrize("order_ms", [10_000, 17_000, 18_000, 30_000])
def test_a_pause_that_was_asked_for_before_or_during_an_exception_comes_once_it_is_put_right(
    order_ms: int,
) -> None:
    orders = Timed([(order_ms, Given(Order.INTERRUPT)), (100_000, Given(Order.CONTINUE))])
    ending, records, _ = executed("themse/one", [Injection(PICK, "not_gripped")], orders=orders)
    (paused,) = pauses(records)
    assert (ending.outcome, paused.at_ms) == ("reached", 32_000)  # nothing is in the gripper yet
    assert not [each for each in records if each.kind is RecordKind.DONE and 32_000 < each.at_ms < 100_000]


def test_after_an_exception_with_something_in_the_hand_a_pause_waits_until_it_is_put_down() -> None:
    orders = Timed([(17_500, Given(Order.INTERRUPT))])
    _, records, _ = executed("themse/one", [Injection(BRING, "probe_slipped")], orders=orders)
    recovery = next(r for r in records if r.kind is RecordKind.PLAN and r.content["why"] == "recovery")
    assert recovery.content["full"] == ["mars_gripper"]
    (paused,) = pauses(records)
    done = [
        r.content["action"] for r in records[recovery.number : paused.number] if r.kind is RecordKind.DONE
    ]
    assert done == [BRING]


def pauses(records: list[Record]) -> list[Record]:
    return [each for each in records if each.kind is RecordKind.PHASE and each.content["phase"] == "paused"]
