"""Twenty tasks with times of the planning competitions, one process each: which are solved, when
the first plan comes, how long the plans last, what is proved, and the memory.

    python benchmarks/temporal.py [--data DIR] [--seconds 30] [--memory 4] [--anytime]
        [--only TEXT] [--peers PYTHON] [--json FILE]

Seconds are of the processor, all threads and children together, with the start of Python and the
reading of the files. Each plan goes through our checker with an epsilon of 0.001. The score of a
task is the best makespan known of peers divided by ours, at most 1; a task that no peer solved
counts 1. `--peers` names the Python of an environment with `kairos-planner`: then Kairos plans each
task after us, under the same limits, and the last table says how many tasks either has solved at
each moment. Without `--anytime` our search ends when nothing gets better.
"""

import argparse
import json
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from cellwright.engine.formats.interop.pddl.durative import read_temporal
from cellwright.engine.formats.interop.pddl.durative.plans import read_timed_plan
from cellwright.engine.model.temporal import PlannedInTime
from cellwright.engine.pipelines.planning.temporal_plans import (
    TimeEffort,
    check_timed_plan,
    plan_with_times,
)
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.durative import TimedPlan

MOMENTS = (0.5, 1, 2, 3, 5, 10, 15, 20, 25, 30)  # seconds at which solved tasks are counted
WALL = 30  # a process is ended after so many times its seconds of the processor
# a peer writes its plan and ends, which takes processor time, too
GRACE = 1.0
ROW = re.compile(r"\| *([\w-]+/\w+) *\|(.*)\|")


@dataclass(frozen=True)
class Result:
    """What one planner has found: the makespans of its valid plans with the seconds at which they
    came, what is proved, and the memory it took.
    """

    task: str
    plans: tuple[tuple[float, float], ...] = ()
    bound: float = 0.0
    proved: bool = False
    seconds: float = 0.0
    memory_mb: float = 0.0
    said: str = ""

    @property
    def makespan(self) -> float | None:
        """The makespan of the last plan."""
        return self.plans[-1][1] if self.plans else None


def best_known(readme: Path) -> dict[str, float]:
    """The best makespans of peers, from the table in the data's README."""
    best: dict[str, float] = {}
    for line in readme.read_text("utf-8").splitlines():
        if match := ROW.match(line):
            last = match[2].split("|")[-1].strip()
            if re.fullmatch(r"[\d.]+", last):
                best[match[1]] = float(last)
    return best


def used_s() -> float:
    """Seconds of the processor that this process and its children have taken."""
    return sum(
        usage.ru_utime + usage.ru_stime
        for usage in map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    )


