"""What MACROPs and revision are worth: probes by the dozen, planning competitions' tasks, disturbed
plans.

    python benchmarks/reuse.py [--part probes|pddl|revision ...] [--probes N ...] [--data FOLDER]
        [--json FILE]

`probes`: THEMSE with more depots in the drawer, with a library that one small problem filled,
beside planning without. `pddl`: MACROPs learned on levels 1 and 2 of a domain, used on 3 to 5
(FOLDER/DOMAIN/LEVEL_NAME/{domain,problem}.pddl; default: the folder pddl in CELLWRIGHT_DATA), as
whole plans and inside searches; work is nodes generated. `revision`: plans of both cells, disturbed
in the middle. Times are of the processor. Exits with 1 when a bar is missed: cost not worse by more
than 5 %, growth close to linear in the number of probes, no harm on later levels (in time, work and
cost, geometric means), revised plans valid and cheaper to find in the median.
"""

import argparse
import gc
import json
import os
import random
import statistics
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from cellwright.engine.formats.interop.pddl import read_pddl_task
from cellwright.engine.model.outcome import Found, Outcome
from cellwright.engine.model.plan_times import plan_makespan
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.pipelines.planning.macros import LibraryPlanner
from cellwright.engine.pipelines.recovery.plan_revision import revise_plan
from cellwright.engine.stages.planning import SearchLimits
from cellwright.engine.stages.validation import validate_plan
from cellwright.kb.loader import load
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.store import Library

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "engine" / "pipelines" / "recovery"))
from disturbances import PLANS, course, moment

LIMIT_S = 10.0  # of one planning task
HARM = 1.05  # of time and cost in the mean
REPEATED_S = 0.5  # tasks that take less are timed three times, and the least time counts
console = Console()
Row = dict[str, Any]


def seconds(run: Callable[[], Any]) -> tuple[float, Any]:
    """Processor time of a call, and what it returns."""
    started = time.process_time()
    found = run()
    return time.process_time() - started, found


def cost(outcome: Outcome) -> int | None:
    """What a plan costs; None without one."""
    return outcome.plan.cost if isinstance(outcome, Found) else None


def limited() -> SearchLimits:
    """Limits that end a task after some seconds of the processor."""
    end = time.process_time() + LIMIT_S
    return SearchLimits(interrupted=lambda: time.process_time() > end)


def drawer(probes: int) -> Problem:
    """A rack whose drawer has a depot for each of many probes, all to be heated, cooled and
    stored.
    """
    more = "".join(f"  - own_depot(probe_{n}, slot(drawer, {n}))\n" for n in range(5, probes + 1))
    extra = f"objects:\n  probe: [probe_5..{probes}]\n" if probes > 4 else ""
    text = (
        f"problem: probes_{probes}\ndomain: themse\n{extra}statics:\n  - capacity(drawer, "
        f"{probes})\n{more}"
        f"workflow:\n  - for: {{P: [probe_1..{probes}]}}\n    stages: heated(P, 15 min), "
        "cooled(P, 5 min), stored(P)\n"
    )
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "probes.yaml"
        file.write_text(text, encoding="utf-8")
        problem = load(file).problem
    assert problem is not None
    return problem


def probes(numbers: list[int]) -> Iterator[Row]:
    """Time and cost with learned MACROPs and without, by the number of probes."""
    with tempfile.TemporaryDirectory() as folder, Library(f"{folder}/probes.db") as library:
        learning, _ = seconds(lambda: _practised(library, drawer(3)))
        for number in numbers:
            problem = drawer(number)
            plain_s, plain = seconds(lambda p=problem: checked_plan.plan_problem(p))  # type: ignore[misc]
            with_s, answered = seconds(lambda p=problem: _practised(library, p))  # type: ignore[misc]
            assert isinstance(answered.outcome, Found)
            assert validate_plan(problem, answered.outcome.plan) == []
            assert isinstance(plain, Found)
            costs = {"cost": cost(answered.outcome), "plain_cost": cost(plain)}
            costs |= {
                "lasts_s": plan_makespan(answered.outcome.plan),
                "plain_lasts_s": plan_makespan(plain.plan),
            }
            row = {
                "probes": number,
                "origin": answered.origin,
                "with_s": with_s,
                "plain_s": plain_s,
            }
            yield {**row, **costs, "learning_s": learning}


