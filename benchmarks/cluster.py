"""Preparation by a cluster: how much sooner two workers are done than one, and what kills leave.

    python benchmarks/cluster.py [--table speed mishaps] [--problems N] [--pairs N] [--kills N]
        [--victim NAME ...] [--seed N] [--json FILE]

Each problem has a cell of its own (a copy of `themse`), so that none serves another and the store
does not depend on who is first. `speed`: the problems are prepared with one process, with two, and
by a cluster with two workers, in turns; seconds of the clock, and of the processor, because other
work on the machine slows two processes more than one; so what that took of the processor is told,
too. `mishaps`: a worker, the scheduler, the command or the database is killed at a random moment;
what was killed is started again, and the command, until it has finished. Then the store must be the
one of an undisturbed preparation, counts too, and no unit that was noted as finished may have been
carried out again (its MACROP would count a use). With `--json` what was tried is kept there, and
the next call goes on behind it. Exits with 1 if two are less than 1.8 times as fast as one, or if a
store differs.
"""

import argparse
import ctypes
import json
import os
import random
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cluster_mishaps import VICTIMS, Trial, tried
from clusters import Cluster
from machine import busy_s
from postgres import PROGRAMS, Server, server
from store_content import knowledge

ROOT = Path(__file__).parents[1]
BAR = 1.8
PR_SET_CHILD_SUBREAPER = 36
COMMAND = "from cellwright.engine.faces.cli import main; main()"


def problems(folder: Path, count: int, name: str) -> Path:
    """A folder with so many problems, each in a cell of its own."""
    chosen = folder / "set"
    chosen.mkdir(exist_ok=True)
    source = ROOT / "domains" / "themse"
    for number in range(1, count + 1):
        cell = folder / "cells" / f"themse_{number:03}"
        shutil.copytree(
            source, cell, ignore=shutil.ignore_patterns("problems", "golden", "__pycache__")
        )
        own = cell / "domain.yaml"
        own.write_text(
            own.read_text("utf-8").replace("domain: themse", f"domain: {cell.name}", 1), "utf-8"
        )
        text = (source / "problems" / f"{name}.yaml").read_text("utf-8")
        text = text.replace(f"problem: {name}", f"problem: {name}_{number:03}")
        text = text.replace("domain: themse", f"domain: {own}")
        (chosen / f"p{number:03}.yaml").write_text(text, "utf-8")
    return chosen


@dataclass
class Tally:
    """What was measured so far, in a file if there is one."""

    file: Path | None
    content: dict[str, list[Any]] = field(default_factory=lambda: {"speed": [], "mishaps": []})

    def __post_init__(self) -> None:
        if self.file is not None and self.file.is_file():
            self.content |= json.loads(self.file.read_text("utf-8"))

    def note(self, table: str, row: Any) -> None:
        """Keep a row."""
        self.content[table].append(row)
        if self.file is not None:
            self.file.write_text(json.dumps(self.content, indent=1) + "\n", "utf-8")


def prepared(chosen: Path, store: Path, *how: str) -> tuple[float, float, float]:
    """Seconds of the clock and of the processor that a preparation takes into a new store, and
    of the processor that others took.
    """
    for each in store.parent.glob(f"{store.name}*"):
        each.unlink()
    hear, tell = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            command = ("prepare", str(chosen), "--store", str(store), *how)
            os.write(tell, json.dumps(_spent(store.parent / "compiled", *command)).encode())
        finally:
            os._exit(0)
    os.close(tell)
    before = busy_s()
    with os.fdopen(hear) as file:
        clock, spent = json.load(file)
    os.waitpid(child, 0)
    return clock, spent, max(0.0, busy_s() - before - spent)


def _spent(compiled: Path, *command: str) -> tuple[float, float]:
    """Seconds of the clock until a command has ended, and of the processor, with all processes that
    it leaves for a moment.

    Modules are compiled to a folder, as those of an installed program are: else each process would
    compile all of them.
    """
    own = {
        "PYTHONPATH": str(ROOT),
        "PYTHONDONTWRITEBYTECODE": "",
        "PYTHONPYCACHEPREFIX": str(compiled),
    }
    ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    began = time.monotonic()
    subprocess.run(
        [sys.executable, "-c", COMMAND, *command],
        check=True,
        stdout=subprocess.DEVNULL,
        env={**os.environ, **own},
    )
    clock = time.monotonic() - began
    with suppress(ChildProcessError):
        while True:
            os.wait()
    after = os.times()
    return clock, after.children_user + after.children_system


