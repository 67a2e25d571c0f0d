"""What the executive and its journal cost: events a second, memory of a long run, and how long a
resumed run takes to begin.

    python benchmarks/execution.py [--steps N] [--folder DIR] [--json FILE]

The journal lies in a file on a disk (--folder; else in the folder for temporary files) and is
synced as in a real run. Four devices switch lamps on and off on a virtual clock. Exits with 1 when
a bar is missed: 2,000 events a second with group commit, 200 records a second with one sync each
where the disk allows them, memory that grows by less than a tenth in the second half of a long run,
and a resume from the journal of that run within 5 s. A step makes three records: --steps 333334 is
a journal of a million. Resumes from the first half, tenth and hundredth of the journal are shown,
too: they cost what the plan has left to do.
"""

import argparse
import gc
import json
import os
import resource
import sqlite3
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from cellwright.engine.model.run_protocol import JournalRecord, RecordKind
from cellwright.engine.pipelines.execution import RunExecution, TimedOrders
from cellwright.engine.pipelines.execution.checkpoints import past_of
from cellwright.engine.pipelines.execution.compiled_program import initial_situation
from cellwright.engine.pipelines.execution.executable_plan import compile_ready_plan
from cellwright.engine.pipelines.execution.run_goals import RunScope
from cellwright.engine.pipelines.execution.run_journal import Recorder
from cellwright.engine.pipelines.execution.run_resumption import PastRun, taken_up
from cellwright.engine.pipelines.execution.run_start import JournalLedger, RunRequest, run_document
from cellwright.engine.pipelines.recovery import SymbolicWorld
from cellwright.engine.pipelines.simulators import HiddenCell, Simulator
from cellwright.engine.pipelines.simulators.simulator_settings import SimulatorSettings
from cellwright.kb.loader import load
from cellwright.kb.model.plan_model import Plan, Step, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.store.journal import Journal, JournalLine
from cellwright.kb.terms import Function

LAMPS = 4
GROUPED, SINGLE, GROWTH, RESUME_S = 2_000, 200, 1.1, 5.0
ALLOWED = 0.7  # of the syncs that the disk allows, where it does not allow 200
DOMAIN = """domain: lamps
types: {lamp: object}
objects: {lamp: [lamp_1..4]}
fluents:
  lit(lamp): {}
  dark(lamp): {}
operators:
  on(Lamp):
    preconditions: dark(Lamp)
    adds: lit(Lamp)
    deletes: dark(Lamp)
    resources: Lamp
    duration: 1 s
    command: {stream: switch(Lamp), reply: done}
  off(Lamp):
    preconditions: lit(Lamp)
    adds: dark(Lamp)
    deletes: lit(Lamp)
    resources: Lamp
    duration: 1 s
    command: {stream: switch(Lamp), reply: done}
defaults:
  - dark(Lamp)
"""
PROBLEM = "problem: blink\ndomain: lamps\ngoals:\n  - dark(lamp_1)\n"


def problem_in(folder: Path) -> Problem:
    """Four lamps that are dark."""
    (folder / "domain.yaml").write_text(DOMAIN, "utf-8")
    (folder / "problem.yaml").write_text(PROBLEM, "utf-8")
    found = load(folder / "problem.yaml").problem
    assert found is not None
    return found


def blinking(steps: int) -> Plan:
    """Each lamp goes on and off, beside the others."""
    made = []
    for place in range(steps):
        lamp = Function(f"lamp_{place % LAMPS + 1}")
        after = (StepId(place + 1 - LAMPS),) if place >= LAMPS else ()
        name = "on" if place // LAMPS % 2 == 0 else "off"
        made.append(Step(StepId(place + 1), Function(name, (lamp,)), after, (lamp,), 1))
    return Plan(tuple(made))


def memory_mb() -> float:
    """The memory that the process holds now."""
    pages = int(Path("/proc/self/statm").read_text("ascii").split()[1])
    return pages * resource.getpagesize() / 1e6


class Meter:
    """Counts records, and looks at the memory at the middle and at the end."""

    def __init__(self, steps: int) -> None:
        self.steps, self.records, self.done = steps, 0, 0
        self.middle = self.last = 0.0

    def __call__(self, record: JournalRecord) -> None:
        self.records += 1
        if record.kind is RecordKind.DONE:
            self.done += 1
            if self.done == self.steps // 2:
                self.middle = memory_mb()
        if record.kind is RecordKind.END:
            self.last = memory_mb()


