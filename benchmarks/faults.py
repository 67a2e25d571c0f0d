"""The fault matrix: every cause of a fault base, injected at every step where it can show; how each
run ends.

    python benchmarks/faults.py [--samples N] [--seed N] [--second run|recovery|test] [--faults N]
        [--jobs N] [--cluster ADDRESS] [--json FILE] [TARGET ...]

Without `--samples` the whole matrix; with it, so many runs in all, as many of each target. `--jobs`
runs so many at the same time, `--cluster` has the workers of a cluster run them. `--second` injects
another fault: anywhere in the run, at a step of the recovery from the first, or at a step that
prepares a test or a repair; `--faults 3` injects a third one, behind the second in the same way.
With `--json` what was run is kept there, and the next call goes on behind it. The plan is made
once; each run is in a simulated cell of its own, on the virtual clock. A run passes if it ends with
the goals reached, also in the cell as it really is, or with a reason for each goal that is not, if
no command is carried out twice, and if no two facts that are believed at once exclude each other.
Exits with 1 if one does not pass, or if the plan uses an operator that no exception is about.
"""

import argparse
import gc
import json
import os
import random
import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

from cellwright.engine.kernels.cancellation import Interrupted, never
from cellwright.engine.model.run_protocol import Finish, JournalRecord, RecordKind
from cellwright.engine.pipelines.execution import RunExecution, TimedOrders
from cellwright.engine.pipelines.execution.compiled_program import initial_situation
from cellwright.engine.pipelines.execution.executable_plan import ReadyPlan, first_plan
from cellwright.engine.pipelines.execution.plan_records import read_ground_atom
from cellwright.engine.pipelines.execution.run_journal import Recorder
from cellwright.engine.pipelines.jobs import WorkKind, WorkUnit, carried_out, crew_of
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.pipelines.recovery import Dynamics, SymbolicWorld, WorldState
from cellwright.engine.pipelines.simulators import (
    HiddenCell,
    Injection,
    Simulator,
    exceptions_of_cause,
)
from cellwright.engine.pipelines.simulators.simulator_settings import SimulatorSettings
from cellwright.engine.pipelines.simulators.virtual_clock import fault_base
from cellwright.kb.model.fault_model import FaultModel
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom

TARGETS = ("themse/one", "bulkhead/twelve_points")


class Kept:
    """A journal in memory."""

    def __init__(self) -> None:
        self.records: list[JournalRecord] = []

    def append(self, records: Sequence[JournalRecord]) -> None:
        """Append records."""
        self.records += records


@dataclass
class Watched(SymbolicWorld):
    """A believed world that notes facts that exclude each other, whenever it is corrected."""

    dynamics: Dynamics | None = None
    wrong: list[str] = field(default_factory=list)

    def become(self, state: WorldState) -> tuple[tuple[Atom, ...], tuple[Atom, ...]]:
        """Take another state for true."""
        assert self.dynamics is not None
        pairs = (
            (each, self.dynamics.displaced(state.facts - {each}, (each,))) for each in state.facts
        )
        self.wrong += [
            f"{each} beside {', '.join(map(str, others))}" for each, others in pairs if others
        ]
        return super().become(state)