def speed(asked: argparse.Namespace, tally: Tally) -> bool:
    """The table of speeds; whether the bar is met."""
    with tempfile.TemporaryDirectory() as name, Cluster.started(ROOT, 2) as cluster:
        folder = Path(name)
        chosen = problems(folder, asked.problems, "four")
        prepared(chosen / "p001.yaml", folder / "speed.db", "--jobs", "2")  # compiles the modules
        ways = {
            "one": ("--jobs", "1"),
            "two": ("--jobs", "2"),
            "cluster": ("--cluster", cluster.address),
        }
        while len(tally.content["speed"]) < asked.pairs:
            row = {"problems": asked.problems, "load": os.getloadavg()[0]}
            found = {way: prepared(chosen, folder / "speed.db", *how) for way, how in ways.items()}
            names = ("clock_s", "processor_s", "others_s")
            row |= {way: dict(zip(names, times, strict=True)) for way, times in found.items()}
            tally.note("speed", row)
    rows = tally.content["speed"]
    print(
        "| problems | load | one (s, s of the processor, of others) | two | times as fast | "
        "cluster of two | times as fast |"
    )
    print("|--:|--:|--:|--:|--:|--:|--:|")
    for row in rows:
        one, two, by = row["one"], row["two"], row["cluster"]
        print(
            f"| {row['problems']} | {row['load']:.1f} | {_told(one)} "
            f"| {_told(two)} | {one['clock_s'] / two['clock_s']:.2f} "
            f"| {by['clock_s']:.1f} | {one['clock_s'] / by['clock_s']:.2f} |"
        )
    gain = statistics.median(row["one"]["clock_s"] / row["two"]["clock_s"] for row in rows)
    print(f"median gain of two processes {gain:.2f}, bar {BAR}")
    return gain >= BAR


def _told(way: dict[str, float]) -> str:
    return f"{way['clock_s']:.1f}, {way['processor_s']:.1f}, {way['others_s']:.1f}"


@contextmanager
def database(victim: str) -> Iterator[Server | None]:
    """A server of PostgreSQL if that is what is killed."""
    if victim != "database":
        yield None
        return
    with server() as made:
        yield made


def mishaps(asked: argparse.Namespace, tally: Tally) -> bool:
    """The table of kills; whether all stores are as they should be."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        paths = sorted(problems(folder, asked.units, "lid_on_stand").glob("*.yaml"))
        Trial(paths, str(folder / "reference.db")).undisturbed()
        wanted = knowledge(str(folder / "reference.db"))
        for victim in asked.victim:
            done = sum(row["victim"] == victim for row in tally.content["mishaps"])
            with database(victim) as base, Cluster.started(ROOT, 2) as cluster:
                for number in range(done, asked.kills):
                    chance = random.Random(f"{asked.seed} {victim} {number}")
                    store = base.url if base else str(folder / f"{victim}{number}.db")
                    row = tried(Trial(paths, store), victim, cluster, base, chance, wanted)
                    tally.note("mishaps", row)
                    print(json.dumps(row), file=sys.stderr, flush=True)
    rows = [row for row in tally.content["mishaps"] if row["victim"] in asked.victim]
    print(
        "| killed | times | while it worked | units noted by then | other units begun again | "
        "calls | wrong |"
    )
    print("|---|--:|--:|--:|--:|--:|--:|")
    for victim in asked.victim:
        own = [row for row in rows if row["victim"] == victim]
        early = sum(row["working"] for row in own)
        kept, calls = (
            sum(row["noted"] for row in own),
            max((row["calls"] for row in own), default=0),
        )
        again, wrong = sum(row["again"] for row in own), sum(bool(row["wrong"]) for row in own)
        print(f"| {victim} | {len(own)} | {early} | {kept} | {again} | at most {calls} | {wrong} |")
    return not any(row["wrong"] for row in rows)


def main() -> int:
    """Print the tables; 1 if a bar is missed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--table", nargs="+", choices=("speed", "mishaps"), default=["speed", "mishaps"]
    )
    parser.add_argument("--problems", type=int, default=64)
    parser.add_argument("--pairs", type=int, default=3)
    parser.add_argument(
        "--units", type=int, default=6, help="problems of each trial of the mishaps"
    )
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--victim", nargs="+", choices=VICTIMS, default=list(VICTIMS))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    if not PROGRAMS and "database" in asked.victim:
        asked.victim.remove("database")
        print("PostgreSQL is not installed: the database is not killed", file=sys.stderr)
    tally, fine = Tally(asked.json), True
    with suppress(KeyboardInterrupt):
        signal.signal(signal.SIGTERM, signal.default_int_handler)
        fine = ("speed" not in asked.table or speed(asked, tally)) and fine
        fine = ("mishaps" not in asked.table or mishaps(asked, tally)) and fine
        return 0 if fine else 1
    return 130


if __name__ == "__main__":
    sys.exit(main())
