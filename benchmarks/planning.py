"""Competition tasks: our strategies and, in the same run, other planners; solved tasks, times and
plan lengths.

    python benchmarks/planning.py [--data DIR] [--levels 1-4] [--seconds 60] [--planners NAMES]
        [--peers PYTHON] [--numeric]

`--data` (else $CELLWRIGHT_DATA) has a folder `pddl/DOMAIN/LEVEL_INSTANCE` with `domain.pddl` and
`problem.pddl`, and for `--numeric` a folder `pddl-numeric/DOMAIN` with a domain and problems.
`--peers` is the Python of an environment with `up-fast-downward`, `pyperplan` and `up-enhsp` (which
needs Java); without it there are no peers. Times are processor times of whole processes with their
children, so other work on the machine changes them little; `--seconds` is a limit of wall time.
Every plan of any planner goes through our checker, and a refused one counts as unsolved.
"""

import argparse
import json
import math
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

from cellwright.engine.formats.interop.pddl import read_pddl_task
from cellwright.engine.formats.interop.pddl.competition_plans import read_plan
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.kb.diagnostics import InvalidInput

OURS = ("auto", "backward", "forward", "landmarks", "asp")
PEERS = ("lama-first", "pyperplan", "enhsp")
# from a task's folder, the file for its plan, a limit (s)
Command = Callable[[Path, Path, float], list[str]]


@dataclass(frozen=True)
class Run:
    """One planner on one task: processor seconds of the whole process, steps of a valid plan or
    None.
    """

    task: str
    planner: str
    seconds: float
    steps: int | None


@dataclass(frozen=True)
class Instance:
    """A task: its two files."""

    name: str
    domain: Path
    problem: Path


def tasks(data: Path, levels: tuple[int, int]) -> list[Instance]:
    """All tasks whose level lies in a range."""
    found = sorted(path.parent for path in data.glob("pddl/*/*/problem.pddl"))
    return [
        Instance(f"{path.parent.name}/{path.name}", path / "domain.pddl", path / "problem.pddl")
        for path in found
        if levels[0] <= int(path.name.split("_")[0]) <= levels[1]
    ]


def numeric_tasks(data: Path) -> list[Instance]:
    """All tasks with numbers."""
    found = sorted(
        data.glob("pddl-numeric/*/pfile*.pddl"),
        key=lambda path: (path.parent, len(path.name), path.name),
    )
    return [
        Instance(f"{path.parent.name}/{path.stem}", path.parent / "domain.pddl", path)
        for path in found
    ]


def ours(strategy: str) -> Command:
    """The command line of one of our strategies; the plan goes to standard output."""

    def line(folder: Path, _plan: Path, seconds: float) -> list[str]:
        files = [str(folder / "domain.pddl"), str(folder / "problem.pddl")]
        limits = ["--expansions", str(10**9), "--time-limit", str(seconds), "--format", "ipc"]
        return [
            sys.executable,
            "-m",
            "cellwright.engine.faces.cli",
            "plan",
            "--pddl",
            *files,
            "--strategy",
            strategy,
            *limits,
        ]

    return line


def folder_of(package: str, python: str) -> Path:
    """Where an environment has a package, which is not imported.

    Raises `LookupError` if it has none.
    """
    code = (
        f"import importlib.util as u; found = u.find_spec('{package}'); print(found.origin if "
        "found else '')"
    )
    found = subprocess.run(
        [python, "-c", code], capture_output=True, text=True, check=True
    ).stdout.strip()
    if not found:
        raise LookupError(f"{package} is not installed")
    return Path(found).parent


def lama_first(python: str) -> Command:
    """Fast Downward's `lama-first`."""
    driver = str(folder_of("up_fast_downward", python) / "downward" / "fast-downward.py")

    def line(folder: Path, plan: Path, _seconds: float) -> list[str]:
        files = [str(folder / "domain.pddl"), str(folder / "problem.pddl")]
        return [python, driver, "--alias", "lama-first", "--plan-file", str(plan), *files]

    return line


def pyperplan(python: str) -> Command:
    """pyperplan, greedy with the FF heuristic."""
    folder_of("pyperplan", python)

    def line(folder: Path, _plan: Path, _seconds: float) -> list[str]:
        files = [str(folder / "domain.pddl"), str(folder / "problem.pddl")]
        return [str(Path(python).with_name("pyperplan")), "-H", "hff", "-s", "gbf", *files]

    return line


def enhsp(python: str) -> Command:
    """ENHSP as `up-enhsp` starts it by default: greedy with additive costs."""
    jar = str(folder_of("up_enhsp", python) / "ENHSP" / "enhsp.jar")

    def line(folder: Path, plan: Path, _seconds: float) -> list[str]:
        files = [
            "-o",
            str(folder / "domain.pddl"),
            "-f",
            str(folder / "problem.pddl"),
            "-sp",
            str(plan),
        ]
        return ["java", "-jar", jar, *files, "-npm", "-h", "hadd", "-s", "gbfs"]

    return line


def run(task: Instance, planner: str, command: Command, seconds: float) -> Run:
    """One planner on a copy of one task."""
    with tempfile.TemporaryDirectory() as place:
        copy = Path(place)
        shutil.copy(task.domain, copy / "domain.pddl")
        shutil.copy(task.problem, copy / "problem.pddl")
        plan = copy / "plan.txt"
        started = _of_children()
        answered = output(command(copy, plan, seconds), copy, seconds)
        taken = _of_children() - started
        if planner == "pyperplan":
            plan = copy / "problem.pddl.soln"
        elif planner in OURS and answered:
            plan.write_text(answered)
        return Run(task.name, planner, taken, _steps(copy, plan))


