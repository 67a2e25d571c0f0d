"""A hundred cells that share one library in PostgreSQL: how long lookups take, and whether an
update is lost.

    python benchmarks/clients.py [--clients N] [--seconds S] [--every S] [--macrops N] [--points N]
        [--warm N]
        [--first] [--json FILE]

Each client is a process with connections of its own. It looks up as `cellwright.plan` does in a
program that plans again and again: the library stays open and is read ahead
(`cellwright.engine.pipelines.planning.macros.library_planner`), and Python looks for cycles of
references when it wants to. After `--warm` days it has in memory what a cell has that has run for a
while. When all have done so, they begin, and go on for `--seconds`. Every `--every` seconds on
average a client looks up a day of measuring on other points than it was learned with, and writes:
it counts the use, counts a trial in a row that all share, adds a closed case, and moves a kept
sequence that all share one visit on (it reads it, changes it, and writes it if nobody else has;
else again). In its first turn, and every tenth, it stores a MACROP, too.

A lookup is from the problem to a plan that the checker has accepted, in seconds of the clock: with
the question whether the library still holds what was read. A turn is all of this call: with the use
that is counted, too. The turns of the beginning are told apart. What share of the processors worked
meanwhile, for whatever, is told as well. With `--first` clients and server come before all other
work of the machine while they count, for machines that are never idle: then nothing but caches and
memory is shared with others. Exits with 1 if the 99th percentile of the turns is above 20 ms, or if
anything is lost.
"""

import argparse
import dataclasses
import gc
import itertools
import json
import math
import multiprocessing
import os
import random
import statistics
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from machine import busy_s, come_first
from macros import Bench, lessons
from points import Day, again, different_days
from postgres import Server, server

from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.planning.macros.library_planner import open_planner
from cellwright.engine.stages.macros.lookup.macro_repertoire import macro_record
from cellwright.engine.stages.planning import SearchLimits
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.store import Library, loads
from cellwright.kb.store.case_store import Cases, ClosedCase
from cellwright.kb.store.inspection_store import PlannedVisit, SequencePlan, Sequences
from cellwright.kb.store.store_maintenance import check_library
from cellwright.kb.terms import Function

BAR_S, SEED, LEARNS = 0.020, 1, 10
WAIT_S = 600.0  # for the last client to begin
SHARED = ("shared", "visits")


@dataclasses.dataclass
class Told:
    """What a client did.

    Seconds of its first turn, of the others at the beginning and of those that count, of these also
    to the plan, and of the lookup alone in it; how many of all and of those that count found a
    plan; when they began and ended; how much the processors worked meanwhile, for it and for all;
    how often it wrote; and errors.
    """

    first_s: float = 0.0
    warm_s: list[float] = dataclasses.field(default_factory=list)
    turns_s: list[float] = dataclasses.field(default_factory=list)
    plans_s: list[float] = dataclasses.field(default_factory=list)
    lookups_s: list[float] = dataclasses.field(default_factory=list)
    uses: int = 0
    hits: int = 0
    since: float = 0.0
    until: float = 0.0
    processor_s: float = 0.0
    busy_s: float = 0.0
    moved: int = 0
    tries: int = 0
    learned: int = 0
    cases: int = 0
    error: str = ""