def _practised(library: Library, problem: Problem, learns: bool = True) -> Any:
    with LibraryPlanner(library, limited(), learns=learns) as practice:
        return practice.plan(problem)


def pddl(data: Path, domains: list[str]) -> Iterator[Row]:
    """Levels 3 to 5 with what levels 1 and 2 taught, and without."""
    for domain in domains or sorted(each.name for each in data.iterdir()):
        with tempfile.TemporaryDirectory() as folder, Library(f"{folder}/{domain}.db") as library:
            for level in sorted((data / domain).iterdir()):
                if level.name[0] in "12":
                    _practised(library, _task(level))
                else:
                    yield {"domain": domain, "level": level.name[0], **_compared(library, level)}


def _compared(library: Library, level: Path) -> Row:
    """One task without the library and with it; the library stays as it is."""
    plain_s, plain = _least(lambda task: checked_plan.plan_problem(task, limited()), level)
    with_s, answered = _least(lambda task: _practised(library, task, learns=False), level)
    found = answered.outcome
    offer = found.statistics.offer
    row: Row = {"origin": answered.origin, "search": offer.search, "macrops": len(offer.used)}
    row |= {"with_s": with_s, "plain_s": plain_s, "cost": cost(found), "plain_cost": cost(plain)}
    return {**row, "work": _work(found), "plain_work": _work(plain)}


def _work(outcome: Outcome) -> int:
    return outcome.statistics.counts.get("generated", 0)


def _least(run: Callable[[Problem], Any], level: Path) -> tuple[float, Any]:
    """The least time of three runs, or of one that takes long, each from a problem read anew."""
    times: list[float] = []
    found = None
    while len(times) < 3:
        task = _task(level)
        gc.collect()
        took, found = seconds(lambda t=task: run(t))  # type: ignore[misc]
        times.append(took)
        if took > REPEATED_S:
            break
    return min(times), found


def _task(level: Path) -> Problem:
    return read_pddl_task(level / "domain.pddl", level / "problem.pddl").problem


def revisions(each: int) -> Iterator[Row]:
    """Plans of both cells, disturbed at random, revised and planned anew."""
    for path in PLANS:
        made = course(path)
        for seed in range(each):
            draw = random.Random(seed)
            now = moment(made, draw.randrange(len(made.plan.steps)), draw.randint(1, 3), 0, draw)
            revising, found = seconds(lambda m=made, n=now: revise_plan(m, n.done, n.observed))  # type: ignore[misc]
            scratch, fresh = seconds(lambda f=found: checked_plan.plan_problem(f.problem))  # type: ignore[misc]
            valid = isinstance(found.outcome, Found) and not validate_plan(
                found.problem, found.outcome.plan
            )
            row = {"plan": f"{path.parts[-3]}/{path.stem}", "way": found.way, "valid": valid}
            costs = {"cost": cost(found.outcome), "fresh_cost": cost(fresh)}
            yield {**row, "revising_s": revising, "scratch_s": scratch, **costs}


def table(title: str, rows: list[Row]) -> None:
    """Print rows as they are."""
    printed = Table(title=title)
    for name in rows[0]:
        printed.add_column(name, justify="right", overflow="fold")
    for row in rows:
        printed.add_row(
            *(f"{each:.3f}" if isinstance(each, float) else str(each) for each in row.values())
        )
    console.print(printed)


def judged_probes(rows: list[Row]) -> Iterator[tuple[str, bool]]:
    """Costs, and growth between the fewest and the most probes."""
    for row in rows:
        ratio = row["cost"] / row["plain_cost"]
        yield f"{row['probes']} probes: cost {ratio:.2f} of planning's, <= 1.05", ratio <= 1.05
    first, last = rows[0], rows[-1]
    grown = (last["with_s"] / first["with_s"]) / (last["probes"] / first["probes"])
    yield f"time grows {grown:.2f} times as fast as the number of probes, <= 1.5", grown <= 1.5


