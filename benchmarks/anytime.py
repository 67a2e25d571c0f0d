"""Cheaper plans as long as there is time: `plan --anytime` and Fast Downward's `lama`, both ended
after the same time of the clock.

    python benchmarks/anytime.py [--peers PYTHON] [--data DIR] [--levels 1-4] [--seconds 30]
        [--only TEXT] [--json FILE]

Tasks and peers are those of `planning.py`. Every plan goes through our checker. A task that only
one of the two solves counts for neither sum of costs.
"""

import argparse
import json
import os
import sys
import tempfile
from dataclasses import asdict, dataclass
from fractions import Fraction
from pathlib import Path

from planning import Instance, folder_of, ours, output, tasks
from rich.console import Console
from rich.table import Table

from cellwright.engine.formats.interop.pddl import read_pddl_task
from cellwright.engine.formats.interop.pddl.competition_plans import read_plan
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.kb.diagnostics import InvalidInput

END = 5  # seconds that a command may take beyond its time


@dataclass(frozen=True)
class Pair:
    """The costs of both plans of a task; None without a valid plan."""

    task: str
    ours: float | None
    lama: float | None


def cost(folder: Path, plan: Path) -> float | None:
    """What a plan costs that our checker accepts, in the task's own unit."""
    task = read_pddl_task(folder / "domain.pddl", folder / "problem.pddl")
    try:
        made = read_plan(task, plan)
    except (InvalidInput, OSError):
        return None
    return (
        None
        if checked_plan.check_plan(task.problem, made)
        else float(Fraction(made.cost, task.unit_of_cost))
    )


def of_ours(task: Instance, place: Path, seconds: float) -> float | None:
    """The cost of what `plan --anytime` prints."""
    line = [*ours("auto")(task.domain.parent, place, seconds), "--anytime"]
    (place / "plan").write_text(output(line, place, seconds + END))
    return cost(task.domain.parent, place / "plan")


def of_lama(task: Instance, place: Path, seconds: float, python: str) -> float | None:
    """The least cost of the plans that `lama` has written when its time is over; None if it is
    not there.
    """
    if not python:
        return None
    driver = str(folder_of("up_fast_downward", python) / "downward" / "fast-downward.py")
    files = [str(task.domain), str(task.problem)]
    output(
        [python, driver, "--alias", "lama", "--plan-file", str(place / "plan"), *files],
        place,
        seconds,
    )
    costs = [cost(task.domain.parent, each) for each in place.glob("plan*")]
    return min((each for each in costs if each is not None), default=None)


def pair(task: Instance, seconds: float, python: str) -> Pair:
    """Both planners on one task, one after the other."""
    with tempfile.TemporaryDirectory() as place, tempfile.TemporaryDirectory() as other:
        return Pair(
            task.name,
            of_ours(task, Path(place), seconds),
            of_lama(task, Path(other), seconds, python),
        )


def table(pairs: list[Pair]) -> Table:
    """The costs of every task, and their sums where both have a plan."""
    made = Table(box=None, pad_edge=False)
    for column in ("task", "anytime", "lama"):
        made.add_column(column, justify="left" if column == "task" else "right")
    for each in pairs:
        made.add_row(
            each.task,
            *(f"{cost:g}" if cost is not None else "-" for cost in (each.ours, each.lama)),
        )
    both = [
        (each.ours, each.lama) for each in pairs if each.ours is not None and each.lama is not None
    ]
    sums = [sum(side) for side in zip(*both, strict=True)] or [0.0, 0.0]
    made.add_row("sum", *(f"{each:g}" for each in sums))
    if sums[1]:
        made.add_row("of lama's", f"{sums[0] / sums[1]:.3f}", "1")
    return made


def main() -> int:
    """Measure, print, keep."""
    parser = argparse.ArgumentParser(description="improve plans beside lama")
    parser.add_argument(
        "--data", type=Path, default=Path(os.environ.get("CELLWRIGHT_DATA", "../shared/data"))
    )
    parser.add_argument("--levels", default="1-4")
    parser.add_argument("--seconds", type=float, default=30)
    parser.add_argument(
        "--peers", default="", help="the Python of an environment with Fast Downward"
    )
    parser.add_argument("--only", default="", help="tasks whose name has this in it")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    first, _, last = arguments.levels.partition("-")
    wanted = [
        each
        for each in tasks(arguments.data, (int(first), int(last or first)))
        if arguments.only in each.name
    ]
    if not wanted:
        print(f"no tasks under {arguments.data}: give --data")
        return 2
    pairs: list[Pair] = []
    for task in wanted:
        pairs.append(
            pair(task, arguments.seconds, arguments.peers and str(Path(arguments.peers).absolute()))
        )
        print(pairs[-1], file=sys.stderr, flush=True)
    Console(width=None if sys.stdout.isatty() else 160).print(table(pairs))
    if arguments.json:
        arguments.json.write_text(json.dumps([asdict(each) for each in pairs], indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
