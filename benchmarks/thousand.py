"""A thousand points, whole: from a table or a QIF document to an ordered, timed and checked plan,
by the commands of the README.

    python benchmarks/thousand.py [--points N ...] [--qif FILE ...] [--json FILE] [--keep FOLDER]

Every command is a process of its own, with nothing kept from the one before: `import`, `plan`,
`validate` of the plan and `schedule` of it. So four starts of the program are in a sum, with
reading the domain and the problem. With PYTHONDONTWRITEBYTECODE each of them compiles every module,
too. Times are of the processor, with all children of a process, and of the clock; memory is the
peak of the largest process. `one point` plans a single measurement of the cell from scratch in a
process of its own: it grounds, searches and checks, with the static facts evaluated anew. Reading
the files of problem and cell, and loading modules, are not in it; `with reading` is the processor
time of the whole command `plan --goals`. Tables of random points on the bulkhead, with fixed seeds.
Exits with 1 when a bar is missed: 20 s and 700 MB for a thousand points, 5 minutes and 3 GB for ten
thousand, 0.3 s for one point, growth of at most three times the number of points, and travel of the
plan as in its sequence.
"""

import argparse
import gc
import itertools
import json
import os
import random
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from cellwright.engine.formats.interop.measurement_edits import measurement_goal
from cellwright.engine.pipelines.planning.checked_plan import plan_and_ground
from cellwright.kb.loader import find_target, load, with_goals
from cellwright.kb.loader.problem_amounts import cell_points
from cellwright.kb.model.planning_problem import Problem

# points: seconds of the processor, megabytes
BARS = {1_000: (20.0, 700.0), 10_000: (300.0, 3_000.0)}
ONE_S = 0.3
GROWTH = 3.0  # times the number of points
BIG = 100  # points from which on growth is judged
console = Console()


@dataclass
class Stage:
    """One command: seconds of the processor and of the clock, the peak of its memory in
    megabytes, and its answer.
    """

    cpu_s: float
    wall_s: float
    peak_mb: float
    code: int
    said: Any = field(default=None, repr=False)


def stage(*arguments: str, output: Path | None = None) -> Stage:
    """Run a command of the command line in a process of its own; what it prints goes to
    `output`, if given.
    """
    started, child = time.perf_counter(), os.fork()
    if not child:
        with (output or Path(os.devnull)).open("w") as file:
            os.dup2(file.fileno(), 1)
        os.execv(sys.executable, [sys.executable, "-m", "cellwright.engine.faces.cli", *arguments])
    _, status, used = os.wait4(child, 0)
    took = time.perf_counter() - started
    code = os.waitstatus_to_exitcode(status)
    return Stage(used.ru_utime + used.ru_stime, took, used.ru_maxrss / 1024, code)


def table_of(count: int, folder: Path) -> Path:
    """A table of random points on the bulkhead; seven of ten are thicknesses."""
    chance = random.Random(count)
    lines = ["name,x,y,z,nx,ny,nz,kind,tolerance"]
    for number in range(1, count + 1):
        x, y = chance.uniform(-450, 450), chance.uniform(-950, 950)
        kind = "thickness" if chance.random() < 0.7 else "profile"
        lines.append(f"m{number},{x:.3f},{y:.3f},0,0,0,-1,{kind},0.2")
    path = folder / f"points_{count}.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


def chain(kind: str, source: Path, folder: Path) -> dict[str, Any]:
    """All stages for one file, and what they came to."""
    problem, plan = folder / f"{source.stem}.yaml", folder / f"{source.stem}_plan.json"
    stages = {
        "import": stage("import", kind, str(source), "--output", str(problem), "--unit", "mm"),
        "plan": stage("plan", str(problem), "--format", "json", "--stats", output=plan),
        "validate": stage("validate", str(plan)),
        "schedule": stage(
            "schedule", str(plan), "--format", "json", output=folder / "schedule.json"
        ),
    }
    answer = json.loads(plan.read_text())["data"]
    loaded = load(find_target(str(problem))).problem
    assert loaded is not None
    return {
        "source": source.name,
        "points": len(loaded.objects),
        "steps": len(answer["plan"]["steps"]) if "plan" in answer else 0,
        "stages": {name: each.__dict__ for name, each in stages.items()},
        "inside": answer.get("statistics", {}),
        "travel_um": travel(loaded, answer),
        "one": one_point(loaded, problem),
    }


def travel(problem: Problem, answer: Mapping[str, Any]) -> tuple[int, int]:
    """How far the arm goes from measurement to measurement by the same tool: in the sequence,
    and in the plan. Micrometres.
    """
    where = {
        str(fact.arguments[0]): [int(str(each)) for each in fact.arguments[1:]]
        for fact in problem.statics
        if fact.name == problem.domain.conventions.position
    }

    def way(one: str, other: str) -> float:
        return sum((a - b) ** 2 for a, b in zip(where[one], where[other], strict=True)) ** 0.5

    sequence = answer.get("sequence", {"visits": [], "tools": []})
    visits = list(zip(sequence["visits"], sequence["tools"], strict=True))
    legs = [(a, b) for (a, tool), (b, same) in itertools.pairwise(visits) if tool == same]
    moves = [step["operator"] for step in answer.get("plan", {"steps": []})["steps"]]
    ends = [each.split("meas(") for each in moves if each.startswith("move(")]
    own = [(each[1].split(")")[0], each[2].split(")")[0]) for each in ends if len(each) == 3]
    return round(sum(way(*leg) for leg in legs)), round(sum(way(*leg) for leg in own))


