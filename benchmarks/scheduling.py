"""Job shops, S-LAB protocols and the laboratory cell with many probes: makespan, bound, proof and
time of each.

    python benchmarks/scheduling.py [--data FOLDER] [--seconds N] [--json FILE] [--only TEXT]

FOLDER (or CELLWRIGHT_DATA) has `jobshop/jobshop.json` and `slab/*`; without it only the laboratory
is scheduled. It is run as bundled, and with empty travel between its devices. Two constructive
rules run beside the scheduler: what the task planner's own order gives, and the first schedule
before any search. Exits with 1 when a bar is missed: optima of job shops and protocols proved
within 60 s; for 2 to 16 probes a first schedule within 1 s and a gap of at most 2 % after N (30)
seconds, up to 4 probes proved; the critical path with the durations as bundled.
"""

import argparse
import json
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

from cellwright.engine.formats.interop.shop_files import read_jobshop, read_slab
from cellwright.engine.model.outcome import Found
from cellwright.engine.model.plan_times import plan_makespan
from cellwright.engine.model.shop_scheduling import Shop, Timetable, ValidSchedule
from cellwright.engine.pipelines.planning.timetable import time_plan
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.planning import SearchLimits, plan_task
from cellwright.engine.stages.scheduling import ScheduleLimits, check_schedule, schedule_shop
from cellwright.kb.loader import bundled_domains, load_problem

JOB_SHOPS = {"ft06": 55, "ft10": 930, "ft20": 1165, "la01": 666, "la16": 945}
PROTOCOLS = {"Gu2016": 87, "qPCR": 148, "RNAseq": 973}
CRITICAL = {2: 2243, 4: 4119}
PROBES = (2, 4, 8, 16)
TRAVEL = """
near(D, U) :- part_of(D, U).  near(drawer, drawer).  near(flap, furnace).  near(lid, freezer).
way(drawer, furnace, 4).  way(furnace, freezer, 3).  way(drawer, freezer, 5).  way(V, U, T) :- way(U, V, T).
travel(A, B, T) :- near(A, U), near(B, V), way(U, V, T).
"""
STATICS = """
  travel(object, object, time): {}
  near(object, unit): {}
  way(unit, unit, time): {}
"""


@dataclass(frozen=True)
class Line:
    """One instance; `order` is the makespan in the planner's order, `first` that of the first
    schedule.
    """

    name: str
    makespan: int
    bound: int
    proved: bool
    seconds: float
    first_seconds: float
    first: int = 0
    order: int = 0
    faults: tuple[str, ...] = ()
    missed: str = ""


def limits(seconds: float) -> ScheduleLimits:
    """A limit in seconds, for a bar in seconds."""
    until = time.monotonic() + seconds
    return ScheduleLimits(work=1e6, interrupted=lambda: time.monotonic() > until)


def measured(name: str, shop: Shop, seconds: float, bar: Callable[[Line], str]) -> Line:
    """One shop, scheduled and replayed by the checker."""
    started = time.perf_counter()
    found = schedule_shop(shop, limits(seconds))
    took = time.perf_counter() - started
    if not isinstance(found, ValidSchedule):
        return Line(name, 0, 0, False, took, took, missed=found.reason)
    made, first = found.schedule, found.statistics
    line = Line(
        name,
        made.makespan,
        made.lower_bound,
        made.proved,
        took,
        first.seconds["first schedule"],
        first.counts["first makespan"],
        faults=check_schedule(shop, made),
    )
    return Line(**{**asdict(line), "missed": "; ".join(line.faults) or bar(line)})


def proves(optimum: int) -> Callable[[Line], str]:
    """The bar of instances whose optimum is known."""
    return lambda line: (
        "" if line.proved and line.makespan == optimum else f"not proved to be {optimum}"
    )


def files(data: Path) -> Iterator[tuple[str, Shop, int]]:
    """The instances of public collections."""
    for name, optimum in JOB_SHOPS.items():
        yield name, read_jobshop(data / "jobshop" / "jobshop.json", name), optimum
    for name, optimum in PROTOCOLS.items():
        yield name, read_slab(data / "slab" / name), optimum


def laboratory(folder: Path, travel: bool) -> Path:
    """A copy of the laboratory's domain, with empty travel if wanted."""
    home = folder / ("lab_travel" if travel else "lab")
    shutil.copytree(
        bundled_domains()["themse"], home, ignore=shutil.ignore_patterns("golden", "problems")
    )
    if travel:
        rules, domain = home / "rules.lp", home / "domain.yaml"
        rules.write_text(rules.read_text("utf-8") + TRAVEL, "utf-8")
        text = domain.read_text("utf-8").replace("\nstatics:", f"\nstatics:{STATICS.rstrip()}", 1)
        domain.write_text(text, "utf-8")
    (home / "problems").mkdir()
    return home


