"""Preparations that are disturbed by kills, and what their stores hold in the end."""

import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from clusters import Cluster
from postgres import Server, emptied
from store_content import knowledge, rows

from cellwright.engine.pipelines.jobs import WorkCrew, crew_of
from cellwright.engine.pipelines.precompute import prepare_problems
from cellwright.engine.stages.planning import SearchLimits
from cellwright.kb.diagnostics import InvalidInput

VICTIMS = ("worker", "scheduler", "client", "database")
CALLS = 8  # that may be needed at most until all is done


@dataclass(frozen=True)
class Trial:
    """A preparation into a store."""

    paths: Sequence[Path]
    store: str

    def undisturbed(self) -> None:
        """The preparation by one process."""
        self._prepared(crew_of(1))

    def _prepared(self, crew: WorkCrew) -> bool:
        """Whether all was finished in this call."""
        found = prepare_problems(self.paths, self.store, SearchLimits(1_000_000), crew)
        return len(found.problems) == len(self.paths) and all(
            each.status == "found" for each in found.problems
        )

    def call(self, address: str) -> int:
        """Call the preparation by a cluster in a process of its own, which ends with 0 if all
        was finished.
        """
        child = os.fork()
        if child:
            return child
        code = 1
        try:
            os.setsid()
            code = 0 if self._prepared(crew_of(0, address)) else 3
        except InvalidInput as error:
            sys.stderr.write(f"{error.diagnostics[0].message}\n")
            code = 2
        finally:
            os._exit(code)


def tried(
    trial: Trial,
    victim: str,
    cluster: Cluster,
    base: Server | None,
    chance: random.Random,
    wanted: dict[str, Any],
) -> dict[str, Any]:
    """Kill a victim once while a preparation runs; what was finished by then, and what is wrong
    at the end.
    """
    if base:
        emptied(base.url)
    child, began = trial.call(cluster.address), time.monotonic()
    _wait(child, chance.uniform(0.0, 1.0), trial, chance.randrange(len(trial.paths)))
    working = os.waitpid(child, os.WNOHANG)[0] == 0
    _kill(victim, child if working else 0, cluster, base, chance)
    code = _ended(child) if working else 0
    moment, calls = round(time.monotonic() - began, 2), 1
    cluster.start()
    noted = _noted(trial.store)
    while code and calls < CALLS:
        calls += 1
        code = _ended(trial.call(cluster.address))
    again = _used(trial.store)
    wrong = [f"exit {code}"] if code else _differences(wanted, knowledge(trial.store))
    wrong += (
        [f"{len(noted & again)} units that were noted were carried out again"]
        if noted & again
        else []
    )
    return {
        "victim": victim,
        "working": working,
        "moment_s": moment,
        "noted": len(noted),
        "again": len(again - noted),
        "calls": calls,
        "wrong": "; ".join(wrong),
    }


def _wait(child: int, seconds: float, trial: Trial, units: int) -> None:
    """Wait until so many units are finished, and a while longer; not beyond the end of the
    process.
    """
    deadline = time.monotonic() + 60
    while (
        units and time.monotonic() < deadline and len(_noted(trial.store)) < units and _runs(child)
    ):
        time.sleep(0.02)
    until = time.monotonic() + seconds
    while time.monotonic() < until and _runs(child):
        time.sleep(0.02)


def _runs(child: int) -> bool:
    with suppress(OSError):
        return Path(f"/proc/{child}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    return False


def _kill(
    victim: str, child: int, cluster: Cluster, base: Server | None, chance: random.Random
) -> None:
    if victim == "client":
        if child:
            os.kill(child, signal.SIGKILL)
    elif victim == "database":
        assert base is not None
        base.kill(signal.SIGKILL)
        time.sleep(0.3)
        _started_again(base)
    else:
        cluster.kill(victim, chance)


def _started_again(base: Server) -> None:
    """Start a database whose processes may still be ending."""
    for _ in range(50):
        try:
            base.start()
            return
        except subprocess.CalledProcessError:
            time.sleep(0.2)
    base.start()


def _ended(child: int) -> int:
    status = os.waitpid(child, 0)[1]
    return os.waitstatus_to_exitcode(status)


def _noted(store: str) -> frozenset[int]:
    """The MACROPs of the units that the ledger of a store holds."""
    return frozenset(json.loads(row[3])["macrop"] for row in rows(store, "units"))


def _used(store: str) -> frozenset[int]:
    """The MACROPs that were used: their units were carried out again, because no other unit can
    use them.
    """
    return frozenset(row[0] for row in rows(store, "usage") if row[1])


def _differences(wanted: dict[str, Any], found: dict[str, Any]) -> list[str]:
    return [
        f"{name}: {len(found[name])} for {len(wanted[name])}"
        for name in wanted
        if found[name] != wanted[name]
    ]