@dataclasses.dataclass
class Client:
    """A cell with its connections, and what it has done so far."""

    number: int
    asked: argparse.Namespace
    url: str
    problems: Iterator[Problem]
    library: Library
    sequences: Sequences
    cases: Cases
    draw: random.Random
    told: Told = dataclasses.field(default_factory=Told)

    def warm_up(self) -> None:
        """Look up some days; meanwhile the library is read."""
        times = [self._found(next(self.problems))[1] for _ in range(self.asked.warm)]
        self.told.first_s, self.told.warm_s = times[0] if times else 0.0, times[1:]

    def work(self) -> None:
        """Look days up, from time to time, and write after each."""
        self.told.lookups_s.clear()
        self.told.since, spent, busy = time.monotonic(), time.process_time(), busy_s()
        end = self.told.since + self.asked.seconds
        while self._paused(end):
            problem = next(self.problems)
            plan_s, turn_s, found = self._found(problem)
            self.told.plans_s.append(plan_s)
            self.told.turns_s.append(turn_s)
            self.told.hits += found is not None
            self._write(len(self.told.turns_s) - 1, found)
        self.told.until, self.told.processor_s = time.monotonic(), time.process_time() - spent
        self.told.busy_s = busy_s() - busy

    def _paused(self, end: float) -> bool:
        """Wait for the next day, or for the end; whether it is not over."""
        pause = self.draw.expovariate(1.0 / self.asked.every)
        time.sleep(min(pause, max(0.0, end - time.monotonic())))
        return time.monotonic() < end

    def _found(self, problem: Problem) -> tuple[float, float, int | None]:
        """Seconds to the plan and to the end of the turn, and the number of the MACROP that
        gave the plan.
        """
        began = time.perf_counter()
        # its end counts the use
        with open_planner(self.url, problem.domain, SearchLimits()) as practice:
            answer = practice.plan(problem)
            plan_s = time.perf_counter() - began
        turn_s = time.perf_counter() - began
        if isinstance(answer.outcome, Found) and "lookup" in answer.outcome.statistics.seconds:
            self.told.lookups_s.append(answer.outcome.statistics.seconds["lookup"])
        found = answer.macrop if answer.origin == "library" else None
        self.told.uses += found is not None
        return plan_s, turn_s, found

    def _write(self, turn: int, found: int | None) -> None:
        self.library.note_trial(*SHARED, found is not None)
        moved_on(self.sequences, self.told, f"{self.number}_{turn}")
        told = ((f"c{self.number}", f"t{turn}"),)
        self.cases.add([ClosedCase("shared", "late", ("slow",), 1.0, told)])
        self.told.cases += 1
        macrop = self.library.macrop(found) if found is not None and turn % LEARNS == 0 else None
        if macrop is not None:
            name = Function(f"own_{self.number}_{turn}")  # a MACROP that nobody else stores
            own = macro_record(dataclasses.replace(macrop, domain="another", name=name))
            self.told.learned += self.library.add([own])[0] is not None


def client(
    url: str,
    bench: Bench,
    days: Sequence[Day],
    number: int,
    asked: argparse.Namespace,
    ready: Callable[[], object],
) -> Told:
    """One client, until its time is over.

    It calls `ready` before the turns that count, and goes on when all have.
    """
    gc.freeze()  # what the benchmark itself keeps in memory is none of lookup's concern
    draw = random.Random(f"{SEED} {number}")
    problems = (
        bench.posed(again(draw.choice(days), draw, asked.points))[0] for _ in itertools.count()
    )
    with Library(url) as library, Sequences(url) as sequences, Cases(url) as cases:
        one = Client(number, asked, url, problems, library, sequences, cases, draw)
        one.warm_up()
        ready()
        one.work()
    return one.told


def moved_on(sequences: Sequences, told: Told, name: str) -> None:
    """Add a visit to the sequence that all share."""
    while True:
        told.tries += 1
        kept = sequences.of(*SHARED) or SequencePlan(*SHARED)
        visit = PlannedVisit(name, "probe", (0.0, 0.0))
        if sequences.keep(dataclasses.replace(kept, done=(*kept.done, visit))):
            told.moved += 1
            return


def heard(count: int, work: Any) -> Iterator[Told]:
    """What so many processes tell, each forked with its number."""
    ends = []
    for number in range(count):
        hear, tell = os.pipe()
        if os.fork() == 0:
            try:
                found = work(number)
            except BaseException as error:
                found = Told(error=f"{type(error).__name__}: {str(error)[:200]}")
            with os.fdopen(tell, "w") as file:
                json.dump(dataclasses.asdict(found), file)
            os._exit(0)
        os.close(tell)
        ends.append(hear)
    for hear in ends:
        with os.fdopen(hear) as file:
            yield Told(**json.load(file))
    for _ in ends:
        os.wait()


@contextmanager
def shared(documents: Sequence[str], clients: int) -> Iterator[Server]:
    """A library in PostgreSQL with MACROPs, for so many clients."""
    with server(f"-c fsync=off -c max_connections={4 * clients + 20}") as base:
        with Library(base.url) as library:
            library.add([macro_record(loads(text), 60.0) for text in documents])
        yield base


