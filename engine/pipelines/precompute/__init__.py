"""Precomputation: many problems are planned offline, so that a store holds the answers.

Every problem is planned, and MACROPs are learned from the plans. If the domain chooses tools for
measurements, their sequence is kept, too. A preparation that was cut off goes on where it was: a
ledger in the store has what is finished.
"""

import contextlib
from collections import Counter
from collections.abc import Callable, Generator, Sequence
from pathlib import Path

from cellwright.engine.pipelines.jobs import (
    ResultLedger,
    WorkCrew,
    WorkKind,
    WorkUnit,
    carried_out,
    show_nothing,
)
from cellwright.engine.pipelines.jobs.executors import AloneCrew
from cellwright.engine.pipelines.jobs.input_digests import content_digest, shared_store
from cellwright.engine.pipelines.jobs.unit_scheduler import UNIT_INTERRUPTED
from cellwright.engine.pipelines.planning.target_files import load_target
from cellwright.engine.pipelines.precompute import preparation_results
from cellwright.engine.pipelines.precompute.preparation_results import (
    KeptPoses,
    KeptSequence,
    Preparation,
    PreparationJob,
    PreparedProblem,
)
from cellwright.engine.pipelines.precompute.problem_preparation import (
    find_poses,
    lost_problem,
    prepare_problem,
    with_found,
)
from cellwright.engine.stages.lifted.domain_digests import DomainDigests
from cellwright.engine.stages.planning import SearchLimits
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader.domain_lookup import domain_of
from cellwright.kb.model.domain_model import Domain
from cellwright.kb.stopping import StoppedByCaller
from cellwright.kb.store import Library

__all__ = [
    "KeptPoses",
    "KeptSequence",
    "Preparation",
    "PreparedProblem",
    "prepare_problems",
    "show_nothing",
]


def prepare_problems(
    paths: Sequence[Path],
    store: str,
    limits: SearchLimits,
    crew: WorkCrew,
    progress: Callable[[int, int], None] = show_nothing,
) -> Preparation:
    """Plan every problem file, and keep what was learned. Stale MACROPs of the domains are removed
    first.

    When `limits.interrupted` holds, running searches end and the remaining problems are not
    planned. Raises `InvalidInput` if the library or the crew cannot be used.
    """
    jobs = [
        PreparationJob(
            path.absolute(),
            shared_store(store),
            limits.expansions,
            limits.seed,
            content_digest(path),
        )
        for path in paths
    ]
    try:
        stale = _without_stale(paths, store)
    except StoppedByCaller:
        return Preparation(tuple(lost_problem(job, UNIT_INTERRUPTED) for job in jobs))
    prepared_of: dict[Path, PreparedProblem] = {}
    with contextlib.suppress(
        StoppedByCaller
    ):  # the end of the time met what never asks whether to stop: the rest is lost
        before = (
            Counter[Path]()
            if isinstance(crew, AloneCrew)
            else find_poses(jobs, crew, limits.interrupted)
        )
        with contextlib.closing(_carried_out(jobs, store, limits, crew)) as answers:
            for unit, prepared in answers:
                prepared_of[unit.job.path] = with_found(prepared, before[unit.job.path])
                progress(len(prepared_of), len(jobs))
    return Preparation(
        tuple(prepared_of.get(job.path) or lost_problem(job, UNIT_INTERRUPTED) for job in jobs),
        stale,
    )


def _carried_out(
    jobs: Sequence[PreparationJob], store: str, limits: SearchLimits, crew: WorkCrew
) -> Generator[tuple[WorkUnit[PreparationJob], PreparedProblem], None, None]:
    """All problems with what became of them, as they are finished."""
    kind = WorkKind(
        f"prepare {limits.expansions} {limits.seed}",
        prepare_problem,
        lost_problem,
        ResultLedger(
            shared_store(store),
            preparation_results.is_prepared,
            preparation_results.prepared_entry,
            preparation_results.read_prepared,
        ),
    )
    return carried_out(
        kind, [WorkUnit(str(job.path), job.content, job) for job in jobs], crew, limits.interrupted
    )


def _without_stale(paths: Sequence[Path], store: str) -> dict[int, tuple[str, ...]]:
    gone: dict[int, tuple[str, ...]] = {}
    with Library(store) as library:
        if not library.figures().macrops:
            # reading all domains takes a while, and each is read again by those who plan
            return gone
        for domain in _readable_domains(paths):
            outdated = library.outdated(domain.name, DomainDigests(domain).of)
            library.forget(outdated)
            gone |= outdated
    return gone


def _readable_domains(paths: Sequence[Path]) -> list[Domain]:
    """The domains of all problems that can be read, each once.

    Errors in the other files are reported later.
    """
    domain_of_path: dict[Path, Domain] = {}
    for path in paths:
        with contextlib.suppress(InvalidInput):
            own = domain_of(str(path))
            if own not in domain_of_path:
                domain_of_path[own] = load_target(own).domain
    return list(domain_of_path.values())
