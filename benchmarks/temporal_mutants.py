"""Mutants of plans with times, judged by our checker and by those of others, beside each other.

    python benchmarks/temporal_mutants.py [--data DIR] [--mutants 500] [--seed 0] [--kairos FILE]
        [--val FILE] [--up] [--json FILE] [--keep DIR]

A plan of each small task gets one change: a step earlier, later, longer, shorter, at the instant of
another, twice, left out, with another object, exchanged with another. `--kairos` and `--val` name
the programs `kairos` and `Validate`; `--up` asks the validator of unified-planning where it reads
the task. All get an epsilon of 0.001. The table counts verdicts; each kind of disagreement is
listed with an example. `docs/decisions/time.md` decides them from the text of PDDL 2.1.
"""

import argparse
import json
import os
import random
import re
import subprocess
import sys
import tempfile
import warnings
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path

from cellwright.engine.formats.interop.pddl.durative import TemporalTask, read_temporal
from cellwright.engine.formats.interop.pddl.durative.plans import write_timed_plan
from cellwright.engine.model.temporal import PlannedInTime
from cellwright.engine.pipelines.planning.temporal_plans import TimeEffort, plan_with_times
from cellwright.engine.stages.instants import breaches
from cellwright.kb.model.durative import TimedPlan, TimedStep
from cellwright.kb.terms import Function

SMALL = (
    "crewplanning/1_1",
    "driverlog/2_1",
    "elevators/1_1",
    "matchcellar/1_1",
    "openstacks/2_1",
    "parcprinter/1_1",
    "pegsol/1_1",
    "satellite-tw/1_2",
    "tms/1_1",
    "woodworking/1_2",
)
EXPANSIONS = 20_000  # for the plan of a task: any will do
SHIFTS = tuple(map(Fraction, ("0.001", "0.0005", "0.0001", "0.01", "1", "10")))
PATIENCE_S = 60  # for one verdict of a program


@dataclass
class Task:
    """A task, its files, and what judges its plans beside our checker."""

    name: str
    domain: Path
    problem: Path
    task: TemporalTask
    judges: dict[str, Callable[[TimedPlan, Path], str]] = field(default_factory=dict)


def mutant(task: TemporalTask, plan: TimedPlan, chance: random.Random) -> tuple[str, TimedPlan]:
    """The kind of one change, and the plan with it."""
    kind, change = chance.choice(list(CHANGES.items()))
    steps = list(plan.steps)
    change(task, steps, chance)
    return kind, TimedPlan(tuple(sorted(steps, key=lambda step: step.start)))


def _shifted(_: TemporalTask, steps: list[TimedStep], chance: random.Random) -> None:
    place = chance.randrange(len(steps))
    by = chance.choice(SHIFTS) * chance.choice((1, -1))
    steps[place] = replace(steps[place], start=max(Fraction(0), steps[place].start + by))


def _lengthened(_: TemporalTask, steps: list[TimedStep], chance: random.Random) -> None:
    place = chance.randrange(len(steps))
    by = chance.choice(SHIFTS) * chance.choice((1, -1))
    if steps[place].duration:
        steps[place] = replace(steps[place], duration=max(by, steps[place].duration + by))


def _left_out(_: TemporalTask, steps: list[TimedStep], chance: random.Random) -> None:
    del steps[chance.randrange(len(steps))]


def _repeated(_: TemporalTask, steps: list[TimedStep], chance: random.Random) -> None:
    step = chance.choice(steps)
    steps.append(replace(step, start=chance.choice(steps).end + Fraction(1, 1000)))


def _exchanged(_: TemporalTask, steps: list[TimedStep], chance: random.Random) -> None:
    one, two = chance.randrange(len(steps)), chance.randrange(len(steps))
    starts = steps[one].start, steps[two].start
    steps[one] = replace(steps[one], start=starts[1])
    steps[two] = replace(steps[two], start=starts[0])


def _together(_: TemporalTask, steps: list[TimedStep], chance: random.Random) -> None:
    place, other = chance.randrange(len(steps)), chance.choice(steps)
    at = chance.choice((other.start, other.end))
    if chance.random() < 0.5:
        at = max(Fraction(0), at - steps[place].duration)
    steps[place] = replace(steps[place], start=at)


def _for_another(task: TemporalTask, steps: list[TimedStep], chance: random.Random) -> None:
    place = chance.randrange(len(steps))
    action = steps[place].action
    schema = next(each for each in task.problem.actions if each.name == action.name)
    if not action.arguments:
        return
    index = chance.randrange(len(action.arguments))
    members = task.problem.members(schema.parameters[index].type)
    arguments = list(action.arguments)
    arguments[index] = Function(chance.choice(members))
    steps[place] = replace(steps[place], action=Function(action.name, tuple(arguments)))


CHANGES = {
    "shift": _shifted,
    "length": _lengthened,
    "left out": _left_out,
    "repeated": _repeated,
    "exchanged": _exchanged,
    "together": _together,
    "another object": _for_another,
}


def of_ours(task: Task, plan: TimedPlan) -> str:
    """Our verdict: valid, or the codes of what is wrong."""
    codes = sorted({breach.code for breach in breaches(task.task.problem, plan)})
    return "+".join(codes) or "valid"


def of_kairos(program: str, task: Task) -> Callable[[TimedPlan, Path], str]:
    """The verdict of Kairos: valid, too close (a warning of its), or invalid."""

    def judge(_: TimedPlan, file: Path) -> str:
        line = [program, "validate", str(task.domain), str(task.problem), str(file)]
        said = _output([*line, "--epsilon", "0.001"])
        if "plan valid" in said:
            return "too close" if "too_close" in said else "valid"
        return "invalid"

    return judge


