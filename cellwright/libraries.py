"""Libraries: problems planned in advance, and the MACROPs, sequences, cases and journals that a store keeps."""

import os
from collections.abc import Mapping, Sequence
from os import fspath
from pathlib import Path
from typing import TYPE_CHECKING

from cellwright.answers import Told
from cellwright.requests import Name, Target, limited, load

if TYPE_CHECKING:
    from cellwright.engine.pipelines.inspection.progress import Progress
    from cellwright.engine.pipelines.preparation import Preparation
    from cellwright.engine.pipelines.reuse.lessons import Lesson
    from cellwright.kb.diagnostics import Diagnostic
    from cellwright.kb.store import Stored


def prepare(
    target: Name,
    store: Name,
    *,
    jobs: int = 0,
    cluster: str = "",
    seconds: float | None = None,
    expansions: int = 1_000_000,
    seed: int = 0,
) -> "Told[Preparation]":
    """Plan all problems of a domain or folder, and keep plans, sequences and poses. Status: ok, or incomplete.

    `jobs` are processes (0: one for each processor), `cluster` the address of a Dask scheduler. Raises `InvalidInput`.
    """
    from cellwright.engine.formats.report import prepared
    from cellwright.engine.pipelines.preparation import prepare as prepare_all
    from cellwright.engine.pipelines.preparation.targets import problems_of
    from cellwright.engine.pipelines.units import crew_of
    from cellwright.engine.stages.planning import Limits

    crew, paths = crew_of(jobs or len(os.sched_getaffinity(0)), cluster), problems_of(fspath(target))
    with limited(seconds) as over:
        limits = Limits(expansions, interrupted=over, seed=seed)
        found = prepare_all(paths, fspath(store), limits, crew)
    whole = len(found.problems) == len(paths) and all(
        each.status in ("found", "infeasible") for each in found.problems
    )
    told = tuple(dict.fromkeys(d for each in found.problems for d in each.diagnostics))
    return Told(found, "ok" if whole else "incomplete", prepared.content, prepared.text, found=told)


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
) -> "Told[Progress]":
    """Report to the sequence in a store which visits are done, lost or restored; the visits that are left.

    `bad` says of visits that failed why.
    Raises `InvalidInput`.
    """
    from cellwright.engine.formats.report import progress as report
    from cellwright.engine.pipelines.inspection.progress import News
    from cellwright.engine.pipelines.parts.keeping import carry_on
    from cellwright.engine.stages.sequencing import Limits

    news = News(tuple(done), tuple(lost), dict(bad or {}), tuple(restored))
    found = carry_on(fspath(store), load(target), news, Limits(work, seed), anew)
    return Told(found, "found" if found.plan.rest else "done", report.entry, report.text)


def macros(store: Name, domain: str = "") -> "tuple[Stored, ...]":
    """The MACROPs that a store has learned, of one domain or of all."""
    from cellwright.kb.store import Library

    name = _domain_name(domain) if domain else ""
    with Library(fspath(store)) as library:
        return tuple(library.all(name))


def _domain_name(target: str) -> str:
    """The name of the domain that a target names."""
    from cellwright.engine.pipelines.files import loaded
    from cellwright.kb.loader import find

    return loaded(find(target)).domain.name


def learn(store: Name, plans: Sequence[Name]) -> "tuple[Lesson, ...]":
    """Check plan files, generalise them and keep the MACROPs; the result for each file. Raises `InvalidInput`."""
    from cellwright.engine.pipelines.reuse.lessons import lesson
    from cellwright.kb.store import Library

    with Library(fspath(store)) as library:
        return tuple(lesson(Path(each), library) for each in plans)


def forget(store: Name, numbers: Sequence[int]) -> int:
    """Remove MACROPs by their numbers; how many were removed."""
    from cellwright.kb.store import Library

    with Library(fspath(store)) as library:
        return library.forget(set(numbers))


def export_macros(store: Name, file: Name, domain: str = "") -> int:
    """Write the MACROPs of a store to a JSON file; how many there are."""
    from cellwright.engine.pipelines.reuse.lessons import write

    found = macros(store, domain)
    write(Path(file), [each.macrop for each in found])
    return len(found)


def import_macros(store: Name, file: Name) -> int:
    """Add the MACROPs of such a file to a store; how many were new. Raises `InvalidInput`."""
    from cellwright.engine.pipelines.reuse.lessons import read, records
    from cellwright.kb.store import Library

    made = records(read(Path(file)))
    with Library(fspath(store)) as library:
        return sum(number is not None for number in library.add(made))


def check_store(store: Name) -> "tuple[Diagnostic, ...]":
    """The damage in a store; empty if there is none. Raises `InvalidInput` if this is no store."""
    from cellwright.kb.store.checking import checked

    return tuple(checked(fspath(store))[0])


def back_up(store: Name, file: Name) -> Mapping[str, int]:
    """Copy a store into a new file, also while others use it; the rows of each table. Raises `InvalidInput`."""
    from cellwright.kb.store import copying

    return copying.back_up(fspath(store), Path(file))


def restore(file: Name, store: Name, *, replace: bool = False) -> Mapping[str, int]:
    """Put a backup into an empty store, or in the place of what it holds; the rows of each table. Raises `InvalidInput`."""
    from cellwright.kb.store import copying

    return copying.restore(Path(file), fspath(store), replace)


def migrate(source: Name, store: Name) -> Mapping[str, int]:
    """Copy a store into an empty one, from SQLite to PostgreSQL or back; the rows of each table. Raises `InvalidInput`."""
    from cellwright.kb.store import copying

    return copying.migrate(fspath(source), fspath(store))
