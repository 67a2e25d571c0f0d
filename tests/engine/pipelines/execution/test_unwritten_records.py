"""A run whose journal cannot be written any more tells what was done and is not in it."""

from collections.abc import Sequence

from cellwright.engine.model.run_protocol import JournalRecord, RecordKind
from cellwright.engine.pipelines.execution import RunExecution, TimedOrders
from cellwright.engine.pipelines.execution.compiled_program import initial_situation
from cellwright.engine.pipelines.execution.run_journal import Recorder
from cellwright.engine.pipelines.recovery import SymbolicWorld
from cellwright.engine.pipelines.simulators import HiddenCell, Simulator
from cellwright.engine.pipelines.simulators.virtual_clock import fault_base
from cellwright.kb.store.journal import JournalFailure
from tests.engine.pipelines.execution.executed_cells import Kept, planned


class Full(Kept):
    """A journal on a disk that is full after so many steps."""

    def __init__(self, steps: int) -> None:
        super().__init__()
        self.steps = steps

    def append(self, records: Sequence[JournalRecord]) -> None:
        """Append records while there is room."""
        done = [record for record in (*self.records, *records) if record.kind is RecordKind.DONE]
        if len(done) > self.steps:
            raise JournalFailure("database or disk is full")
        super().append(records)


def test_what_was_done_and_is_not_written_is_told() -> None:
    problem, ready = planned("themse/one")
    base = fault_base(problem)
    driver, full = Simulator(HiddenCell(problem, base, ())), Full(3)
    recorder = Recorder(full, driver.now_ms)
    execution = RunExecution("r", problem, driver, recorder, TimedOrders(), base)
    world = SymbolicWorld.of(problem, initial_situation(problem).state)
    ending = execution.start(ready, world)
    fourth = ready.plan.steps[3]
    assert (ending.outcome, ending.steps) == ("stopped", 4)
    assert "disk is full" in ending.why
    assert f"done, and not in the journal: step {fourth.id}, {fourth.operator}" in ending.story
