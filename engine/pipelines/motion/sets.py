"""Problem sets and tables of travel times in units of work: several processes or a cluster plan motions and prove lines.

With a store, what is finished is noted there, so that a set that was cut off goes on where it was.
"""

import contextlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from cellwright.engine.kernels.cancellation import Interrupted
from cellwright.engine.model.geometry import Longs
from cellwright.engine.pipelines.motion.moving import Site, Wish
from cellwright.engine.pipelines.motion.problems import Problem, Replayed, replayed
from cellwright.engine.pipelines.motion.stations import Stations
from cellwright.engine.pipelines.motion.table import Table, sought, table
from cellwright.engine.pipelines.units import Crew, Kind, Ledger, Unit, carried_out, silent
from cellwright.engine.pipelines.units.content import content, everywhere, require_same
from cellwright.engine.stages.motion.roadmap import Roadmap, mapped
from cellwright.kb.stopping import Stopped
from cellwright.kb.targets import find

LINES = 2_000  # lines of a table that are proved in one unit


@dataclass(frozen=True, slots=True)
class SetJob:
    """One problem of a set, in the cell of a target with this content."""

    target: str
    content: str
    problem: Problem
    wish: Wish


@dataclass(frozen=True, slots=True)
class LinesJob:
    """A stretch of the lines between the stations of a table."""

    target: str
    content: str
    tool: str
    wanted: tuple[str, ...]
    first: int


@dataclass(frozen=True, slots=True)
class Proved:
    """Which lines of a stretch are proved to be free: a character 0 or 1 for each; none if it was not finished."""

    free: str = ""


def replayed_set(
    target: str,
    problems: Sequence[Problem],
    wish: Wish,
    crew: Crew,
    store: str,
    interrupted: Interrupted,
    progress: Callable[[int, int], None] = silent,
) -> list[Replayed]:
    """What the planner makes of each problem, in their order. Raises `InvalidInput`, and `Stopped` if it is interrupted."""
    where = str(find(target).absolute())
    own, key = content(Path(where)), content(Path(where), wish)
    jobs = [SetJob(where, own, each, wish) for each in problems]
    units = [
        Unit(f"{where} {n}: {job.problem.start} to {job.problem.goal}", key, job)
        for n, job in enumerate(jobs)
    ]
    ledger = Ledger(everywhere(store), _has_answer, _written, _read) if store else None
    kind = Kind("motion set", _replay, _no_answer, ledger)
    found: dict[str, Replayed] = {}
    with contextlib.closing(carried_out(kind, units, crew, interrupted)) as answers:
        for unit, answer in answers:
            if not _has_answer(answer):
                raise Stopped
            found[unit.name] = _of(unit.job.problem, answer)
            progress(len(found), len(units))
    return [found[unit.name] for unit in units]


def table_by(
    target: str, tool: str, wanted: tuple[str, ...], crew: Crew, store: str, interrupted: Interrupted
) -> Table:
    """The travel times between places; the lines between them are proved by a crew. Raises as `replayed_set` does."""
    where = str(find(target).absolute())
    own = content(Path(where))

    def proved(stations: Stations, pairs: Longs) -> Roadmap:
        jobs = [LinesJob(where, own, tool, wanted, first) for first in range(0, len(pairs), LINES)]
        units = [Unit(f"{where} {tool} {','.join(wanted)} {job.first}", own, job) for job in jobs]
        ledger = Ledger(everywhere(store), _is_proved, asdict, _proved_of) if store else None
        kind = Kind("lines of a table", _prove, _unproved, ledger)
        found: dict[int, str] = {}
        with contextlib.closing(carried_out(kind, units, crew, interrupted)) as answers:
            for unit, answer in answers:
                if not answer.free:
                    raise Stopped
                found[unit.job.first] = answer.free
        free = np.array([mark == "1" for job in jobs for mark in found[job.first]], dtype=bool)
        return Roadmap(stations.nodes, pairs, free)

    return table(Site.of(target), tool, wanted, proved)


@lru_cache(maxsize=2)
def _site(target: str, own: str) -> Site:
    """The cell of a target, once for many units, if it is the one that the command had. Raises `InvalidInput`."""
    require_same(Path(target), own)
    return Site.of(target)


def _replay(job: SetJob, _interrupted: Interrupted) -> Replayed:
    (found,) = replayed(_site(job.target, job.content), [job.problem], job.wish)
    return found


def _no_answer(job: SetJob, why: str) -> Replayed:
    return Replayed(job.problem, f"lost: {why}", 0.0, False, 0, "")


def _has_answer(found: Replayed) -> bool:
    return not found.status.startswith("lost")


def _written(found: Replayed) -> dict[str, Any]:
    return {key: value for key, value in asdict(found).items() if key != "problem"}


def _read(noted: Mapping[str, Any]) -> Replayed:
    return Replayed(Problem("", ""), **noted)


def _of(problem: Problem, found: Replayed) -> Replayed:
    """An answer with its problem, which a ledger does not hold."""
    return Replayed(problem, found.status, found.duration_s, found.proved, found.looked, found.digest)


@lru_cache(maxsize=2)
def _sought(target: str, own: str, tool: str, wanted: tuple[str, ...]) -> tuple[Stations, Longs]:
    """The stations of a table and the pairs of them, once for many units."""
    return sought(_site(target, own), tool, wanted)[:2]


def _prove(job: LinesJob, _interrupted: Interrupted) -> Proved:
    found, pairs = _sought(job.target, job.content, job.tool, job.wanted)
    free = mapped(found.ground, found.nodes, pairs[job.first : job.first + LINES]).free
    return Proved("".join("1" if each else "0" for each in free))


def _unproved(_job: LinesJob, _why: str) -> Proved:
    return Proved()


def _is_proved(found: Proved) -> bool:
    return bool(found.free)


def _proved_of(noted: Mapping[str, Any]) -> Proved:
    return Proved(**noted)