def run(folder: Path, steps: int) -> dict[str, float]:
    """A run of many steps with its journal on the disk."""
    problem = problem_in(folder)
    program = compile_ready_plan(problem, blinking(steps), None, 0)
    meter = Meter(steps)
    with Journal(str(folder / "runs.db")) as journal:
        journal.begin("blink", "2026-01-01T00:00:00+00:00", {})
        driver = Simulator(HiddenCell(problem, None), SimulatorSettings())
        recorder = Recorder(JournalLedger(journal, "blink"), driver.now_ms, [meter])
        execution = RunExecution("blink", problem, driver, recorder, TimedOrders())
        recorder.note(RecordKind.RUN, **run_document(RunRequest("blink"), problem))
        started, worked = time.perf_counter(), time.process_time()
        ending = execution.start(
            program, SymbolicWorld.of(problem, initial_situation(problem).state)
        )
        seconds, work = time.perf_counter() - started, time.process_time() - worked
    assert ending.outcome == "reached", ending
    return {
        "records": meter.records,
        "seconds": seconds,
        "events a second": meter.records / seconds,
        "events a second of the processor": meter.records / work,
        "memory at half (MB)": meter.middle,
        "memory at the end (MB)": meter.last,
    }


def synced_one_by_one(folder: Path, records: int = 1_000) -> float:
    """Records a second, each on the disk before the next."""
    with Journal(str(folder / "single.db")) as journal:
        journal.begin("one", "2026-01-01T00:00:00+00:00", {})
        started = time.perf_counter()
        for number in range(1, records + 1):
            journal.append("one", [JournalLine(number, number, "goal", {"goal": "lit(lamp_1)"})])
        return records / (time.perf_counter() - started)


def syncs_a_second(folder: Path, seconds: float = 2.0) -> float:
    """How many times a second the disk says that a page is on it, with nothing else done.

    More than this no journal can be.
    """
    with (folder / "syncs.bin").open("wb", buffering=0) as file:
        began, count = time.perf_counter(), 0
        while time.perf_counter() - began < seconds:
            file.write(b"\0" * 4096)
            os.fsync(file.fileno())
            count += 1
        return count / (time.perf_counter() - began)


def resumed(folder: Path) -> tuple[float, float]:
    """Seconds of the clock and of the processor to rebuild where the long run stands, from its
    last checkpoint on, until it can go on.
    """
    problem = problem_in(folder)
    with Journal(str(folder / "runs.db")) as journal:
        started, worked = time.perf_counter(), time.process_time()
        begun = PastRun(
            SymbolicWorld.of(problem, initial_situation(problem).state), RunScope(problem)
        )
        past = past_of(journal, "blink", begun)
        _, standing = taken_up(past, lambda _stream: 1, past.at_ms)
        assert past.last == journal.last("blink")
        assert standing.ready or standing.running or past.ended
        return time.perf_counter() - started, time.process_time() - worked


def resumes(folder: Path, records: int) -> dict[str, float]:
    """Seconds to go on from the journal, and from parts of it, as if the run had been killed
    there.
    """
    found = {}
    with sqlite3.connect(folder / "runs.db") as database:
        for part in (1, 2, 10, 100):
            database.execute("DELETE FROM journal WHERE number > ?", (records // part,))
            database.commit()
            clock, processor = resumed(folder)
            found[f"resume from {records // part} records (s)"] = clock
            found[f"resume from {records // part}, of the processor"] = processor
    return found


def main() -> int:
    """Print the figures; 1 if a bar is missed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--steps", type=int, default=100_000)
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    gc.set_threshold(100_000)  # as the commands do
    with tempfile.TemporaryDirectory(dir=asked.folder) as name:
        figures: dict[str, Any] = run(Path(name), asked.steps)
        figures["syncs a second that the disk allows"] = syncs_a_second(Path(name))
        figures["records a second, one sync each"] = synced_one_by_one(Path(name))
        back = resumes(Path(name), int(figures["records"]))
    figures |= back
    for what, value in figures.items():
        sys.stdout.write(f"{what:<36} {value:>12,.1f}\n")
    if asked.json:
        asked.json.write_text(json.dumps(figures, indent=1) + "\n", "utf-8")
    missed = [
        figures["events a second"] < GROUPED,
        figures["records a second, one sync each"]
        < min(SINGLE, ALLOWED * figures["syncs a second that the disk allows"]),
        figures["memory at the end (MB)"] > GROWTH * figures["memory at half (MB)"],
        next(iter(back.values())) > RESUME_S,
    ]
    return int(any(missed))


if __name__ == "__main__":
    sys.exit(main())