def work(folder: Path, seconds: float, anytime: bool) -> None:
    """Plan one task in this process, and print each better plan as a line of JSON."""
    late = False

    def over() -> bool:
        nonlocal late
        late = late or used_s() >= seconds
        return late

    def tell(**data: Any) -> None:
        data["seconds"] = used_s()
        data["memory"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        print(json.dumps(data), flush=True)

    def improved(plan: TimedPlan) -> None:
        tell(makespan=float(plan.makespan))

    task = read_temporal(folder / "domain.pddl", folder / "problem.pddl")
    effort = TimeEffort(over, 10**9, anytime, improved=improved)
    outcome = plan_with_times(task.problem, effort)
    if isinstance(outcome, PlannedInTime):
        wrong = check_timed_plan(task.problem, outcome.plan, "plan")
        counts = ", ".join(f"{name} {count}" for name, count in outcome.counts.items())
        tell(
            bound=float(outcome.bound),
            proved=outcome.optimal,
            said=str(wrong[0]) if wrong else counts,
            last=float(outcome.plan.makespan),
        )
    else:
        tell(said=outcome.reason)


def limit_memory(gigabytes: float) -> None:
    """Bound the address space of this process and its children."""
    most = int(gigabytes * 2**30)
    resource.setrlimit(resource.RLIMIT_AS, (most, most))


def of_ours(name: str, folder: Path, arguments: argparse.Namespace) -> Result:
    """What our planner finds, in a process of its own."""
    line = [sys.executable, __file__, "--work", str(folder), "--seconds", str(arguments.seconds)]
    try:
        ended = subprocess.run(
            [*line, *(["--anytime"] if arguments.anytime else [])],
            capture_output=True,
            text=True,
            check=False,
            timeout=WALL * arguments.seconds,
            preexec_fn=lambda: limit_memory(arguments.memory),
            env=os.environ | {"OMP_NUM_THREADS": "1"},
        )
    except subprocess.TimeoutExpired:
        return Result(name, said=f"no end after {WALL * arguments.seconds:.0f} s of the clock")
    rows = [json.loads(row) for row in ended.stdout.splitlines()]
    plans = tuple((row["seconds"], row["makespan"]) for row in rows if "makespan" in row)
    if not rows or ended.returncode:
        lines = ended.stderr.strip().splitlines()
        return Result(name, plans, said=lines[-1] if lines else f"exit {ended.returncode}")
    last = rows[-1]
    return Result(
        name,
        plans,
        last.get("bound", 0.0),
        last.get("proved", False),
        last["seconds"],
        max(row["memory"] for row in rows),
        last["said"],
    )


def of_kairos(name: str, folder: Path, arguments: argparse.Namespace, python: str) -> Result:
    """What Kairos finds under the same limits; each plan gets the time at which it was written."""
    with tempfile.TemporaryDirectory() as place:
        line = [str(Path(python).with_name("kairos")), "solve"]
        line += [str(folder / "domain.pddl"), str(folder / "problem.pddl"), "--threads", "1"]
        line += ["--output", f"{place}/plan", "--timeout", str(WALL * arguments.seconds)]
        process = subprocess.Popen(
            line,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            preexec_fn=lambda: limit_memory(arguments.memory),
        )
        seen: dict[Path, float] = {}
        used = 0.0
        while process.poll() is None:
            used = max(used, tree_s(process.pid))
            for file in sorted(set(Path(place).iterdir()) - set(seen)):
                seen[file] = used
            if used > arguments.seconds + GRACE:
                process.terminate()
                break
            time.sleep(0.02)
        process.communicate()
        for file in sorted(set(Path(place).iterdir()) - set(seen)):
            seen[file] = used
        return Result(name, valid_plans(folder, seen), seconds=used)


def tree_s(pid: int) -> float:
    """Seconds of the processor of a process and of its children that have ended or still run."""
    total, ticks = 0.0, os.sysconf("SC_CLK_TCK")
    waiting = [pid]
    while waiting:
        one = waiting.pop()
        try:
            fields = Path(f"/proc/{one}/stat").read_text().rpartition(")")[2].split()
            waiting += map(int, Path(f"/proc/{one}/task/{one}/children").read_text().split())
        except OSError:
            continue
        total += sum(map(int, fields[11:15])) / ticks
    return total


def valid_plans(folder: Path, seen: dict[Path, float]) -> tuple[tuple[float, float], ...]:
    """The plans that our checker accepts, each with its time, as long as they get better."""
    task = read_temporal(folder / "domain.pddl", folder / "problem.pddl")
    plans: list[tuple[float, float]] = []
    for file, at in sorted(seen.items(), key=lambda pair: pair[1]):
        try:
            plan = read_timed_plan(task, file)
        except InvalidInput:
            continue
        wrong = check_timed_plan(task.problem, plan, str(file))
        if not wrong and (not plans or float(plan.makespan) < plans[-1][1]):
            plans.append((at, float(plan.makespan)))
    return tuple(plans)


def score(result: Result, best: dict[str, float], seconds: float) -> float:
    """The best makespan known divided by that of the best plan within the seconds, at most 1."""
    in_time = [makespan for at, makespan in result.plans if at <= seconds + GRACE]
    if not in_time:
        return 0.0
    return min(1.0, best.get(result.task, in_time[-1]) / in_time[-1])


def table(results: list[Result], best: dict[str, float], seconds: float) -> Table:
    """One row for each task."""
    made = Table(box=None, pad_edge=False)
    for column in ("task", "first", "after s", "makespan", "after s", "bound", "best of peers"):
        made.add_column(column, justify="left" if column == "task" else "right")
    for column in ("score", "MB"):
        made.add_column(column, justify="right")
    for each in results:
        known = f"{best[each.task]:.3f}" if each.task in best else "-"
        if not each.plans:
            made.add_row(each.task, "-", "", "-", "", "", known, "0", f"{each.memory_mb:.0f}")
            continue
        first, last = each.plans[0], each.plans[-1]
        bound = "proved" if each.proved else f"{each.bound:.3f}"
        numbers = [f"{first[1]:.3f}", f"{first[0]:.2f}", f"{last[1]:.3f}", f"{last[0]:.2f}"]
        points = f"{score(each, best, seconds):.3f}"
        made.add_row(each.task, *numbers, bound, known, points, f"{each.memory_mb:.0f}")
    total = sum(score(each, best, seconds) for each in results)
    solved = sum(1 for each in results if each.plans)
    proved = sum(1 for each in results if each.proved)
    made.add_row(
        "sum", f"{solved} of {len(results)}", *[""] * 3, f"{proved} proved", "", f"{total:.3f}"
    )
    return made


def moments(ours: list[Result], theirs: list[Result]) -> Table:
    """How many tasks have a plan at each moment."""
    made = Table(box=None, pad_edge=False)
    made.add_column("solved after")
    for moment in MOMENTS:
        made.add_column(f"{moment:g} s", justify="right")
    for name, results in (("Cellwright", ours), ("Kairos", theirs)):
        counts = [sum(1 for r in results if r.plans and r.plans[0][0] <= m) for m in MOMENTS]
        made.add_row(name, *map(str, counts))
    return made


def shown(result: Result) -> str:
    """One line about a result, while the others are still to come."""
    plans = [f"{makespan:.3f} ({at:.2f} s)" for at, makespan in result.plans]
    listed = " ".join([*plans[:1], *(["..."] if len(plans) > 2 else []), *plans[1:][-1:]])
    return f"{result.task}: {listed or '-'}; {result.said}"


def measured(arguments: argparse.Namespace) -> tuple[list[Result], list[Result]]:
    """Both planners on all tasks, one after the other."""
    ours: list[Result] = []
    theirs: list[Result] = []
    for folder in sorted(arguments.data.glob("*/*/")):
        name = f"{folder.parent.name}/{folder.name}"
        if not (folder / "domain.pddl").exists() or arguments.only not in name:
            continue
        ours.append(of_ours(name, folder, arguments))
        print(shown(ours[-1]), file=sys.stderr, flush=True)
        if arguments.peers:
            theirs.append(of_kairos(name, folder, arguments, arguments.peers))
            print(f"  Kairos {shown(theirs[-1])}", file=sys.stderr, flush=True)
    return ours, theirs


def main() -> int:
    """Measure, print, keep."""
    parser = argparse.ArgumentParser(description="plan tasks with times")
    data = Path(os.environ.get("CELLWRIGHT_DATA", "../shared/data"))
    parser.add_argument("--data", type=Path, default=data / "pddl-temporal")
    parser.add_argument("--seconds", type=float, default=30)
    parser.add_argument("--memory", type=float, default=4, help="gigabytes")
    parser.add_argument("--anytime", action="store_true", help="use all of the seconds")
    parser.add_argument("--only", default="", help="tasks whose name has this in it")
    parser.add_argument("--peers", default="", help="the Python of an environment with Kairos")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--work", type=Path, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.work:
        work(arguments.work, arguments.seconds, arguments.anytime)
        return 0
    ours, theirs = measured(arguments)
    if not ours:
        print(f"no tasks under {arguments.data}: give --data")
        return 2
    best = best_known(arguments.data / "README.md")
    console = Console(width=None if sys.stdout.isatty() else 160)
    console.print(table(ours, best, arguments.seconds))
    if theirs:
        console.print("\nKairos", table(theirs, best, arguments.seconds))
        console.print("", moments(ours, theirs))
    if arguments.json:
        kept = {"ours": [asdict(r) for r in ours], "kairos": [asdict(r) for r in theirs]}
        arguments.json.write_text(json.dumps(kept, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
