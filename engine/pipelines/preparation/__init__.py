"""Work through a set of problems offline, in parallel processes or by a cluster, so that a store holds the answers in advance.

Every problem is planned, and MACROPs are learned from the plans. If the domain chooses tools for measurements, their
sequence is kept, too. A preparation that was cut off goes on where it was: a ledger in the store has what is finished.
"""

import contextlib
from collections import Counter
from collections.abc import Callable, Generator, Sequence
from pathlib import Path

from cellwright.engine.pipelines.planning import loaded
from cellwright.engine.pipelines.preparation import notes
from cellwright.engine.pipelines.preparation.poses import find_poses, with_found
from cellwright.engine.pipelines.preparation.problem import lost, work
from cellwright.engine.pipelines.preparation.results import (
    KeptPoses,
    KeptSequence,
    Preparation,
    PreparationJob,
    Prepared,
)
from cellwright.engine.pipelines.units import Crew, Kind, Ledger, Unit, carried_out, silent
from cellwright.engine.pipelines.units.content import content, everywhere
from cellwright.engine.pipelines.units.course import INTERRUPTED
from cellwright.engine.pipelines.units.crews import Alone
from cellwright.engine.stages.macros.lifted.digests import Digests
from cellwright.engine.stages.planning import Limits
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader.references import domain_of
from cellwright.kb.model.domain import Domain
from cellwright.kb.stopping import Stopped
from cellwright.kb.store import Library

__all__ = ["KeptPoses", "KeptSequence", "Preparation", "Prepared", "prepare", "silent"]


def prepare(
    paths: Sequence[Path],
    store: str,
    limits: Limits,
    crew: Crew,
    progress: Callable[[int, int], None] = silent,
) -> Preparation:
    """Plan every problem file, and keep what was learned. Stale MACROPs of the domains are removed first.

    When `limits.interrupted` holds, running searches end and the remaining problems are not planned. Raises `InvalidInput`
    if the library or the crew cannot be used.
    """
    jobs = [
        PreparationJob(path.absolute(), everywhere(store), limits.expansions, limits.seed, content(path))
        for path in paths
    ]
    try:
        stale = _without_stale(paths, store)
    except Stopped:
        return Preparation(tuple(lost(job, INTERRUPTED) for job in jobs))
    found: dict[Path, Prepared] = {}
    with contextlib.suppress(
        Stopped
    ):  # the end of the time met what never asks whether to stop: the rest is lost
        before = Counter[Path]() if isinstance(crew, Alone) else find_poses(jobs, crew, limits.interrupted)
        with contextlib.closing(_carried_out(jobs, store, limits, crew)) as answers:
            for unit, prepared in answers:
                found[unit.job.path] = with_found(prepared, before[unit.job.path])
                progress(len(found), len(jobs))
    return Preparation(tuple(found.get(job.path) or lost(job, INTERRUPTED) for job in jobs), stale)


def _carried_out(
    jobs: Sequence[PreparationJob], store: str, limits: Limits, crew: Crew
) -> Generator[tuple[Unit[PreparationJob], Prepared], None, None]:
    """All problems with what became of them, as they are finished."""
    kind = Kind(
        f"prepare {limits.expansions} {limits.seed}",
        work,
        lost,
        Ledger(everywhere(store), notes.finished, notes.written, notes.read),
    )
    return carried_out(
        kind, [Unit(str(job.path), job.content, job) for job in jobs], crew, limits.interrupted
    )


def _without_stale(paths: Sequence[Path], store: str) -> dict[int, tuple[str, ...]]:
    gone: dict[int, tuple[str, ...]] = {}
    with Library(store) as library:
        if not library.figures().macrops:
            return gone  # reading all domains takes a while, and each is read again by those who plan
        for domain in _domains(paths):
            outdated = library.outdated(domain.name, Digests(domain).of)
            library.forget(outdated)
            gone |= outdated
    return gone


def _domains(paths: Sequence[Path]) -> list[Domain]:
    """The domains of all problems that can be read, each once. Errors in the other files are reported later."""
    found: dict[Path, Domain] = {}
    for path in paths:
        with contextlib.suppress(InvalidInput):
            own = domain_of(str(path))
            if own not in found:
                found[own] = loaded(own).domain
    return list(found.values())
