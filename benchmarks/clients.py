"""A hundred cells that share one library in PostgreSQL: how long lookups take, and whether an update is lost.

    python benchmarks/clients.py [--clients N] [--lookups N] [--every S] [--macrops N] [--points N] [--json FILE]

Each client is a process with connections of its own. Every `--every` seconds on average it looks up a day of measuring on other points
than it was learned with, and writes: it counts the use, counts a trial in a row that all share, adds a closed case, and moves a kept
sequence that all share one visit on (it reads it, changes it, and writes it if nobody else has; else again). Every tenth time it stores a
MACROP, too. The lookup is from the query to the plan, in seconds of the clock; the first one of a client, which fetches its part of the
library, is told apart. Exits with 1 if the 99th percentile is above 20 ms, or if anything is lost.
"""

import argparse
import dataclasses
import gc
import json
import os
import random
import statistics
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from macros import Bench, lessons
from points import Day, again, different_days
from postgres import server

from engine.stages.macros.lookup.query import query
from engine.stages.macros.lookup.repertoire import Repertoire, record_of
from kb.model.macro import Macrop
from kb.store import Library, loads
from kb.store.cases import Cases, ClosedCase
from kb.store.checking import checked
from kb.store.sequences import PlannedVisit, SequencePlan, Sequences
from kb.terms import Function

BAR_S, SEED, LEARNS = 0.020, 1, 10
SHARED = ("shared", "visits")


@dataclasses.dataclass
class Told:
    """What a client did: seconds of its lookups, those that found a plan, how often it wrote the shared sequence, and errors."""

    first_s: float = 0.0
    lookups_s: list[float] = dataclasses.field(default_factory=list)
    hits: int = 0
    moved: int = 0
    tries: int = 0
    learned: int = 0
    cases: int = 0
    error: str = ""


def client(url: str, bench: Bench, days: Sequence[Day], number: int, asked: argparse.Namespace) -> Told:
    """One client, until it has made its lookups."""
    gc.set_threshold(100_000)  # as the commands do
    draw, told = random.Random(f"{SEED} {number}"), Told()
    queries = [
        query(*bench.posed(again(draw.choice(days), draw, asked.points))) for _ in range(asked.lookups)
    ]
    gc.freeze()  # what the benchmark itself keeps in memory is none of lookup's concern
    with Library(url) as library, Sequences(url) as sequences, Cases(url) as cases:
        repertoire = Repertoire(library, bench.problem.domain)
        for turn, each in enumerate(queries):
            time.sleep(draw.expovariate(1.0 / asked.every))
            assert each is not None
            began = time.perf_counter()
            hit = repertoire.find(each)
            lasted = time.perf_counter() - began
            told.lookups_s += [lasted] if turn else []
            told.first_s = told.first_s or lasted
            told.hits += hit is not None
            repertoire.flush()
            library.note_trial(*SHARED, hit is not None)
            moved_on(sequences, told, f"{number}_{turn}")
            cases.add([ClosedCase("shared", "late", ("slow",), 1.0, ((f"c{number}", f"t{turn}"),))])
            told.cases += 1
            if hit is not None and turn % LEARNS == 0:
                told.learned += library.add([record_of(renamed(hit.macrop, number, turn))])[0] is not None
    return told


def renamed(macrop: Macrop, number: int, turn: int) -> Macrop:
    """A MACROP that nobody else stores."""
    return dataclasses.replace(macrop, domain="another", name=Function(f"own_{number}_{turn}"))


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
def shared(documents: Sequence[str], clients: int) -> Iterator[str]:
    """A library in PostgreSQL with MACROPs, for so many clients."""
    with server(f"-c fsync=off -c max_connections={4 * clients + 20}") as base:
        with Library(base.url) as library:
            library.add([record_of(loads(text), 60.0) for text in documents])
        yield base.url


def warmed(library: Library, bench: Bench, days: Sequence[Day]) -> None:
    """Look up one day before the clients are forked, so that each has its cell in memory as one that has run for a while."""
    asked = query(*bench.posed(again(days[0], random.Random(SEED), len(bench.problem.objects))))
    assert asked is not None
    Repertoire(library, bench.problem.domain).find(asked)


def lost(url: str, told: Sequence[Told], before: int) -> list[str]:
    """What the library should hold and does not."""
    with Library(url) as library, Sequences(url) as sequences, Cases(url) as cases:
        figures, plan = library.figures(), sequences.of(*SHARED)
        successes, failures = library.trials(*SHARED)
        history = len(cases.history("shared"))
    hits, lookups = sum(each.hits for each in told), sum(each.cases for each in told)
    moved = sum(each.moved for each in told)
    rows = {
        "uses": (figures.uses, hits),
        "trials": (successes + failures, lookups),
        "trials that succeeded": (successes, hits),
        "visits": (len({each.name for each in plan.done}) if plan else 0, moved),
        "versions": (plan.version if plan else 0, moved),
        "cases": (history, lookups),
        "MACROPs": (figures.macrops, before + sum(each.learned for each in told)),
    }
    wrong = [f"{name}: {there} for {wanted}" for name, (there, wanted) in rows.items() if there != wanted]
    return [*wrong, *(each.message for each in checked(url)[0]), *(each.error for each in told if each.error)]


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--clients", type=int, default=100)
    parser.add_argument("--lookups", type=int, default=30)
    parser.add_argument("--every", type=float, default=10.0)
    parser.add_argument("--macrops", type=int, default=300)
    parser.add_argument("--points", type=int, default=60)
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    days = different_days(asked.macrops, 14, SEED)
    documents, bench = lessons(days), Bench.of(asked.points)
    load = os.getloadavg()[0]
    with shared(documents, asked.clients) as url:
        with Library(url) as library:
            before = library.figures().macrops
            warmed(library, bench, days)
        began, spent = time.monotonic(), os.times()
        told = list(heard(asked.clients, lambda number: client(url, bench, days, number, asked)))
        seconds, after = time.monotonic() - began, os.times()
        wrong = lost(url, told, before)
    times = sorted(each for one in told for each in one.lookups_s)
    row = {
        "clients": asked.clients,
        "MACROPs": before,
        "lookups": len(times),
        "found": sum(each.hits for each in told),
        "a second": round(len(times) / seconds, 1),
        "median_ms": round(1000 * statistics.median(times), 2),
        "p99_ms": round(1000 * times[int(len(times) * 0.99)], 2),
        "max_ms": round(1000 * times[-1], 2),
        "first_ms": round(1000 * statistics.median(each.first_s for each in told), 1),
        "shared sequence written": sum(each.moved for each in told),
        "of so many tries": sum(each.tries for each in told),
        "learned": sum(each.learned for each in told),
        "processor_s": round(after.children_user + after.children_system - spent.children_user, 1),
        "load before": round(load, 1),
        "wrong": wrong,
    }
    print(json.dumps(row))
    if asked.json:
        asked.json.write_text(json.dumps(row, indent=1) + "\n", "utf-8")
    return int(bool(wrong) or row["p99_ms"] > 1000 * BAR_S)


if __name__ == "__main__":
    sys.exit(main())