def of_val(program: str, task: Task) -> Callable[[TimedPlan, Path], str]:
    """The verdict of VAL."""

    def judge(_: TimedPlan, file: Path) -> str:
        said = _output([program, "-t", "0.001", str(task.domain), str(task.problem), str(file)])
        return "valid" if "Plan valid" in said else "invalid" if "lan" in said else "no answer"

    return judge


def _output(line: list[str]) -> str:
    ended = subprocess.run(line, capture_output=True, text=True, check=False, timeout=PATIENCE_S)
    return ended.stdout + ended.stderr


def of_up(task: Task) -> Callable[[TimedPlan, Path], str] | None:
    """The verdict of unified-planning; None where it does not read the task."""
    from unified_planning.engines.plan_validator import TimeTriggeredPlanValidator
    from unified_planning.io import PDDLReader
    from unified_planning.shortcuts import get_environment

    warnings.simplefilter("ignore")
    get_environment().credits_stream = None
    reader = PDDLReader()
    try:
        problem = reader.parse_problem(str(task.domain), str(task.problem))
        validator = TimeTriggeredPlanValidator()
        if not validator.supports(problem.kind):
            return None
    except Exception:
        return None

    def judge(_: TimedPlan, file: Path) -> str:
        plan = reader.parse_plan(problem, str(file))
        return "valid" if validator.validate(problem, plan) else "invalid"

    return judge


def tasks(data: Path, place: Path) -> Iterator[Task]:
    """Small tasks of the data, and those of the tests."""
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
    from tests import lag_tasks, timed_examples

    for name in SMALL:
        files = data / name / "domain.pddl", data / name / "problem.pddl"
        yield Task(name, *files, read_temporal(*files))
    texts = {
        "cellar": (timed_examples.CELLAR, timed_examples.FUSES),
        "patrol": (timed_examples.PATROL, timed_examples.ROUND),
        "hatch": (timed_examples.HATCH, timed_examples.WINDOW),
    }
    for name in ("hoist", "two windows", "three plates"):
        lags, _ = lag_tasks.TASKS[name]
        texts[name] = lags.domain(), lags.problem()
    for name, (domain, problem) in texts.items():
        folder = place / name.replace(" ", "_")
        folder.mkdir()
        made = timed_examples.task_of(folder, domain, problem)
        yield Task(name, folder / "domain.pddl", folder / "problem.pddl", made)


def judged(arguments: argparse.Namespace, place: Path) -> Iterator[dict[str, str]]:
    """A row for each mutant: its task, its kind, and each verdict."""
    chance = random.Random(arguments.seed)
    ready: list[tuple[Task, TimedPlan]] = []
    for task in tasks(arguments.data, place):
        outcome = plan_with_times(task.task.problem, TimeEffort(expansions=EXPANSIONS))
        if not isinstance(outcome, PlannedInTime):
            print(f"{task.name}: no plan", file=sys.stderr)
            continue
        if arguments.kairos:
            task.judges["kairos"] = of_kairos(arguments.kairos, task)
        if arguments.val:
            task.judges["val"] = of_val(arguments.val, task)
        if arguments.up and (judge := of_up(task)):
            task.judges["up"] = judge
        print(
            f"{task.name}: {len(outcome.plan.steps)} steps; {', '.join(task.judges)}",
            file=sys.stderr,
        )
        ready.append((task, outcome.plan))
        yield row_of(task, "plan", outcome.plan, place / "plan")
    count = 0
    while count < arguments.mutants:
        task, plan = ready[count % len(ready)]
        kind, changed = mutant(task.task, plan, chance)
        if changed == plan:
            continue
        keep = arguments.keep / f"{count}_{task.name.replace('/', '_')}" if arguments.keep else None
        yield row_of(task, kind, changed, keep or place / "plan")
        count += 1


def row_of(task: Task, kind: str, plan: TimedPlan, file: Path) -> dict[str, str]:
    """All verdicts on one plan."""
    file.write_text(re.sub(r"; makespan.*", "", write_timed_plan(task.task, plan)), "utf-8")
    row = {"task": task.name, "kind": kind, "file": str(file), "ours": of_ours(task, plan)}
    for name, judge in task.judges.items():
        try:
            row[name] = judge(plan, file)
        except Exception as error:
            row[name] = f"fails: {type(error).__name__}"
    return row


def main() -> int:
    """Judge, count, list."""
    parser = argparse.ArgumentParser(description="judge mutants of plans with times")
    data = Path(os.environ.get("CELLWRIGHT_DATA", "../shared/data"))
    parser.add_argument("--data", type=Path, default=data / "pddl-temporal")
    parser.add_argument("--mutants", type=int, default=500)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kairos", default="")
    parser.add_argument("--val", default="")
    parser.add_argument("--up", action="store_true")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--keep", type=Path, help="a folder for the mutants")
    arguments = parser.parse_args()
    if arguments.keep:
        arguments.keep.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as place:
        rows = list(judged(arguments, Path(place)))
    print(f"{sum(row['kind'] != 'plan' for row in rows)} mutants")
    for name in ("kairos", "val", "up"):
        counts: Counter[tuple[str, str]] = Counter()
        examples: dict[tuple[str, str], list[str]] = defaultdict(list)
        for row in rows:
            if name in row:
                key = row["ours"], row[name]
                counts[key] += 1
                examples[key].append(f"{row['task']} {row['kind']} {row['file']}")
        for (ours, theirs), count in sorted(counts.items()):
            same = (ours == "valid") == (theirs == "valid")
            more = "" if same else f"  {'; '.join(examples[ours, theirs][:4])}"
            print(f"{name:7} ours {ours:15} theirs {theirs:10} {count:4}{more}")
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
