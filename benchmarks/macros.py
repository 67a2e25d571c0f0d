"""Lookup in a library of ten thousand MACROPs against planning, on a bulkhead with a thousand
points.

    python benchmarks/macros.py [--macrops N] [--points N] [--library FILE] [--part PART ...]
        [--json FILE]

Parts: `lookup` (seconds of the processor by size of the library), `sequence` (a thousand points one
after another), `planning` (one problem planned from scratch: minutes and gigabytes, so it is left
out unless asked for). The library is made once in FILE (default: macros.db in the folder
CELLWRIGHT_DATA, else a temporary one). Exits with 1 when a bar is missed: median lookup at most 2
ms and 1/100 of planning, lookup at 10,000 MACROPs at most three times that at 100, hit rate above
99 %.
"""

import argparse
import dataclasses
import gc
import json
import os
import random
import resource
import statistics
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from points import Day, again, cell, different_days, measured
from rich.console import Console
from rich.progress import track
from rich.table import Table

from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.pipelines.planning.macros import LibraryPlanner
from cellwright.engine.stages.lifted.cell_domain import CellDomain, Situation
from cellwright.engine.stages.macros.learning.plan_generalisation import generalise_plan
from cellwright.engine.stages.macros.lookup.macro_lookup import LookupHit
from cellwright.engine.stages.macros.lookup.macro_query import make_query
from cellwright.engine.stages.macros.lookup.macro_repertoire import Repertoire, macro_record
from cellwright.engine.stages.validation import validate_plan
from cellwright.kb.model.conditions import And, Literal
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.store import Library, loads
from cellwright.kb.store import dumps as written

SMALL, SEED, BATCH = 14, 1, 200
console = Console()


def lessons(days: list[Day]) -> list[str]:
    """The MACROPs of some days, as documents; made in a process of its own."""
    problem = cell(SMALL)
    world = CellDomain(problem)
    found = []
    for day in days:
        posed = dataclasses.replace(problem, goal=day.goals(), initial=day.initial(), complete=True)
        found.append(
            written(generalise_plan(posed, day.plan(), world, frozenset(day.initial())).macrop)
        )
    return found


def fill(target: Path, days: list[Day], wanted: int) -> None:
    """Learn days into a library until it holds as many MACROPs as are wanted, in two processes."""
    batches = [days[start : start + BATCH] for start in range(0, len(days), BATCH)]
    with Library(str(target)) as library, ProcessPoolExecutor(2) as pool:
        for documents in track(
            pool.map(lessons, batches), "learning", len(batches), transient=True
        ):
            library.add([macro_record(loads(text), 1.0) for text in documents])
            if library.figures().macrops >= wanted:
                pool.shutdown(cancel_futures=True)
                break


def figures(times: Iterable[float]) -> dict[str, float]:
    """Median, 99th percentile and maximum in milliseconds."""
    ordered = sorted(seconds * 1000 for seconds in times)
    return {
        "median_ms": statistics.median(ordered),
        "p99_ms": ordered[int(len(ordered) * 0.99)],
        "max_ms": ordered[-1],
    }


@dataclasses.dataclass
class Bench:
    """A big cell, loaded once, and what was found out about it."""

    problem: Problem
    world: CellDomain
    loading_s: float
    rows: list[dict[str, Any]] = dataclasses.field(default_factory=list)

    @classmethod
    def of(cls, points: int) -> "Bench":
        """Load the cell and evaluate its statics."""
        problem = cell(points)
        started = time.perf_counter()
        world = CellDomain(problem)
        return cls(problem, world, time.perf_counter() - started)

    def posed(self, day: Day) -> tuple[Problem, Situation]:
        """A day as a problem of the big cell."""
        posed = dataclasses.replace(
            self.problem, goal=day.goals(), initial=day.initial(), complete=True
        )
        return posed, Situation.of(self.world, day.initial())


