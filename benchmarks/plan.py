"""Grounding, search, check and whole-command times of every bundled problem, and the bars they have
to meet.

    python benchmarks/plan.py [--runs N] [--json FILE]

Times are minima and medians over N runs in one process (whole commands: N fresh processes). Exits
with 1 when a bar is missed: one point under 0.2 s of search, twelve points under 2 s, one probe
under 0.2 s, four under 2 s, `cellwright --help` under 0.3 s, and neither NumPy nor ortools loaded
by a small problem.
"""

import argparse
import json
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.kb.loader import bundled_domains

SEARCH_BARS = {
    "bulkhead/one_point": 0.2,
    "bulkhead/twelve_points": 2.0,
    "themse/one": 0.2,
    "themse/four": 2.0,
}
HELP_BAR = 0.3
COMMAND = [sys.executable, "-m", "cellwright.engine.faces.cli"]


def targets() -> list[str]:
    """Every bundled problem by name."""
    return [
        f"{name}/{file.stem}"
        for name, path in bundled_domains().items()
        for file in sorted(path.glob("problems/*.yaml"))
    ]


def seconds(run: Callable[[], object], runs: int) -> tuple[float, float]:
    """Minimum and median time of a call."""
    times = []
    for _ in range(runs):
        started = time.perf_counter()
        run()
        times.append(time.perf_counter() - started)
    return min(times), statistics.median(times)


def command(*arguments: str) -> Callable[[], object]:
    """A whole command in a fresh process; its exit code does not matter here."""
    return lambda: subprocess.run([*COMMAND, *arguments], capture_output=True, check=False)


def measure(target: str, runs: int) -> dict[str, Any]:
    """One row of the table."""
    problem = checked_plan.problem_of(target)
    outcomes = [checked_plan.plan_problem(problem) for _ in range(runs)]
    phases = {
        phase: min(outcome.statistics.seconds[phase] for outcome in outcomes)
        for phase in ("grounding", "search", "check")
    }
    outcome = outcomes[0]
    plan = outcome.plan if isinstance(outcome, Found) else None
    return {
        "problem": target,
        "steps": len(plan.steps) if plan else None,
        "cost": plan.cost if plan else None,
        **{
            key: outcome.statistics.counts.get(key, 0)
            for key in ("operators", "expanded", "generated")
        },
        **phases,
        "command": seconds(command("plan", target), runs)[1],
    }


def heavy_modules() -> list[str]:
    """Heavy packages that planning a small problem loads."""
    code = (
        "import sys; from cellwright.engine.pipelines.planning import checked_plan; "
        "checked_plan.plan_problem(checked_plan.problem_of('bulkhead/one_point'))"
    )
    code += "; print(*sorted({'numpy', 'ortools'} & set(sys.modules)))"
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()


def missed(rows: list[dict[str, Any]], help_seconds: float, heavy: list[str]) -> list[str]:
    """The bars that were not met."""
    found = [
        f"{row['problem']}: search took {row['search']:.3f} s, allowed are "
        f"{SEARCH_BARS[row['problem']]} s"
        for row in rows
        if row["problem"] in SEARCH_BARS and row["search"] >= SEARCH_BARS[row["problem"]]
    ]
    if help_seconds >= HELP_BAR:
        found.append(f"--help took {help_seconds:.3f} s, allowed are {HELP_BAR} s")
    return found + [f"a small problem loads {name}" for name in heavy]


def table(rows: list[dict[str, Any]]) -> Table:
    """The rows for people."""
    made = Table(box=None, pad_edge=False)
    for key in rows[0]:
        made.add_column(
            f"{key} (s)" if key in ("grounding", "search", "check", "command") else key,
            justify="right",
        )
    for row in rows:
        cells = (
            "-" if value is None else f"{value:.3f}" if isinstance(value, float) else str(value)
            for value in row.values()
        )
        made.add_row(*cells)
    return made


def main() -> int:
    """Measure, print, keep."""
    parser = argparse.ArgumentParser(description="time every bundled problem")
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    rows = [measure(target, arguments.runs) for target in targets()]
    help_seconds = seconds(command("--help"), max(arguments.runs, 5))[1]
    heavy = heavy_modules()
    found = missed(rows, help_seconds, heavy)
    console = Console(width=None if sys.stdout.isatty() else 140)
    console.print(table(rows))
    console.print(f"--help {help_seconds:.3f} s")
    for line in found:
        console.print(f"missed: {line}")
    if arguments.json:
        arguments.json.write_text(
            json.dumps({"rows": rows, "help": help_seconds, "missed": found}, indent=1) + "\n"
        )
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