def lost(url: str, told: Sequence[Told], before: int) -> list[str]:
    """What the library should hold and does not."""
    with Library(url) as library, Sequences(url) as sequences, Cases(url) as cases:
        figures, plan = library.figures(), sequences.of(*SHARED)
        successes, failures = library.trials(*SHARED)
        history = len(cases.history("shared"))
    uses, hits = sum(each.uses for each in told), sum(each.hits for each in told)
    lookups = sum(each.cases for each in told)
    moved = sum(each.moved for each in told)
    rows = {
        "uses": (figures.uses, uses),
        "trials": (successes + failures, lookups),
        "trials that succeeded": (successes, hits),
        "visits": (len({each.name for each in plan.done}) if plan else 0, moved),
        "versions": (plan.version if plan else 0, moved),
        "cases": (history, lookups),
        "MACROPs": (figures.macrops, before + sum(each.learned for each in told)),
    }
    wrong = [
        f"{name}: {there} for {wanted}" for name, (there, wanted) in rows.items() if there != wanted
    ]
    return [
        *wrong,
        *(each.message for each in check_library(url)[0]),
        *(each.error for each in told if each.error),
    ]


def spread(seconds: Iterable[float]) -> list[float]:
    """Median, 90 %, 99 % and the greatest, in milliseconds."""
    times = sorted(seconds) or [math.inf]
    return [
        round(1000 * times[min(int(len(times) * p), len(times) - 1)], 2)
        for p in (0.5, 0.9, 0.99, 1)
    ]


def summed(told: Sequence[Told]) -> dict[str, Any]:
    """The figures of all clients.

    Processor seconds are those of the clients after the beginning, without the server's.
    """
    times = sorted(each for one in told for each in one.turns_s) or [math.inf]
    warm = sorted(each for one in told for each in one.warm_s) or [0.0]
    seconds = max(each.until for each in told) - min(each.since for each in told)
    return {
        "lookups": len(times),
        "found": sum(each.hits for each in told),
        "a second": round(len(times) / max(seconds, 1e-9), 1),
        "median_ms": round(1000 * statistics.median(times), 2),
        "p90_ms": round(1000 * times[int(len(times) * 0.90)], 2),
        "p99_ms": round(1000 * times[int(len(times) * 0.99)], 2),
        "max_ms": round(1000 * times[-1], 2),
        "to the plan: median, p90, p99, max_ms": spread(
            each for one in told for each in one.plans_s
        ),
        "lookup alone: median, p90, p99, max_ms": spread(
            each for one in told for each in one.lookups_s
        ),
        "first_ms": round(1000 * statistics.median(each.first_s for each in told), 1),
        "others of the beginning, median_ms": round(1000 * statistics.median(warm), 1),
        "shared sequence written": sum(each.moved for each in told),
        "of so many tries": sum(each.tries for each in told),
        "learned": sum(each.learned for each in told),
        "share of the processors": round(
            statistics.median(
                each.busy_s / max(each.until - each.since, 1e-9) / (os.cpu_count() or 1)
                for each in told
            ),
            2,
        ),
        "processor_s": round(sum(each.processor_s for each in told), 1),
    }


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--clients", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=90.0)
    parser.add_argument("--every", type=float, default=10.0)
    parser.add_argument("--macrops", type=int, default=300)
    parser.add_argument("--points", type=int, default=60)
    parser.add_argument("--warm", type=int, default=20)
    parser.add_argument("--first", action="store_true")
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    days = different_days(asked.macrops, 14, SEED)
    documents, bench = lessons(days), Bench.of(asked.points)
    load, began = os.getloadavg()[0], time.monotonic()
    with shared(documents, asked.clients) as base:
        url, first = base.url, partial(come_first, (os.getpid(), base.process))
        with Library(url) as library:
            before = library.figures().macrops
        all_ready = multiprocessing.Barrier(asked.clients, first if asked.first else None, WAIT_S)
        told = list(
            heard(asked.clients, lambda n: client(url, bench, days, n, asked, all_ready.wait))
        )
        wrong = lost(url, told, before)
    row = {
        "clients": asked.clients,
        "MACROPs": before,
        **summed(told),
        "load before": round(load, 1),
    }
    row["whole_s"] = round(time.monotonic() - began, 1)
    row["wrong"] = wrong
    print(json.dumps(row))
    if asked.json:
        asked.json.write_text(json.dumps(row, indent=1) + "\n", "utf-8")
    return int(bool(wrong) or row["p99_ms"] > 1000 * BAR_S)


if __name__ == "__main__":
    sys.exit(main())