def judged_pddl(rows: list[Row]) -> Iterator[tuple[str, bool]]:
    """No harm: answered where planning answers, in no more time and at no more cost in the
    mean; by domain, and over all.
    """
    lost = [row for row in rows if row["cost"] is None and row["plain_cost"] is not None]
    won = sum(row["cost"] is not None and row["plain_cost"] is None for row in rows)
    yield f"{len(lost)} tasks lost, {won} won", not lost
    for domain in sorted({row["domain"] for row in rows}):
        yield f"{domain}: {_means([row for row in rows if row['domain'] == domain])}", True
    both = [row for row in rows if row["cost"] and row["plain_cost"]]
    time_ratio, cost_ratio = _mean(both, "with_s", "plain_s"), _mean(both, "cost", "plain_cost")
    yield f"all: {_means(rows)}", time_ratio <= HARM and cost_ratio <= HARM


def _means(rows: list[Row]) -> str:
    both = [row for row in rows if row["cost"] and row["plain_cost"]]
    if not both:
        return "no task answered both ways"
    ratios = (
        ("time", "with_s", "plain_s"),
        ("work", "work", "plain_work"),
        ("cost", "cost", "plain_cost"),
    )
    return ", ".join(f"{name} {_mean(both, one, other):.2f}" for name, one, other in ratios)


def _mean(rows: list[Row], one: str, other: str) -> float:
    """The geometric mean of ratios."""
    return (
        statistics.geometric_mean(max(row[one], 1e-3) / max(row[other], 1e-3) for row in rows)
        if rows
        else 1.0
    )


def judged_revisions(rows: list[Row]) -> Iterator[tuple[str, bool]]:
    """Validity, and the median of both times."""
    ways = Counter(row["way"] for row in rows)
    yield (
        f"{sum(row['valid'] for row in rows)} of {len(rows)} valid ({dict(ways)})",
        all(r["valid"] for r in rows),
    )
    ratio = statistics.median(row["revising_s"] / row["scratch_s"] for row in rows)
    yield f"revising takes {ratio:.2f} of the time from scratch in the median, < 1", ratio < 1
    dearer = sum(row["cost"] for row in rows) / sum(row["fresh_cost"] for row in rows)
    yield f"revised plans cost {dearer:.2f} of fresh ones, <= 1.05", dearer <= 1.05


def main() -> None:
    """Run the parts asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--part", action="append", choices=["probes", "pddl", "revision"])
    parser.add_argument("--probes", type=int, nargs="+", default=[4, 8, 16, 32])
    parser.add_argument(
        "--domain", action="append", default=[], help="of planning competitions; default: all"
    )
    parser.add_argument("--each", type=int, default=10, help="disturbances of each plan")
    parser.add_argument(
        "--data", type=Path, default=Path(os.environ.get("CELLWRIGHT_DATA", "data")) / "pddl"
    )
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    gc.set_threshold(100_000)  # as the command line does
    parts = options.part or ["probes", "revision", *(["pddl"] if options.data.is_dir() else [])]
    found: dict[str, list[Row]] = {}
    verdicts: list[tuple[str, bool]] = []
    if "probes" in parts:
        found["probes"] = list(probes(options.probes))
        verdicts += judged_probes(found["probes"])
    if "pddl" in parts:
        found["pddl"] = list(pddl(options.data, options.domain))
        verdicts += judged_pddl(found["pddl"])
    for part, rows in found.items():
        table(part, rows)
    if "revision" in parts:
        found["revision"] = list(revisions(options.each))
        verdicts += judged_revisions(found["revision"])
    for said, met in verdicts:
        console.print(
            f"{'met   ' if met else 'MISSED'} {said}", style="green" if met else "bold red"
        )
    if options.json:
        options.json.write_text(json.dumps(found, indent=1), encoding="utf-8")
    sys.exit(0 if all(met for _, met in verdicts) else 1)


if __name__ == "__main__":
    main()
