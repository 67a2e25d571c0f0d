"""The constants of docs/scale.md: what a MACROP, a unit of work and a point cost, in seconds of the
processor and in bytes.

    python benchmarks/scale.py [--macrops N] [--copies N] [--json FILE]

`--macrops` are learned from days of measuring; `--copies` of them under other names fill a library
as a big one would be. A constant is the least of three rounds where it is short, because other work
on the machine makes it longer and never shorter.
"""

import argparse
import dataclasses
import json
import os
import sys
import tempfile
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

from macros import lessons
from points import cell, different_days

from cellwright.engine.kernels.cancellation import never
from cellwright.engine.pipelines.jobs import ResultLedger, WorkKind, WorkUnit
from cellwright.engine.pipelines.jobs.input_digests import content_digest
from cellwright.engine.pipelines.jobs.work_units import carry_out_unit
from cellwright.engine.pipelines.precompute import preparation_results
from cellwright.engine.pipelines.precompute.preparation_results import PreparedProblem
from cellwright.engine.stages.macros.lookup.macro_repertoire import Repertoire, macro_record
from cellwright.kb.store import Library, loads
from cellwright.kb.targets import find_target
from cellwright.kb.terms import Function

BATCH = 1_000


def spent(work: Callable[[], Any], rounds: int = 1) -> float:
    """The least seconds of the processor that a call takes."""
    found = []
    for _ in range(rounds):
        began = time.process_time()
        work()
        found.append(time.process_time() - began)
    return min(found)


def library(folder: Path, count: int, copies: int) -> dict[str, float]:
    """What MACROPs cost: learned, stored, on the disk, fetched into a process, and in its
    memory.
    """
    days = different_days(count, 14, 1)
    documents: list[str] = []
    found = {"learn a MACROP (ms)": 1e3 * spent(lambda: documents.extend(lessons(days))) / count}
    records = [macro_record(loads(text), 60.0) for text in documents]
    file = folder / "library.db"
    with Library(str(file)) as store:
        seconds = 0.0
        for first in range(0, copies, BATCH):
            some = []
            for number in range(first, min(first + BATCH, copies)):
                each = records[number % len(records)]
                made = dataclasses.replace(each.macrop, name=Function(f"copy_{number}"))
                some.append(dataclasses.replace(each, macrop=made))
            seconds += spent(lambda some=some: store.add(some))  # type: ignore[misc]
        found["store a MACROP (ms)"] = 1e3 * seconds / copies
        domain = cell(14).domain
        found["fetch the outline of a MACROP (ms)"] = (
            1e3 * spent(Repertoire(store, domain).load) / copies
        )
        tracemalloc.start()
        held = Repertoire(store, domain)
        held.load()
        found["outline of a MACROP in memory (bytes)"] = tracemalloc.get_traced_memory()[0] / copies
        tracemalloc.stop()
    found["MACROP on the disk (bytes)"] = (
        sum(each.stat().st_size for each in folder.glob("library.db*")) / copies
    )
    return found


def _nothing(_job: int, _interrupted: object) -> PreparedProblem:
    return PreparedProblem("p", "found")


def _lost(_job: int, why: str) -> PreparedProblem:
    return PreparedProblem("p", "gave up", reason=why, finished=False)


def units(folder: Path, count: int = 50) -> dict[str, float]:
    """What a unit of work costs beside the work."""
    target = find_target("themse/one")
    content_digest(target)
    ledger = ResultLedger(
        str(folder / "units.db"),
        preparation_results.is_prepared,
        preparation_results.prepared_entry,
        preparation_results.read_prepared,
    )
    kind = WorkKind("scale", _nothing, _lost, ledger)

    def noted() -> None:
        for number in range(count):
            carry_out_unit(kind, WorkUnit(f"{time.monotonic_ns()} {number}", "k", number), never)

    return {
        "digest of a problem and its cell (ms)": 1e3 * spent(lambda: content_digest(target), 5),
        "take a unit, and note it (ms)": 1e3 * spent(noted, 3) / count,
    }


def main() -> int:
    """Print the constants."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--macrops", type=int, default=300)
    parser.add_argument("--copies", type=int, default=20_000)
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        found = units(Path(name)) | library(Path(name), asked.macrops, asked.copies)
    found["load"] = os.getloadavg()[0]
    for what, value in found.items():
        print(f"| {what} | {value:.4g} |")
    if asked.json:
        asked.json.write_text(json.dumps(found, indent=1) + "\n", "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