def timed(
    repertoire: Repertoire, problem: Problem, here: Situation
) -> tuple[float, LookupHit | None]:
    """Seconds of the processor from a loaded problem to a checked plan, and the plan."""
    started = time.process_time()
    asked = make_query(problem, here)
    assert asked is not None
    hit = repertoire.find(asked)
    return time.process_time() - started, hit


def lookup(bench: Bench, library: Path, days: list[Day], most: int) -> None:
    """Latencies for the same hundred kinds of day in libraries of growing size."""
    draw = random.Random(SEED + 1)
    points = len(bench.problem.objects)
    kinds = {
        "figure 4": [bench.posed(again(_figure_4(), draw, points)) for _ in range(1000)],
        "up to six points": [
            bench.posed(again(day, draw, points)) for day in days[:90] for _ in range(11)
        ],
        "six points": [
            bench.posed(again(day, draw, points)) for day in _longest(days[:90]) for _ in range(40)
        ],
        "each another day": [bench.posed(again(day, draw, points)) for day in days[:most:10]],
    }
    with Library(str(library)) as whole:
        stored = [macro_record(each.macrop) for each in whole.all()[:most]]
    for size in sorted({100, min(1000, len(stored)), len(stored)}):
        with tempfile.TemporaryDirectory() as folder, Library(f"{folder}/part.db") as part:
            started = time.process_time()
            part.add(stored[:100] + stored[len(stored) - (size - 100) :])
            adding = time.process_time() - started
            repertoire = Repertoire(part, bench.problem.domain)
            started = time.process_time()
            repertoire.load()
            row = {
                "size": len(repertoire),
                "add_s": adding,
                "load_s": time.process_time() - started,
            }
            gc.collect()
            gc.freeze()  # what the benchmark itself keeps in memory is none of lookup's concern
            for name, problems in kinds.items():
                times, hits = zip(*(timed(repertoire, *each) for each in problems), strict=True)
                found = {"queries": name, "hits": sum(h is not None for h in hits), "of": len(hits)}
                bench.rows.append({**row, **found, **figures(times)})
                _agrees(problems[:3], hits[:3])


def _longest(days: list[Day]) -> list[Day]:
    most = max(len(day.points) for day in days)
    return [day for day in days if len(day.points) == most]


def _figure_4() -> Day:
    from points import PROBE

    return Day("contact", 1, PROBE, (2,))


def _agrees(problems: list[tuple[Problem, Situation]], hits: tuple[LookupHit | None, ...]) -> None:
    """The independent checker has nothing against some of the plans; it is too slow for all of
    them here.
    """
    for (problem, _), hit in zip(problems, hits, strict=True):
        assert hit is None or validate_plan(problem, hit.plan) == []


def sequence(bench: Bench, cold: bool) -> dict[str, Any]:
    """All points in random order, each from the state that the last one left."""
    points = len(bench.problem.objects)
    order = random.Random(SEED).sample(range(2, points + 1), points - 1)
    with tempfile.TemporaryDirectory() as folder, Library(f"{folder}/days.db") as library:
        learned = 0 if cold else _learn_small(library)
        with LibraryPlanner(library) as practice:
            here = practice.situation(bench.problem)
            started, times, origins = time.perf_counter(), [], []
            for point in order:
                problem = dataclasses.replace(bench.problem, goal=And((Literal(measured(point)),)))
                began = time.perf_counter()
                answered = practice.plan(problem, here)
                times.append(time.perf_counter() - began)
                origins.append(answered.origin)
                assert isinstance(answered.outcome, Found)
                assert answered.after is not None
                here = answered.after
            total = time.perf_counter() - started
    hits = origins.count("library")
    return {
        "points": len(order),
        "prepared": learned,
        "hits": hits,
        "total_s": total,
        **figures(times),
    }


def _learn_small(library: Library) -> int:
    """Learn on a bulkhead of six points what a day needs; how often the planner was asked."""
    small = cell(6)
    with LibraryPlanner(library) as practice:
        here = practice.situation(small)
        asked = 0
        for point in (2, 3, 6, 1, 4, 3, 2):
            fresh = Situation(here.world, here.facts.after([measured(point)], ()))
            problem = dataclasses.replace(small, goal=And((Literal(measured(point)),)))
            answered = practice.plan(problem, fresh)
            asked += answered.origin == "planner"
            assert answered.after is not None
            here = answered.after
    return asked


