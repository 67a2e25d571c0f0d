"""PDDL files that come with robots' software: which are read, which of their tasks have a plan, and
what is said of the others.

    python benchmarks/robot_pddl.py FOLDER... [--expansions 20000]

A folder is a checkout, for example of `PlanSys2/ros2_planning_system` or `KCL-Planning/ROSPlan`.
Each domain is read with a problem that says nothing, and with each problem beside it that names it.
Each plan goes through our checker.
"""

import argparse
import re
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from cellwright.engine.formats.interop.pddl import read_pddl_task
from cellwright.engine.formats.interop.pddl.durative import has_times, read_temporal
from cellwright.engine.model.temporal import PlannedInTime
from cellwright.engine.pipelines.planning.temporal_plans import TimeEffort, plan_with_times
from cellwright.kb.diagnostics import InvalidInput

DEFINED = re.compile(r"\(\s*define\s*\(\s*(domain|problem)\s+([^\s()]+)", re.IGNORECASE)
OF_DOMAIN = re.compile(r"\(\s*:domain\s+([^\s()]+)", re.IGNORECASE)
NOTHING = "(define (problem nothing) (:domain {name}) (:objects) (:init) (:goal (and)))\n"


def definitions(folder: Path) -> Iterator[tuple[str, str, Path]]:
    """For each PDDL file what it is, and the domain that it defines or names."""
    for path in sorted(folder.rglob("*.pddl")):
        if not path.is_file():
            continue
        text = re.sub(r";.*", "", path.read_text("utf-8", errors="replace"))
        if definition := DEFINED.search(text):
            kind = definition[1].lower()
            named = OF_DOMAIN.search(text) if kind == "problem" else None
            yield kind, (named[1] if named else definition[2]).lower(), path


def verdict(domain: Path, problem: Path, expansions: int) -> str:
    """What becomes of a task: refused, read (without times), planned, or without a plan."""
    try:
        if not has_times(domain, problem):
            read_pddl_task(domain, problem)
            return "read (no times)"
        task = read_temporal(domain, problem)
        outcome = plan_with_times(task.problem, TimeEffort(expansions=expansions))
    except InvalidInput as error:
        first = error.diagnostics[0]
        return f"refused: {first.code} {first.message}"
    if isinstance(outcome, PlannedInTime):
        steps = len(outcome.plan.steps)
        return f"planned: {steps} steps, makespan {float(outcome.plan.makespan):g}, bound {float(outcome.bound):g}"
    return f"no plan: {outcome.reason}"


def main() -> int:
    """Read, plan, count."""
    parser = argparse.ArgumentParser(description="read and plan PDDL files of robots' software")
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--expansions", type=int, default=20_000)
    arguments = parser.parse_args()
    counts: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as place:
        empty = Path(place) / "nothing.pddl"
        for folder in arguments.folders:
            files = list(definitions(folder))
            for domain, name in [(path, name) for kind, name, path in files if kind == "domain"]:
                empty.write_text(NOTHING.format(name=name), "utf-8")
                beside = [
                    p for k, n, p in files if (k, n, p.parent) == ("problem", name, domain.parent)
                ]
                for problem in (empty, *beside):
                    said = verdict(domain, problem, arguments.expansions)
                    kind = "domains" if problem is empty else "tasks"
                    counts[f"{kind}: {said.partition(':')[0]}"] += 1
                    if problem is not empty or said.startswith("refused"):
                        print(f"{domain.relative_to(folder)} {problem.name}: {said}")
    for kind, count in sorted(counts.items()):
        print(f"{count:4} {kind}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
