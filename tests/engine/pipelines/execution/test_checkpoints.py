"""What a checkpoint says of a run is what all records before it say."""

import pickle
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path

import pytest

from cellwright.engine.model.run_protocol import JournalRecord, OperatorCommand, RecordKind
from cellwright.engine.pipelines.execution import GivenOrder, TimedOrders
from cellwright.engine.pipelines.execution.checkpoints import past_of
from cellwright.engine.pipelines.execution.compiled_program import initial_situation
from cellwright.engine.pipelines.execution.plan_records import compiled_of
from cellwright.engine.pipelines.execution.run_goals import RunScope
from cellwright.engine.pipelines.execution.run_resumption import PastRun, standing_again
from cellwright.engine.pipelines.recovery import KeptHistory, SymbolicWorld
from cellwright.engine.pipelines.simulators import Injection
from cellwright.engine.pipelines.simulators.virtual_clock import fault_base
from cellwright.kb.store.journal import JournalLine
from tests.engine.pipelines.execution.executed_cells import executed, planned

BAKERY = str(Path(__file__).parents[3] / "domains" / "bakery" / "problems" / "four.yaml")
RUNS = {
    "a recovery": ("themse/one", (Injection("pick(probe_1, slot(drawer, 1))", "not_gripped"),), ()),
    "spoilt work": ("themse/one", (Injection("put(probe_1, slot(drawer, 1))", "low_voltage"),), ()),
    "a further command": ("themse/one", (), ((3_000, "process probe_2 in the furnace for 5 min"),)),
    "due dates": (BAKERY, (), ((7_000, "due(t4, 15 min); priority(t4, 10)"),)),
}


class Part:
    """The first lines of a journal."""

    def __init__(self, records: Sequence[JournalRecord]) -> None:
        self.all = [JournalLine(r.number, r.at_ms, r.kind.value, r.content) for r in records]

    def last(self, _run: str, kind: str = "", before: int | None = None) -> int:
        some = self.all if before is None else self.all[: before - 1]
        return max((each.number for each in some if kind in ("", each.kind)), default=0)

    def line(self, _run: str, number: int) -> JournalLine:
        return self.all[number - 1]

    def lines(self, _run: str, after: int = 0) -> Iterator[JournalLine]:
        yield from self.all[after:]


@cache
def records_of(name: str) -> tuple[JournalRecord, ...]:
    target, faults, orders = RUNS[name]
    given = TimedOrders([(at_ms, GivenOrder(OperatorCommand.ADD, text)) for at_ms, text in orders])
    return tuple(executed(target, faults, orders=given)[1])


def past(name: str, records: Sequence[JournalRecord], checkpoints: bool) -> PastRun:
    problem, _ = planned(RUNS[name][0])
    start = SymbolicWorld.of(problem, initial_situation(problem).state)
    found = PastRun(start, RunScope(problem), KeptHistory.of(fault_base(problem)))
    if checkpoints:
        return past_of(Part(records), "r", found)  # type: ignore[arg-type]
    for each in records:
        found.take(each)
    return found


def essence(found: PastRun) -> dict[str, object]:
    """What a run goes on with."""
    assert found.plan is not None
    standing = standing_again(compiled_of(found.plan), found, found.at_ms)
    return {
        "left": {e["id"]: e["step"] for e in found.plan["steps"] if e["id"] not in found.done},
        "facts": found.world.facts,
        "reached": found.world.reached,
        "ready": standing.ready,
        "running": standing.running,
        "waits": {(each.target, until) for each, until in standing.dwelling.items()},
        "sent": found.sent,
        "history": [(each.step, each.added, each.moved) for each in found.history],
        "since": {atom: at for atom, at in found.since.items() if atom in found.world.facts},
        "steps": found.steps + len(found.done),
        "case": [each.number for each in found.case],
        "same": (found.cases, found.number, found.exceptions, found.ended, found.last, found.at_ms),
        "goals": (
            found.scope.problem.goal,
            found.scope.problem.chains,
            found.scope.given_up,
            found.whole.chains,
        ),
        "wishes": set(map(str, found.scope.problem.statics)),
    }


@pytest.mark.parametrize(
    "name",
    [
        "a recovery",
        *(pytest.param(each, marks=pytest.mark.slow) for each in RUNS if each != "a recovery"),
    ],
)
def test_a_run_from_its_last_checkpoint_is_the_run_from_its_beginning(
    monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setattr(
        "cellwright.engine.pipelines.execution.run_control.RECORDS_PER_CHECKPOINT", 9
    )
    monkeypatch.setattr("cellwright.engine.pipelines.execution.checkpoints.MIN_PAGED_STEPS", 4)
    monkeypatch.setattr("cellwright.engine.pipelines.execution.checkpoints.STEPS_PER_PAGE", 3)
    records = records_of(name)
    said = [set(each.content) for each in records if each.kind is RecordKind.CHECKPOINT]
    assert {"rest"} in said
    assert {"state"} in said
    assert any(each.content.get("rest", {}).get("pages") for each in records)
    for last in range(9, len(records) + 1, 4):
        part = records[
            :last
        ]  # also between the pages of what is left, and behind them, before the checkpoint
        assert essence(past(name, part, checkpoints=True)) == essence(
            past(name, part, checkpoints=False)
        )


def test_a_program_can_be_sent_to_another_process() -> None:
    _, ready = planned("themse/one")
    sent = pickle.loads(pickle.dumps(ready.compiled))
    assert (sent.program, sent.plan) == (ready.compiled.program, ready.compiled.plan)