def from_scratch(bench: Bench) -> dict[str, Any]:
    """One point planned from scratch, grounding and checking included."""
    started = time.perf_counter()
    outcome = checked_plan.plan_problem(bench.problem)
    assert isinstance(outcome, Found)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    return {
        "seconds": time.perf_counter() - started,
        "peak_gib": peak,
        "steps": len(outcome.plan.steps),
    }


def verdicts(found: dict[str, Any]) -> Iterator[tuple[str, bool]]:
    """The bars and whether they are met."""
    rows = [row for row in found.get("lookup", ()) if row["queries"] == "figure 4"]
    if rows:
        median = rows[-1]["median_ms"]
        yield f"median lookup at {rows[-1]['size']} MACROPs {median:.2f} ms <= 2 ms", median <= 2
        for kind in ("figure 4", "up to six points", "six points"):
            own = [row["median_ms"] for row in found["lookup"] if row["queries"] == kind]
            yield (
                f"{kind}: {own[-1] / own[0]:.2f} times the time at 100, <= 3",
                own[-1] <= 3 * own[0],
            )
        if "planning" in found:
            ratio = found["planning"]["seconds"] * 1000 / median
            yield f"planning takes {ratio:.0f} times as long, >= 100", ratio >= 100
    if "sequence" in found:
        rate = found["sequence"]["hits"] / found["sequence"]["points"]
        yield f"hit rate {rate:.1%} > 99 %", rate > 0.99


def show(found: dict[str, Any]) -> bool:
    """Print everything; whether all bars are met."""
    table = Table(title=f"lookup; statics of the cell {found['loading_s']:.2f} s, once")
    for title in ("MACROPs", "queries", "hits", "median ms", "p99 ms", "max ms", "add s", "load s"):
        table.add_column(title, justify="right")
    for row in found.get("lookup", ()):
        numbers = (
            f"{row[key]:.2f}" for key in ("median_ms", "p99_ms", "max_ms", "add_s", "load_s")
        )
        table.add_row(str(row["size"]), row["queries"], f"{row['hits']}/{row['of']}", *numbers)
    console.print(table)
    for part in ("sequence", "planning"):
        if part in found:
            console.print(part, {key: round(value, 3) for key, value in found[part].items()})
    judged = list(verdicts(found))
    for said, met in judged:
        console.print(
            f"{'met   ' if met else 'MISSED'} {said}", style="green" if met else "bold red"
        )
    return all(met for _, met in judged)


def main() -> None:
    """Run the parts asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--macrops", type=int, default=10_000)
    parser.add_argument("--points", type=int, default=1000)
    parser.add_argument("--library", type=Path)
    parser.add_argument("--part", action="append", choices=["lookup", "sequence", "planning"])
    parser.add_argument(
        "--cold", action="store_true", help="sequence: ask the planner in the big cell, too"
    )
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    parts = options.part or ["lookup", "sequence"]
    with tempfile.TemporaryDirectory() as folder:
        data = Path(os.environ.get("CELLWRIGHT_DATA", folder))
        library = options.library or data / f"macros_{options.macrops}.db"
        bench = Bench.of(options.points)
        found: dict[str, Any] = {"loading_s": bench.loading_s}
        if "planning" in parts:
            found["planning"] = from_scratch(bench)
        if "lookup" in parts:
            days = [_figure_4(), *different_days(options.macrops * 2, SMALL, SEED)]
            if not library.exists():
                fill(library, days, options.macrops)
            lookup(bench, library, days, options.macrops)
            found["lookup"] = bench.rows
        if "sequence" in parts:
            found["sequence"] = sequence(bench, options.cold)
    met = show(found)
    if options.json:
        options.json.write_text(json.dumps(found, indent=1), encoding="utf-8")
    sys.exit(0 if met else 1)


if __name__ == "__main__":
    main()