def probes(home: Path, count: int) -> Path:
    """The problem of so many probes, all to be heated, cooled and stored; furnace 1, freezer 2."""
    more = range(5, count + 1)
    lines = ["problem: probes", "domain: .."]
    lines += [f"objects:\n  probe: [probe_5..{count}]"] if more else []
    lines += ["statics:", "  - capacity(furnace, 1)", "  - capacity(freezer, 2)"]
    lines += [f"  - capacity(drawer, {max(4, count)})"]
    lines += [f"  - own_depot(probe_{n}, slot(drawer, {n}))" for n in more]
    lines += ["workflow:", f"  - for: {{P: [probe_1..{count}]}}"]
    lines += ["    stages: heated(P, 15 min), cooled(P, 5 min), stored(P)"]
    file = home / "problems" / f"probes_{count}.yaml"
    file.write_text("\n".join(lines) + "\n", "utf-8")
    return file


def probes_line(home: Path, count: int, seconds: float, travel: bool) -> Line:
    """The laboratory with some probes; what is timed is the scheduler, given the plan of the
    task planner.
    """
    problem = load_problem(str(probes(home, count)))
    task = ground(problem)
    found = plan_task(task, SearchLimits(improvement=0))
    assert isinstance(found, Found)
    started = time.perf_counter()
    made = time_plan(problem, task, found.plan, limits(seconds))
    assert isinstance(made, Timetable)
    took = time.perf_counter() - started
    missed = made.note or "; ".join(check_schedule(made.shop, made.schedule))
    if made.statistics.seconds["first schedule"] > 1:
        missed += " no schedule within 1 s"
    if made.schedule.gap > 0.02 or (count <= 4 and not made.schedule.proved):
        missed += " gap or proof"
    if not travel and made.schedule.makespan > CRITICAL.get(count, made.schedule.makespan):
        missed += f" more than {CRITICAL[count]}"
    return Line(
        f"{count} probes{', travel' if travel else ''}",
        made.schedule.makespan,
        made.schedule.lower_bound,
        made.schedule.proved,
        took,
        made.statistics.seconds["first schedule"],
        made.statistics.counts["first makespan"],
        plan_makespan(found.plan),
        missed=missed.strip(),
    )


def lines(data: Path | None, seconds: float, only: str) -> Iterator[Line]:
    """Every instance whose name has `only` in it."""
    for name, shop, optimum in files(data) if data else ():
        if only in name:
            yield measured(name, shop, 60, proves(optimum))
    with tempfile.TemporaryDirectory() as folder:
        for travel in (False, True):
            home = laboratory(Path(folder), travel)
            for count in PROBES:
                if only in f"{count} probes{', travel' if travel else ''}":
                    yield probes_line(home, count, seconds, travel)


def table(found: list[Line]) -> Table:
    """What was measured; ratios are to the schedule found."""
    made = Table(
        "instance",
        "makespan",
        "bound",
        "gap %",
        "proved",
        "s",
        "first s",
        "first /",
        "order /",
        "missed",
    )
    for line in found:
        least = max(1, line.makespan)
        gap = 100 * (line.makespan - line.bound) / least
        ratios = [f"{value / least:.3f}" if value else "" for value in (line.first, line.order)]
        times = [f"{line.seconds:.2f}", f"{line.first_seconds:.2f}"]
        proved = "yes" if line.proved else "no"
        made.add_row(
            line.name,
            str(line.makespan),
            str(line.bound),
            f"{gap:.2f}",
            proved,
            *times,
            *ratios,
            line.missed,
        )
    return made


def main() -> int:
    """Run, print, and say whether a bar was missed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=os.environ.get("CELLWRIGHT_DATA"))
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--only", default="")
    chosen = parser.parse_args()
    data = Path(chosen.data) if chosen.data else None
    found = list(lines(data, chosen.seconds, chosen.only))
    Console(width=130).print(table(found))
    if chosen.json:
        chosen.json.write_text(
            json.dumps([asdict(line) for line in found], indent=1) + "\n", "utf-8"
        )
    return 1 if any(line.missed for line in found) else 0


if __name__ == "__main__":
    sys.exit(main())
