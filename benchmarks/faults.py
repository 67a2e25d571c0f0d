"""The fault matrix: every cause of a fault base, injected at every step where it can show; how each run ends.

    python benchmarks/faults.py [--samples N] [--seed N] [--pairs] [--json FILE] [TARGET ...]

Without `--samples` the whole matrix. `--pairs` injects a second fault behind the first, so that two are in one run, in a recovery
or in the steps that prepare a test. The plan is made once; each run is in a simulated cell of its own, on the virtual clock. A run
passes if it ends with the goals reached, also in the cell as it really is, or with a reason for each goal that is not, and if no
command is carried out twice. Exits with 1 if one does not pass, or if the plan uses an operator that no exception is about.
"""

import argparse
import json
import random
import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from engine.model.execution import Finish, Record, RecordKind
from engine.pipelines.execution import Execution, Timed
from engine.pipelines.execution.compiling import situation_of
from engine.pipelines.execution.planned import Ready, first
from engine.pipelines.execution.recorder import Recorder
from engine.pipelines.planning import problem_of
from engine.pipelines.simulation import World
from engine.pipelines.simulator import HiddenCell, Injection, Simulator, possible
from engine.pipelines.simulator.driver import Settings, fault_base
from kb.model.faults import FaultModel
from kb.model.problem import Problem

TARGETS = ("themse/one", "bulkhead/twelve_points")


class Kept:
    """A journal in memory."""

    def __init__(self) -> None:
        self.records: list[Record] = []

    def append(self, records: Sequence[Record]) -> None:
        """Append records."""
        self.records += records


@dataclass(frozen=True)
class Setting:
    """A problem, its plan and its fault base."""

    target: str
    problem: Problem
    ready: Ready
    base: FaultModel

    @classmethod
    def of(cls, target: str) -> "Setting":
        """The setting of a target."""
        problem = problem_of(target)
        ready, base = first(problem), fault_base(problem)
        assert isinstance(ready, Ready)
        assert base is not None
        return cls(target, problem, ready, base)

    def matrix(self) -> list[Injection]:
        """Every cause at every step where it can show, in each way in which it can."""
        return [
            Injection(str(step), cause, 1, exception)
            for step in dict.fromkeys(each.operator for each in self.ready.plan.steps)
            for cause in self.base.causes
            for exception in possible(self.base, step, cause)
        ]

    def uncovered(self) -> tuple[list[str], list[str]]:
        """The operators of the domain that no exception is about; of them, those that the plan uses."""
        known = {each.operator.name for each in self.base.exceptions.values() if each.operator is not None}
        left = [each.name for each in self.problem.domain.operators if each.name not in known]
        used = {each.operator.name for each in self.ready.plan.steps}
        return left, [each for each in left if each in used]

    def run(self, faults: Sequence[Injection], seed: int) -> tuple[Finish, Kept, HiddenCell]:
        """One run with faults."""
        cell = HiddenCell(self.problem, self.base, tuple(faults), seed)
        driver, kept = Simulator(cell, Settings(seed)), Kept()
        run = Execution("x", self.problem, driver, Recorder(kept, driver.now_ms), Timed(), self.base)
        return run.start(self.ready, World.of(self.problem, situation_of(self.problem).state)), kept, cell


def fault_of(setting: Setting, ending: Finish, kept: Kept, cell: HiddenCell) -> str:
    """What is wrong with a run; nothing if it passes."""
    numbers = [each.content["command"] for each in kept.records if each.kind is RecordKind.COMMAND]
    if len(set(numbers)) < len(numbers):
        return "a command was sent twice"
    if ending.outcome == "reached":
        reached = all(cell.world.reached[c.name] == len(c.stages) for c in setting.problem.chains)
        return "" if reached else "it believes that all goals are reached, and they are not"
    told = {goal for goal, why in ending.given_up if why}
    return "" if set(ending.open_goals) <= told or ending.why else "goals are open without a reason"


def main() -> int:
    """Run the matrix and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("targets", nargs="*", default=TARGETS)
    parser.add_argument("--samples", type=int)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--pairs", action="store_true")
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    chance, rows, wrong = random.Random(asked.seed), [], 0
    for target in asked.targets:
        setting = Setting.of(target)
        faults = setting.matrix()
        left, used = setting.uncovered()
        wrong += len(used)
        if left:
            print(f"  {target}: no exception is about {', '.join(left)}", flush=True)
        chosen = faults if asked.samples is None else chance.sample(faults, min(asked.samples, len(faults)))
        counted: Counter[str] = Counter()
        began = time.perf_counter()
        for fault in chosen:
            both = (
                [fault, Injection(chance.choice(faults).action, chance.choice(faults).cause, 1)]
                if asked.pairs
                else [fault]
            )
            try:
                ending, kept, cell = setting.run(both, asked.seed)
                found, outcome = fault_of(setting, ending, kept, cell), ending.outcome
            except Exception as error:
                found, outcome = f"{type(error).__name__}: {str(error)[:160]}", "crashed"
            counted[outcome] += 1
            if found:
                wrong += 1
                print(f"  {target}: {both}: {found}", flush=True)
        seconds = time.perf_counter() - began
        rows.append(
            {
                "target": target,
                "cases": len(faults),
                "operators without an exception": len(left),
                "run": len(chosen),
                "seconds": round(seconds, 1),
                **counted,
            }
        )
        print(json.dumps(rows[-1]), flush=True)
    if asked.json:
        asked.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
