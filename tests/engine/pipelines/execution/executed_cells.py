"""Runs in simulated cells for tests: planned once, executed often, killed where a test wants."""

import json
import sys
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import pytest

from cellwright.engine.model.run_protocol import Finish, JournalRecord
from cellwright.engine.pipelines.execution import (
    OrderSource,
    RunExecution,
    RunRequest,
    TimedOrders,
    begin_run,
    name_run,
    resume_run,
)
from cellwright.engine.pipelines.execution.compiled_program import initial_situation
from cellwright.engine.pipelines.execution.executable_plan import ReadyPlan, first_plan
from cellwright.engine.pipelines.execution.record_shapes import read_record
from cellwright.engine.pipelines.execution.run_journal import Recorder
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.pipelines.recovery import SymbolicWorld
from cellwright.engine.pipelines.simulators import HiddenCell, Injection, Simulator
from cellwright.engine.pipelines.simulators.simulator_settings import SimulatorSettings
from cellwright.engine.pipelines.simulators.virtual_clock import fault_base
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.json_text import parse_json
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.store.journal import Journal, JournalLine

BEGIN = sys.modules["cellwright.engine.pipelines.execution.run_start"]


class Kept:
    """A journal in memory."""

    def __init__(self) -> None:
        self.records: list[JournalRecord] = []

    def append(self, records: Sequence[JournalRecord]) -> None:
        for record in records:
            read_record(line_of(record))  # what a run writes can be read
        self.records += records


def line_of(record: JournalRecord) -> JournalLine:
    """A record as a database gives it back."""
    content = parse_json(json.dumps(record.content))
    assert isinstance(content, dict)
    return JournalLine(record.number, record.at_ms, record.kind.value, content)


class Killed(BaseException):
    """The process is gone."""


@cache
def planned(target: str) -> tuple[Problem, ReadyPlan]:
    problem = problem_of(target)
    found = first_plan(problem)
    assert isinstance(found, ReadyPlan)
    return problem, found


def executed(
    target: str,
    injections: Sequence[Injection] = (),
    settings: SimulatorSettings | None = None,
    orders: OrderSource | None = None,
    approve: bool = False,
) -> tuple[Finish, list[JournalRecord], HiddenCell]:
    """A run in memory: how it ended, its records, and the cell as it really is."""
    problem, ready = planned(target)
    base = fault_base(problem)
    cell = HiddenCell(problem, base, tuple(injections))
    driver = Simulator(cell, settings or SimulatorSettings())
    kept = Kept()
    execution = RunExecution(
        "r", problem, driver, Recorder(kept, driver.now_ms), orders or TimedOrders(), base
    )
    ending = execution.start(
        ready, SymbolicWorld.of(problem, initial_situation(problem).state), approve
    )
    return ending, kept.records, cell


def killed_and_resumed(
    target: str, folder: Path, group: int, written: bool, fault: str = ""
) -> tuple[Finish | None, list[str]]:
    """A run whose process is gone at one group of records, before or after it is written, and is
    then taken up again.

    What the cell itself says that it did comes with it; None if the run was over before. A kill
    behind the record of the end leaves nothing to resume: the journal tells how the run ended.
    """
    problem, ready = planned(target)
    options = {"log": str(folder / "cell.jsonl")} | ({"fault": fault} if fault else {})
    wanted = name_run(RunRequest(target, store=str(folder / "j.db"), options=options), problem)
    ledger, plan = BEGIN.JournalLedger.append, BEGIN.first_plan
    count = 0

    def append(self: object, records: Sequence[JournalRecord]) -> None:
        nonlocal count
        count += 1
        if count == group and not written:
            raise Killed
        ledger(self, records)
        if count == group:
            raise Killed

    ending: object = None
    BEGIN.JournalLedger.append, BEGIN.first_plan = append, lambda *_: ready
    try:
        begin_run(wanted, problem, TimedOrders())
    except Killed:
        BEGIN.JournalLedger.append = ledger
        ending = ended(wanted) or resume_run(wanted.store, wanted.run, TimedOrders())
    finally:
        BEGIN.JournalLedger.append, BEGIN.first_plan = ledger, plan
    log = Path(wanted.options["log"]).read_text(encoding="utf-8").splitlines()
    did = [entry for entry in map(json.loads, filter(None, log)) if "ended" in entry]
    return ending if isinstance(ending, Finish) else None, [
        f"{each['ended']} {each['action']}" for each in did
    ]


def ended(wanted: RunRequest) -> Finish | None:
    """How a run ended for good, as its journal tells; None if it did not. `resume` must refuse
    what is over.
    """
    with Journal(wanted.store) as journal:
        told = [line.content for line in journal.lines(wanted.run, kinds=["end"])]
    if not told or told[-1]["outcome"] not in BEGIN.FINAL_OUTCOMES:
        return None
    with pytest.raises(InvalidInput, match=f"is over: {told[-1]['outcome']}"):
        resume_run(wanted.store, wanted.run, TimedOrders())
    return Finish(wanted.run, told[-1]["outcome"], goals=tuple(told[-1]["goals"]))
