"""Stores: problems planned ahead, and the MACROPs, sequences, cases and journals kept there."""

import os
from collections.abc import Mapping, Sequence
from os import fspath
from pathlib import Path
from typing import TYPE_CHECKING

from cellwright.engine.formats import report
from cellwright.engine.pipelines import inspection, planning
from cellwright.kb import loader
from cellwright.kb import store as kb_store
from cellwright.library_base import Name, Target, Told, limit_seconds, load

if TYPE_CHECKING:
    from cellwright.engine.pipelines.inspection.tour_progress import KeptSequenceProgress
    from cellwright.engine.pipelines.planning.macros.macro_exchange import Lesson
    from cellwright.engine.pipelines.precompute import Preparation
    from cellwright.kb.diagnostics import Diagnostic
    from cellwright.kb.store import Stored


def prepare(
    target: Name,
    store: Name,
    *,
    jobs: int = 0,
    cluster: str = "",
    seconds: float | None = None,
    expansions: int | None = None,
    seed: int = 0,
) -> "Told[Preparation]":
    """Plan all problems of a domain or folder, and keep plans, sequences and poses. Status: ok, or
    incomplete.

    `jobs` are processes (0: one for each processor), `cluster` the address of a Dask scheduler.
    Raises `InvalidInput`.
    """
    from cellwright.engine.pipelines.jobs import crew_of
    from cellwright.engine.pipelines.precompute import prepare_problems as prepare_all
    from cellwright.engine.pipelines.precompute.preparation_results import problems_of
    from cellwright.engine.stages.planning import SearchLimits, expansions_within

    crew, paths = (
        crew_of(jobs or len(os.sched_getaffinity(0)), cluster),
        problems_of(fspath(target)),
    )
    with limit_seconds(seconds) as over:
        limits = SearchLimits(expansions_within(expansions, seconds), interrupted=over, seed=seed)
        preparation = prepare_all(paths, fspath(store), limits, crew)
    whole = len(preparation.problems) == len(paths) and all(
        problem.status in ("found", "infeasible") for problem in preparation.problems
    )
    diagnostics = tuple(
        dict.fromkeys(d for problem in preparation.problems for d in problem.diagnostics)
    )
    return Told(
        preparation,
        "ok" if whole else "incomplete",
        report.preparation_content,
        report.preparation_text,
        found=diagnostics,
    )


def keep_sequence(
    target: Target,
    store: Name,
    *,
    done: Sequence[str] = (),
    lost: Sequence[str] = (),
    bad: Mapping[str, str] | None = None,
    restored: Sequence[str] = (),
    anew: bool = False,
    work: int = 0,
    seed: int = 0,
) -> "Told[KeptSequenceProgress]":
    """Report to the sequence in a store which visits are done, lost or restored; the visits that
    are left.

    `bad` says of visits that failed why.
    Raises `InvalidInput`.
    """
    from cellwright.engine.stages.sequencing import TourLimits

    news = inspection.SequenceNews(tuple(done), tuple(lost), dict(bad or {}), tuple(restored))
    kept_sequence = planning.carry_on(
        fspath(store), load(target), news, TourLimits(work, seed), anew
    )
    return Told(
        kept_sequence,
        "found" if kept_sequence.plan.rest else "done",
        report.sequence_entry,
        report.sequence_text,
    )


def macros(store: Name, domain: str = "") -> "tuple[Stored, ...]":
    """The MACROPs that a store has learned, of one domain or of all."""
    name = _domain_name(domain) if domain else ""
    with kb_store.Library(fspath(store)) as library:
        return tuple(library.all(name))


def _domain_name(target: str) -> str:
    """The name of the domain that a target names."""
    return planning.load_target(loader.find_target(target)).domain.name


def learn(store: Name, plans: Sequence[Name]) -> "tuple[Lesson, ...]":
    """Check plan files, generalise them and keep the MACROPs; the result for each file.

    Raises `InvalidInput`.
    """
    with kb_store.Library(fspath(store)) as library:
        return tuple(planning.learn_from_file(Path(plan), library) for plan in plans)


def forget(store: Name, numbers: Sequence[int]) -> int:
    """Remove MACROPs by their numbers; how many were removed."""
    with kb_store.Library(fspath(store)) as library:
        return library.forget(set(numbers))


def export_macros(store: Name, file: Name, domain: str = "") -> int:
    """Write the MACROPs of a store to a JSON file; how many there are."""
    stored_macros = macros(store, domain)
    planning.write_macros(Path(file), [stored.macrop for stored in stored_macros])
    return len(stored_macros)


def import_macros(store: Name, file: Name) -> int:
    """Add the MACROPs of such a file to a store; how many were new. Raises `InvalidInput`."""
    made = planning.macro_records(planning.read_macros(Path(file)))
    with kb_store.Library(fspath(store)) as library:
        return sum(number is not None for number in library.add(made))


def check_store(store: Name) -> "tuple[Diagnostic, ...]":
    """The damage in a store; empty if there is none. Raises `InvalidInput` if this is no store."""
    return tuple(kb_store.check_library(fspath(store))[0])


def back_up(store: Name, file: Name) -> Mapping[str, int]:
    """Copy a store into a new file, also while others use it; the rows of each table.

    Raises `InvalidInput`.
    """
    return kb_store.write_backup(fspath(store), Path(file))


def restore(file: Name, store: Name, *, replace: bool = False) -> Mapping[str, int]:
    """Put a backup into an empty store, or in the place of what it holds; the rows of each table.

    Raises `InvalidInput`.
    """
    return kb_store.restore_backup(Path(file), fspath(store), replace)


def migrate(source: Name, store: Name) -> Mapping[str, int]:
    """Copy a store into an empty one, from SQLite to PostgreSQL or back; the rows of each table.

    Raises `InvalidInput`.
    """
    return kb_store.migrate_library(fspath(source), fspath(store))
