"""Work through a set of problems offline, in parallel processes, so that a store holds the answers in advance.

Every problem is planned, and MACROPs are learned from the plans. If the domain chooses tools for measurements, their
sequence is kept, too.
"""

import contextlib
from collections.abc import Callable, Sequence
from pathlib import Path

from engine.pipelines.planning import loaded
from engine.pipelines.preparation.pool import carried_out
from engine.pipelines.preparation.problem import interrupted_before
from engine.pipelines.preparation.results import (
    KeptPoses,
    KeptSequence,
    Preparation,
    PreparationJob,
    Prepared,
)
from engine.stages.macros.lifted.digests import Digests
from engine.stages.planning import Limits
from kb.diagnostics import InvalidInput
from kb.model.domain import Domain
from kb.stopping import Stopped
from kb.store import Library

__all__ = ["KeptPoses", "KeptSequence", "Preparation", "Prepared", "prepare", "silent"]


def silent(_done: int, _of: int) -> None:
    """Show no progress."""


def prepare(
    paths: Sequence[Path],
    store: str,
    limits: Limits,
    processes: int,
    progress: Callable[[int, int], None] = silent,
) -> Preparation:
    """Plan every problem file, and keep what was learned. Stale MACROPs of the domains are removed first.

    When `limits.interrupted` holds, running searches end and the remaining problems are not planned. Raises `InvalidInput`
    if the library cannot be used.
    """
    try:
        stale = _without_stale(paths, store)
    except Stopped:
        return Preparation(tuple(interrupted_before(path) for path in paths))
    jobs = [PreparationJob(path, store, limits.expansions, limits.seed) for path in paths]
    found: dict[Path, Prepared] = {}
    with contextlib.closing(carried_out(jobs, processes, limits.interrupted)) as answers:
        for job, prepared in answers:
            found[job.path] = prepared
            progress(len(found), len(jobs))
    return Preparation(tuple(found[path] for path in paths if path in found), stale)


def _without_stale(paths: Sequence[Path], store: str) -> dict[int, tuple[str, ...]]:
    gone: dict[int, tuple[str, ...]] = {}
    with Library(store) as library:
        for domain in _domains(paths):
            outdated = library.outdated(domain.name, Digests(domain).of)
            library.forget(outdated)
            gone |= outdated
    return gone


def _domains(paths: Sequence[Path]) -> list[Domain]:
    """The domains of all problems that can be read, each once. Errors in the other files are reported later."""
    found: dict[str, Domain] = {}
    for path in paths:
        with contextlib.suppress(InvalidInput):
            domain = loaded(path).domain
            found.setdefault(domain.path or domain.name, domain)
    return list(found.values())