def _of_children() -> float:
    """The processor seconds of all child processes that have ended so far, with their own
    children.
    """
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def output(line: Sequence[str], place: Path, seconds: float) -> str:
    """What a planner prints; nothing if it fails.

    After the time it is ended with all that it has started.
    """
    quiet = subprocess.DEVNULL
    with subprocess.Popen(
        line,
        stdout=subprocess.PIPE,
        stderr=quiet,
        text=True,
        cwd=place,
        env=_environment(),
        start_new_session=True,
    ) as planner:
        try:
            said, _ = planner.communicate(timeout=seconds)
        except subprocess.TimeoutExpired:
            os.killpg(planner.pid, signal.SIGKILL)
            return ""
    return said if planner.returncode == 0 else ""


def _environment() -> dict[str, str]:
    """Ours, with this checkout; bytecode is kept, as it is where people work."""
    kept = {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
    return {**kept, "PYTHONPATH": str(Path(__file__).resolve().parent.parent)}


def _steps(folder: Path, plan: Path) -> int | None:
    """The length of a plan that our checker accepts."""
    if not plan.is_file():
        return None
    task = read_pddl_task(folder / "domain.pddl", folder / "problem.pddl")
    try:
        made = read_plan(task, plan)
    except InvalidInput:
        return None
    return len(made.steps) if not checked_plan.check_plan(task.problem, made) else None


def summary(runs: Sequence[Run], planners: Sequence[str]) -> Table:
    """Solved tasks, and on the tasks that both solve the ratio of times and the lengths beside
    the first planner's.
    """
    made = Table(box=None, pad_edge=False, title=f"beside {planners[0]}, on tasks that both solve")
    for column in ("planner", "solved", "time ratio", "steps", f"steps of {planners[0]}"):
        made.add_column(column, justify="left" if column == "planner" else "right")
    by_task = {(each.task, each.planner): each for each in runs}
    names = dict.fromkeys(each.task for each in runs)
    for planner in planners:
        pairs = [(by_task[name, planner], by_task[name, planners[0]]) for name in names]
        solved = sum(each.steps is not None for each, _ in pairs)
        both = [
            (one, first)
            for one, first in pairs
            if one.steps is not None and first.steps is not None
        ]
        ratio = math.exp(
            sum(math.log(one.seconds / first.seconds) for one, first in both) / max(len(both), 1)
        )
        lengths = [sum(each.steps or 0 for each in side) for side in zip(*both, strict=True)] or [
            0,
            0,
        ]
        made.add_row(planner, f"{solved} of {len(pairs)}", f"{ratio:.2f}", *map(str, lengths))
    return made


def listing(runs: Sequence[Run], planners: Sequence[str]) -> Table:
    """Seconds and steps of every run."""
    made = Table(box=None, pad_edge=False)
    made.add_column("task")
    for planner in planners:
        made.add_column(planner, justify="right")
    for name in dict.fromkeys(each.task for each in runs):
        own = {each.planner: each for each in runs if each.task == name}
        cells = [
            f"{own[p].seconds:.2f} s {own[p].steps if own[p].steps is not None else '-':>4}"
            for p in planners
        ]
        made.add_row(name, *cells)
    return made


def installed(python: str, names: Sequence[str]) -> dict[str, Command]:
    """The command lines of the peers that an environment has; one that it lacks is told and
    left out.
    """
    peers = {"lama-first": lama_first, "pyperplan": pyperplan, "enhsp": enhsp}
    found: dict[str, Command] = {}
    for name in names:
        try:
            found[name] = peers[name](str(Path(python).absolute()))
        except LookupError as missing:
            print(f"{name} is left out: {missing}", file=sys.stderr)
    return found


def main() -> int:
    """Measure, print, keep."""
    parser = argparse.ArgumentParser(description="solve competition tasks beside other planners")
    parser.add_argument(
        "--data", type=Path, default=Path(os.environ.get("CELLWRIGHT_DATA", "../shared/data"))
    )
    parser.add_argument("--levels", default="1-4")
    parser.add_argument("--seconds", type=float, default=60)
    parser.add_argument("--planners", default="auto,backward", help=f"of {', '.join(OURS)}")
    parser.add_argument("--peers", help="the Python of an environment with the peers")
    parser.add_argument("--beside", default=",".join(PEERS[:2]), help=f"of {', '.join(PEERS)}")
    parser.add_argument("--only", default="", help="tasks whose name has this in it")
    parser.add_argument("--numeric", action="store_true", help="the tasks with numbers")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    commands = {name: ours(name) for name in arguments.planners.split(",")}
    if arguments.peers:
        commands |= installed(arguments.peers, arguments.beside.split(","))
    first, _, last = arguments.levels.partition("-")
    found = (
        numeric_tasks(arguments.data)
        if arguments.numeric
        else tasks(arguments.data, (int(first), int(last or first)))
    )
    wanted = [each for each in found if arguments.only in each.name]
    if not wanted:
        print(f"no tasks under {arguments.data}: give --data")
        return 2
    console = Console(width=None if sys.stdout.isatty() else 160)
    runs: list[Run] = []
    for task in wanted:
        for planner, command in commands.items():
            runs.append(run(task, planner, command, arguments.seconds))
            done = runs[-1]
            print(
                f"{done.task} {planner} {done.seconds:.2f} s {done.steps}",
                file=sys.stderr,
                flush=True,
            )
    console.print(listing(runs, list(commands)))
    console.print(summary(runs, list(commands)))
    if arguments.json:
        arguments.json.write_text(json.dumps([asdict(each) for each in runs], indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
