"""What it costs to check a plan, beside what it costs to make it: the bundled problems and the
competition tasks.

    python benchmarks/checking.py [--data DIR] [--levels 1-4] [--seconds 60] [--runs 3]
        [--only TEXT] [--json FILE]

`--data` (else $CELLWRIGHT_DATA) has the folders `pddl`, `pddl-numeric` and `pddl-axioms`, as in
`benchmarks/planning.py`. Each task is planned by `cellwright plan` in a process of its own, once
for each of the runs; medians are told. Both times are processor times: that of all calls of the
checker, and that of everything else in the process, its start included. The bar for each task: its
checks take 50 ms at most, or a tenth of all else. Exits with 1 if a task misses it.
"""

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

LEAST_S, SHARE = 0.05, 0.1
DOMAINS = Path(__file__).resolve().parent.parent / "domains"


@dataclass(frozen=True)
class Cost:
    """Processor seconds of checking and of all else."""

    task: str
    check: float
    rest: float

    @property
    def met(self) -> bool:
        """Whether the bar is met."""
        return self.check <= max(LEAST_S, SHARE * self.rest)


def works(data: Path, levels: tuple[int, int]) -> Iterator[tuple[str, list[str]]]:
    """The name of each task and what `plan` is told of it."""
    from benchmarks.planning import numeric_tasks, tasks  # not in the processes that are measured

    for path in sorted(DOMAINS.glob("*/problems/*.yaml")):
        yield f"{path.parent.parent.name}/{path.stem}", [str(path)]
    for task in (*tasks(data, levels), *numeric_tasks(data)):
        yield task.name, ["--pddl", str(task.domain), str(task.problem)]
    for path in sorted(data.glob("pddl-axioms/*/p*.pddl")):
        yield (
            f"{path.parent.name}/{path.stem}",
            ["--pddl", str(path.with_name("domain.pddl")), str(path)],
        )


def measured(words: Sequence[str], seconds: float) -> tuple[float, float] | None:
    """Processor seconds of the checks and of all else in one run; None if it has no plan in
    time.
    """
    limits = ["--expansions", str(10**9), "--time-limit", str(seconds)]
    with tempfile.TemporaryDirectory() as folder:
        kept = Path(folder, "check")
        before = _of_children()
        line = [sys.executable, __file__, "--of", str(kept), "plan", *words, *limits]
        ended = subprocess.run(line, capture_output=True, timeout=2 * seconds + 60, check=False)
        if ended.returncode != 0 or not kept.exists():
            return None
        check = float(kept.read_text())
        return check, _of_children() - before - check


def _of_children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def report(kept: Path, words: list[str]) -> None:
    """Run a command in this process, and write what its checks took, after each: a command ends
    the process by itself.
    """
    from cellwright.engine.faces.cli import main as command
    from cellwright.engine.pipelines.planning.plan_gate import PlanGate
    from cellwright.kb.model.plan_model import Plan

    taken = 0.0
    plain = PlanGate.findings

    def findings(gate: PlanGate, problem: object, plan: Plan, *rest: object) -> object:
        nonlocal taken
        started = time.process_time()
        try:
            return plain(gate, problem, plan, *rest)  # type: ignore[arg-type]
        finally:
            taken += time.process_time() - started
            kept.write_text(str(taken))

    PlanGate.findings = findings  # type: ignore[assignment,method-assign]
    sys.argv = ["cellwright", *words]
    command()


def measure(name: str, words: Sequence[str], seconds: float, runs: int) -> Cost | None:
    """The medians of some runs of one task; None if it has no plan in time."""
    found = [each for _ in range(runs) if (each := measured(words, seconds))]
    if len(found) < runs:
        return None
    check, rest = (statistics.median(each) for each in zip(*found, strict=True))
    return Cost(name, check, rest)


def main() -> int:
    """Measure and print."""
    if sys.argv[1:2] == ["--of"]:
        report(Path(sys.argv[2]), sys.argv[3:])
        return 0
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--data", type=Path, default=Path(os.environ.get("CELLWRIGHT_DATA", "../shared/data"))
    )
    parser.add_argument("--levels", default="1-4")
    parser.add_argument("--seconds", type=float, default=60)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument(
        "--only", default="", help="tasks whose name has one of these texts in it, with commas"
    )
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    first, _, last = asked.levels.partition("-")
    found: list[Cost] = []
    for name, words in works(asked.data, (int(first), int(last or first))):
        if not any(each in name for each in asked.only.split(",")):
            continue
        cost = measure(name, words, asked.seconds, asked.runs)
        if cost is None:
            print(f"{name}: no plan", flush=True)
            continue
        found.append(cost)
        told = "" if cost.met else "  MISSED"
        print(f"{name}: check {cost.check:.3f} s, all else {cost.rest:.2f} s{told}", flush=True)
    missed = sum(not each.met for each in found)
    print(
        f"{len(found)} tasks, {missed} miss the bar, the longest check "
        f"{max(e.check for e in found):.3f} s"
    )
    if asked.json:
        asked.json.write_text(
            json.dumps([{**asdict(each), "met": each.met} for each in found], indent=1) + "\n",
            "utf-8",
        )
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main())
