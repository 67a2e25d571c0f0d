"""Runs in simulated cells for tests: planned once, executed often, killed where a test wants."""

import json
import sys
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import pytest

from cellwright.engine.model.execution import Finish, Record
from cellwright.engine.pipelines.execution import Execution, Orders, Timed, Wanted, begin, named, resume
from cellwright.engine.pipelines.execution.compiling import situation_of
from cellwright.engine.pipelines.execution.planned import Ready, first
from cellwright.engine.pipelines.execution.recorder import Recorder
from cellwright.engine.pipelines.planning import problem_of
from cellwright.engine.pipelines.simulation import SymbolicWorld
from cellwright.engine.pipelines.simulator import HiddenCell, Injection, Simulator
from cellwright.engine.pipelines.simulator.driver import fault_base
from cellwright.engine.pipelines.simulator.settings import Settings
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.problem import Problem
from cellwright.kb.store.journal import Journal

BEGIN = sys.modules["cellwright.engine.pipelines.execution.begin"]


class Kept:
    """A journal in memory."""

    def __init__(self) -> None:
        self.records: list[Record] = []

    def append(self, records: Sequence[Record]) -> None:
        self.records += records


class Killed(BaseException):
    """The process is gone."""


@cache
def planned(target: str) -> tuple[Problem, Ready]:
    problem = problem_of(target)
    found = first(problem)
    assert isinstance(found, Ready)
    return problem, found


def executed(
    target: str,
    injections: Sequence[Injection] = (),
    settings: Settings | None = None,
    orders: Orders | None = None,
    approve: bool = False,
) -> tuple[Finish, list[Record], HiddenCell]:
    """A run in memory: how it ended, its records, and the cell as it really is."""
    problem, ready = planned(target)
    base = fault_base(problem)
    cell = HiddenCell(problem, base, tuple(injections))
    driver = Simulator(cell, settings or Settings())
    kept = Kept()
    execution = Execution("r", problem, driver, Recorder(kept, driver.now_ms), orders or Timed(), base)
    ending = execution.start(ready, SymbolicWorld.of(problem, situation_of(problem).state), approve)
    return ending, kept.records, cell


def killed_and_resumed(
    target: str, folder: Path, group: int, written: bool, fault: str = ""
) -> tuple[Finish | None, list[str]]:
    """A run whose process is gone at one group of records, before or after it is written, and is then taken up again.

    What the cell itself says that it did comes with it; None if the run was over before. A kill behind the record of the end
    leaves nothing to resume: the journal tells how the run ended.
    """
    problem, ready = planned(target)
    options = {"log": str(folder / "cell.jsonl")} | ({"fault": fault} if fault else {})
    wanted = named(Wanted(target, store=str(folder / "j.db"), options=options), problem)
    ledger, plan = BEGIN.Ledger.append, BEGIN.first
    count = 0

    def append(self: object, records: Sequence[Record]) -> None:
        nonlocal count
        count += 1
        if count == group and not written:
            raise Killed
        ledger(self, records)
        if count == group:
            raise Killed

    ending: object = None
    BEGIN.Ledger.append, BEGIN.first = append, lambda *_: ready
    try:
        begin(wanted, problem, Timed())
    except Killed:
        BEGIN.Ledger.append = ledger
        ending = ended(wanted) or resume(wanted.store, wanted.run, Timed())
    finally:
        BEGIN.Ledger.append, BEGIN.first = ledger, plan
    log = Path(wanted.options["log"]).read_text(encoding="utf-8").splitlines()
    did = [entry for entry in map(json.loads, filter(None, log)) if "ended" in entry]
    return ending if isinstance(ending, Finish) else None, [
        f"{each['ended']} {each['action']}" for each in did
    ]


def ended(wanted: Wanted) -> Finish | None:
    """How a run ended for good, as its journal tells; None if it did not. `resume` must refuse what is over."""
    with Journal(wanted.store) as journal:
        told = [line.content for line in journal.lines(wanted.run, kinds=["end"])]
    if not told or told[-1]["outcome"] not in BEGIN.OVER:
        return None
    with pytest.raises(InvalidInput, match=f"is over: {told[-1]['outcome']}"):
        resume(wanted.store, wanted.run, Timed())
    return Finish(wanted.run, told[-1]["outcome"], goals=tuple(told[-1]["goals"]))
