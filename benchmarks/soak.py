"""A soak: plans, lookups, runs with faults, resumes and readers for a long time, one after another.

    python benchmarks/soak.py [--minutes M] [--database sqlite|postgresql] [--processes N]
        [--json FILE]

One process does everything itself; so many further ones do the same beside it, all with one
database. After each round a process notes its memory, descriptors, threads and the time of the
round; the parent notes the size of the database. Half of the rounds count as warm-up. Then memory
may grow by 5 %, no descriptor and no thread may be left over, and the median round may take half
as long again at most as at the beginning. Exits with 1 if that is not so, or if an answer is wrong.
"""

import argparse
import gc
import json
import os
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import asdict, dataclass
from pathlib import Path

from postgres import served

import cellwright
from cellwright.engine.faces.monitor.run_follower import RunFollower
from cellwright.engine.model.run_protocol import OperatorCommand
from cellwright.engine.pipelines.execution import (
    GivenOrder,
    RunRequest,
    TimedOrders,
    begin_run,
    list_run,
    results_of,
    resume_run,
)
from cellwright.engine.pipelines.planning.checked_plan import problem_of

TARGETS = ("themse/one", "bulkhead/one_point")
FAULTS = ("pick=not_gripped", "", "pick#2=not_gripped")
STOP_MS = 60_000  # of the run's clock: then it is stopped, and taken up again
MAX_GROWTH = 1.05  # of memory
MAX_SLOWDOWN = 1.5
LEFT_OVER = 2  # descriptors or threads that may come and go
MIN_ROUNDS = 8  # fewer say nothing of growth
PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")


@dataclass(frozen=True)
class Measure:
    """How a process stands after a round."""

    seconds: float
    memory: int
    descriptors: int
    threads: int


def measured(seconds: float) -> Measure:
    """How this process stands."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text("ascii").split()[1])
    descriptors = len(os.listdir("/proc/self/fd"))
    return Measure(seconds, pages * PAGE_BYTES, descriptors, threading.active_count())


def do_round(number: int, store: str, folder: Path) -> None:
    """Plan, look up, run with a fault, stop, take up again, and read. Raises if an answer is
    wrong.
    """
    for target in TARGETS:
        for kept in ("", store):
            planned = cellwright.plan(target, store=kept)
            assert planned.plan is not None, f"no plan for {target}"
    assert cellwright.plan("themse/unsolvable").plan is None
    target, fault = TARGETS[0], FAULTS[number % len(FAULTS)]
    name = f"soak-{os.getpid()}-{number}"
    options = {"log": str(folder / f"{name}.log")} | ({"fault": fault} if fault else {})
    problem = problem_of(target)
    request = RunRequest(target, store=store, run=name, options=options)
    stop = TimedOrders([(STOP_MS, GivenOrder(OperatorCommand.STOP))])
    with list_run(request, problem) as named_request:
        stopped = begin_run(named_request, problem, stop)
    assert getattr(stopped, "outcome", "") == "stopped", stopped
    ending = resume_run(store, name, TimedOrders())
    assert ending.outcome == "reached", ending
    assert results_of(store, name).history
    follower = RunFollower(store, name)
    assert follower.refresh() > 0
    follower.close()
    Path(options["log"]).unlink(missing_ok=True)


def soak(minutes: float, store: str) -> list[Measure]:
    """Round after round until the time is over; how the process stood after each."""
    measures, end = list[Measure](), time.monotonic() + 60 * minutes
    with tempfile.TemporaryDirectory() as folder:
        while time.monotonic() < end:
            began = time.monotonic()
            do_round(len(measures), store, Path(folder))
            measures.append(measured(time.monotonic() - began))
    return measures


def findings(measures: list[Measure]) -> Iterator[str]:
    """What has grown or slowed down."""
    if len(measures) < MIN_ROUNDS:
        yield f"only {len(measures)} rounds: too few to tell"
        return
    half = len(measures) // 2
    first, last = measures[half : half + max(1, half // 4)], measures[-max(1, half // 4) :]
    growth = statistics.median(m.memory for m in last) / statistics.median(m.memory for m in first)
    if growth > MAX_GROWTH:
        yield f"memory has grown to {growth:.3f} times"
    for name in ("descriptors", "threads"):
        more = min(getattr(m, name) for m in last) - max(getattr(m, name) for m in first)
        if more > LEFT_OVER:
            yield f"{more} more {name}"
    early = statistics.median(m.seconds for m in measures[1 : max(2, half // 2)])
    late = statistics.median(m.seconds for m in last)
    if late > MAX_SLOWDOWN * early:
        yield f"a round takes {late:.2f} s, and took {early:.2f} s"


def story(measures: list[Measure]) -> str:
    """How a process stood at the end."""
    last, half = measures[-1], measures[len(measures) // 2]
    return (
        f"{len(measures)} rounds, {last.memory / 2**20:.0f} MiB (half-way "
        f"{half.memory / 2**20:.0f}), {last.descriptors} descriptors ({half.descriptors}), "
        f"{last.threads} threads ({half.threads}), a round {last.seconds:.2f} s "
        f"({half.seconds:.2f})"
    )


@contextmanager
def companions(minutes: float, store: str, many: int) -> Iterator[list["subprocess.Popen[str]"]]:
    """Further processes that do the same."""
    command = [sys.executable, __file__, "--minutes", str(minutes), "--store", store]
    running = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(many)]
    try:
        yield running
    finally:
        for process in running:
            process.kill()
            process.wait()


def main() -> int:
    """Soak, and tell what has grown."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--minutes", type=float, default=10)
    parser.add_argument("--database", choices=("sqlite", "postgresql"), default="sqlite")
    parser.add_argument("--processes", type=int, default=2, help="beside this one")
    parser.add_argument("--json", type=Path, help="where all measures are written")
    parser.add_argument("--store", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.store:
        print(json.dumps([asdict(m) for m in soak(asked.minutes, asked.store)]))
        return 0
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        file = Path(name) / "j.db"
        database = served() if asked.database == "postgresql" else nullcontext(str(file))
        with database as store, companions(asked.minutes, store, asked.processes) as others:
            all_measures = [soak(asked.minutes, store)]
            told = [process.communicate()[0] for process in others]
            all_measures += [[Measure(**m) for m in json.loads(text or "[]")] for text in told]
        size = sum(path.stat().st_size for path in Path(name).glob("j.db*") if path.is_file())
    wrong = 0
    for number, measures in enumerate(all_measures):
        said = list(findings(measures))
        wrong += len(said)
        print(f"process {number}: {story(measures) if measures else 'no answer'}")
        print("".join(f"  {finding}\n" for finding in said), end="")
    rounds = sum(map(len, all_measures))
    print(f"{asked.database}: {rounds} rounds in {asked.minutes:g} min, {wrong} findings", end="")
    print(f"; files of {size / 2**20:.1f} MiB" if size else "")
    if asked.json is not None:
        data = [[asdict(m) for m in measures] for measures in all_measures]
        asked.json.write_text(json.dumps(data), "utf-8")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