@dataclass(frozen=True)
class Setting:
    """A problem, its plan and its fault base."""

    target: str
    problem: Problem
    ready: ReadyPlan
    base: FaultModel

    @classmethod
    def of(cls, target: str) -> "Setting":
        """The setting of a target."""
        problem = problem_of(target)
        ready, base = first_plan(problem), fault_base(problem)
        assert isinstance(ready, ReadyPlan)
        assert base is not None
        return cls(target, problem, ready, base)

    def matrix(self) -> list[Injection]:
        """Every cause at every step where it can show, in each way in which it can."""
        return [
            Injection(str(step), cause, 1, exception)
            for step in dict.fromkeys(each.operator for each in self.ready.plan.steps)
            for cause in self.base.causes
            for exception in exceptions_of_cause(self.base, step, cause)
        ]

    def uncovered(self) -> tuple[list[str], list[str]]:
        """The operators of the domain that no exception is about; of them, those that the plan
        uses.
        """
        known = {
            each.operator.name
            for each in self.base.exceptions.values()
            if each.operator is not None
        }
        left = [each.name for each in self.problem.domain.operators if each.name not in known]
        used = {each.operator.name for each in self.ready.plan.steps}
        return left, [each for each in left if each in used]

    def run(self, faults: Sequence[Injection], seed: int) -> "Ran":
        """One run with faults."""
        cell = HiddenCell(self.problem, self.base, tuple(faults), seed)
        driver, kept = Simulator(cell, SimulatorSettings(seed)), Kept()
        run = RunExecution(
            "x", self.problem, driver, Recorder(kept, driver.now_ms), TimedOrders(), self.base
        )
        world = Watched.of(self.problem, initial_situation(self.problem).state)
        world.dynamics = cell.dynamics
        return Ran(run.start(self.ready, world), kept, cell, world)


@dataclass(frozen=True)
class Ran:
    """A run that has ended: how, its journal, the cell as it is, and the cell as it was
    believed to be.
    """

    ending: Finish
    kept: Kept
    cell: HiddenCell
    world: Watched


def fault_of(setting: Setting, made: Ran) -> str:
    """What is wrong with a run; nothing if it passes."""
    ending, cell = made.ending, made.cell
    numbers = [
        each.content["command"] for each in made.kept.records if each.kind is RecordKind.COMMAND
    ]
    if len(set(numbers)) < len(numbers):
        return "a command was sent twice"
    if made.world.wrong:
        return f"it believes {made.world.wrong[0]}"
    if told := [each for each in (ending.why, *ending.story) if "contradicts itself" in each]:
        return told[0]
    if ending.outcome == "reached":
        reached = all(cell.world.reached[c.name] == len(c.stages) for c in setting.problem.chains)
        return "" if reached else "it believes that all goals are reached, and they are not"
    told = {goal for goal, why in ending.given_up if why}
    return "" if set(ending.open_goals) <= told or ending.why else "goals are open without a reason"


class Second(StrEnum):
    """Where another fault is injected."""

    RUN = "run"
    RECOVERY = "recovery"
    TEST = "test"


def second(
    setting: Setting, faults: Sequence[Injection], where: Second, chance: random.Random, seed: int
) -> list[Injection]:
    """Another fault for a run with some faults, behind the last of them; none if there is no
    step where it could be.
    """
    if where is Second.RUN:
        return [chance.choice(setting.matrix())]
    records = setting.run(faults, seed).kept.records
    told = [record.number for record in records if record.kind is RecordKind.EXCEPTION]
    if len(told) < len(faults):
        return []
    times: Counter[str] = Counter()
    places: list[tuple[str, int]] = []
    for each in records:
        if each.kind is RecordKind.COMMAND and each.content["command_kind"] == "step":
            times[each.content["action"]] += 1
            single = each.content["step"] is None
            if each.number > told[len(faults) - 1] and single == (where is Second.TEST):
                places.append((each.content["action"], times[each.content["action"]]))
    ways = [
        Injection(action, cause, time, exception)
        for action, time in places
        for cause in setting.base.causes
        for exception in exceptions_of_cause(setting.base, read_ground_atom(action), cause)
    ]
    return [chance.choice(ways)] if ways else []


def tried(setting: Setting, faults: Sequence[Injection], seed: int) -> tuple[str, str]:
    """How a run with faults ends, and what is wrong with it; nothing if it passes."""
    try:
        made = setting.run(faults, seed)
        return made.ending.outcome, fault_of(setting, made)
    except Exception as error:
        return "crashed", f"{type(error).__name__}: {str(error)[:160]}"