def one_point(problem: Problem, path: Path) -> dict[str, float]:
    """Seconds of the processor for a plan of one measurement, alone and as a command, and the
    operators grounded for it.
    """
    name = sorted(problem.objects)[len(problem.objects) // 2]
    asked = measurement_goal(name, problem.domain.conventions)
    whole = stage("plan", str(path), "--goals", asked, "--format", "json")
    receiving, sending = os.pipe()
    child = os.fork()
    if not child:
        os.write(sending, json.dumps(_planned_alone(problem, asked)).encode())
        os._exit(0)
    os.close(sending)
    with os.fdopen(receiving) as said:
        found: dict[str, float] = json.load(said)
    os.waitpid(child, 0)
    return {**found, "whole_s": whole.cpu_s, "code": whole.code}


def _planned_alone(problem: Problem, asked: str) -> dict[str, float]:
    """Modules and the cell are loaded first, by a plan for a small problem of the same domain."""
    small = load(find_target(f"{problem.domain.name}/one_point")).problem
    assert small is not None
    plan_and_ground(small)
    cell_points(problem.domain)("home")
    single = with_goals(problem.domain, asked, problem)
    gc.set_threshold(
        100_000
    )  # as the commands do: else what this benchmark itself keeps is looked through again and again
    started = time.process_time()
    _, task = plan_and_ground(single)
    return {"cpu_s": time.process_time() - started, "operators": len(task.operators)}


def missed(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """The bars that are missed."""
    found = []
    for row in rows:
        stages = row["stages"].values()
        total, peak = sum(each["cpu_s"] for each in stages), max(each["peak_mb"] for each in stages)
        bound = next((bar for count, bar in sorted(BARS.items()) if row["points"] <= count), None)
        if bound and (total > bound[0] or peak > bound[1]):
            found.append(
                f"{row['source']}: {total:.1f} s and {peak:.0f} MB, wanted {bound[0]} s and "
                f"{bound[1]} MB"
            )
        if row["one"]["cpu_s"] > ONE_S:
            found.append(f"{row['source']}: one point takes {row['one']['cpu_s']:.2f} s")
        if abs(row["travel_um"][0] - row["travel_um"][1]) > row["points"]:
            found.append(
                f"{row['source']}: the plan travels {row['travel_um'][1]} µm, not "
                f"{row['travel_um'][0]}"
            )
        found += [
            f"{row['source']}: {name} failed"
            for name, each in row["stages"].items()
            if each["code"]
        ]
    for one, other in itertools.pairwise(rows):
        times = [sum(each["cpu_s"] for each in row["stages"].values()) for row in (one, other)]
        if one["points"] >= BIG and times[1] / times[0] > GROWTH * other["points"] / one["points"]:
            found.append(
                f"from {one['points']} to {other['points']} points time grows "
                f"{times[1] / times[0]:.1f} times"
            )
    return found


def shown(rows: Sequence[Mapping[str, Any]]) -> Table:
    """A line for each file."""
    table = Table(
        "points",
        "steps",
        "import",
        "plan",
        "validate",
        "schedule",
        "all (s)",
        "MB",
        "one point (s)",
        "with reading",
        "operators",
    )
    for row in rows:
        times = [each["cpu_s"] for each in row["stages"].values()]
        peak = max(each["peak_mb"] for each in row["stages"].values())
        cells = [*(f"{each:.1f}" for each in times), f"{sum(times):.1f}", f"{peak:.0f}"]
        one = row["one"]
        table.add_row(
            str(row["points"]),
            str(row["steps"]),
            *cells,
            f"{one['cpu_s']:.2f}",
            f"{one['whole_s']:.2f}",
            str(one["operators"]),
        )
    return table


def main() -> int:
    """Run what was asked for, and judge it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--points", type=int, nargs="*", default=[10, 100, 1_000, 10_000])
    parser.add_argument("--qif", type=Path, nargs="*", default=[])
    parser.add_argument("--json", type=Path)
    parser.add_argument("--keep", type=Path, help="the folder for all files")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = asked.keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        rows = [chain("csv", table_of(count, folder), folder) for count in asked.points]
        judged = missed(rows)
        rows += [chain("qif", path, folder) for path in asked.qif]
    console.print(shown(rows))
    for row in rows:
        inside = ", ".join(
            f"{name} {spent:.1f} s" for name, spent in row["inside"].get("seconds", {}).items()
        )
        console.print(f"{row['points']} points, inside plan: {inside}")
    if asked.json:
        asked.json.write_text(json.dumps(rows, indent=1))
    console.print("\n".join(judged) or "every bar is kept")
    return 1 if judged else 0


if __name__ == "__main__":
    sys.exit(main())