@dataclass
class Tally:
    """What was run so far, by target and faults, in a file if there is one."""

    file: Path | None
    known: dict[str, tuple[str, str]]

    @classmethod
    def of(cls, file: Path | None) -> "Tally":
        """The tally in a file."""
        there = file is not None and file.is_file()
        return cls(file, json.loads(file.read_text("utf-8")) if there and file is not None else {})

    def note(self, key: str, found: tuple[str, str]) -> None:
        """Keep a result."""
        self.known[key] = found
        if self.file is not None:
            self.file.write_text(json.dumps(self.known, indent=1) + "\n", "utf-8")


def chosen(setting: Setting, asked: argparse.Namespace, count: int | None) -> dict[str, Injection]:
    """The first faults of the runs of a target, by what their results are kept under."""
    chance = random.Random(f"{asked.seed} {setting.target}")
    faults = setting.matrix()
    if count is not None and asked.second is None:
        faults = chance.sample(faults, min(count, len(faults)))
    elif count is not None:
        faults = chance.choices(faults, k=count)
    kind = f"{asked.second or ''}{asked.faults if asked.faults != 2 else ''}"
    return {f"{setting.target} {kind} {asked.seed} {n} {f}": f for n, f in enumerate(faults)}


@dataclass(frozen=True)
class Sample:
    """A run of a setting, with a first fault and perhaps others, `many` in all.

    What it draws depends on its key only.
    """

    setting: Setting
    where: Second | None
    many: int
    seed: int
    key: str
    fault: Injection


def ran(sample: Sample, _interrupted: Interrupted) -> tuple[str, str]:
    """How the run ends, and what is wrong with it."""
    gc.set_threshold(100_000)
    chance = random.Random(sample.key)  # so that a campaign that goes on draws the same
    faults = [sample.fault]
    for _ in range(sample.many - 1 if sample.where else 0):
        assert sample.where is not None
        faults += second(sample.setting, faults, sample.where, chance, sample.seed)
    return tried(sample.setting, faults, sample.seed)


def lost(_sample: Sample, why: str) -> tuple[str, str]:
    """What is told of a run that was not carried out."""
    return "lost", why


def row(setting: Setting, asked: argparse.Namespace, count: int | None, tally: Tally) -> int:
    """Print the row of the table for a target; how many of its runs ended wrong."""
    left, used = setting.uncovered()
    if left:
        print(f"  {setting.target}: no exception is about {', '.join(left)}", flush=True)
    began, faults = time.perf_counter(), chosen(setting, asked, count)
    fresh = [each for each in faults.items() if each[0] not in tally.known]
    units = [
        WorkUnit(key, key, Sample(setting, asked.second, asked.faults, asked.seed, key, fault))
        for key, fault in fresh
    ]
    for unit, result in carried_out(WorkKind("faults", ran, lost), units, asked.crew, never):
        if result[0] == "lost":
            raise SystemExit(result[1])
        tally.note(unit.name, result)
    results = [tally.known[key] for key in faults]
    wrong = [f"  {key}: {tally.known[key][1]}\n" for key in faults if tally.known[key][1]]
    sys.stdout.writelines(wrong)
    said = {
        "target": setting.target,
        "cases": len(setting.matrix()),
        "operators without an exception": len(left),
    }
    seconds = round(time.perf_counter() - began, 1)
    counted = Counter(outcome for outcome, _ in results)
    print(json.dumps({**said, "run": len(faults), "seconds": seconds, **counted}), flush=True)
    return len(used) + len(wrong)


def main() -> int:
    """Run the matrix and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("targets", nargs="*", default=TARGETS)
    parser.add_argument("--samples", type=int)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--second", type=Second, choices=list(Second))
    parser.add_argument("--faults", type=int, default=2)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--cluster", default="")
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    asked.crew = crew_of(asked.jobs, asked.cluster)
    tally, many = Tally.of(asked.json), len(asked.targets)
    share = None if asked.samples is None else -(-asked.samples // many)
    wrong = sum(row(Setting.of(target), asked, share, tally) for target in asked.targets)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
