"""Looks for damage in a library: pages, tables, rows that refer to nothing, and documents that nobody can read.

A library is only read. Each kind of damage is told a few times, not once for each row.
"""

from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from typing import Any

from sqlalchemy import Column, Connection, Engine, Table, func, inspect, select, text

from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.json_text import parsed
from cellwright.kb.store.cases import cases
from cellwright.kb.store.cases import metadata as case_tables
from cellwright.kb.store.documents import loads
from cellwright.kb.store.engines import refusal, transaction
from cellwright.kb.store.journal import lines, runs
from cellwright.kb.store.journal import metadata as journal_tables
from cellwright.kb.store.notation import NotationError
from cellwright.kb.store.opening import existing
from cellwright.kb.store.schema import (
    CURRENT,
    dependencies,
    fingerprint,
    macrops,
    outlines,
    poses,
    sequences,
    shared,
    units,
    usage,
    version_of,
    versions,
)
from cellwright.kb.store.schema import metadata as library_tables

MOST = 5  # findings of one kind
CODE = "K422"
HINT = "`cellwright store restore BACKUP --replace` puts a backup in its place"

Rows = dict[str, int]


def tables() -> list[Table]:
    """All tables of a library, cases and journals included; those that others refer to come first."""
    found = [*library_tables.sorted_tables, *case_tables.sorted_tables, *journal_tables.sorted_tables]
    return [each for each in found if each not in (dependencies, versions)]


def checked(store: str) -> tuple[list[Diagnostic], Rows]:
    """What is wrong in a library, and the rows of each of its tables. Raises `InvalidInput` if this is no library."""
    found, rows = list[str](), Rows()
    with existing(store) as engine:
        _require_library(engine, store)
        for look in (_pages, _shape, _references, *_DOCUMENTS):
            found += _looked(engine, store, look)
        for each in tables():
            found += _looked(engine, store, lambda connection, each=each: _count(connection, each, rows))  # type: ignore[misc]
    return [Diagnostic(Source(store), CODE, each, HINT) for each in dict.fromkeys(found)], rows


def damage(stores: Iterable[str]) -> tuple[Diagnostic, ...]:
    """What is wrong in libraries that something inexplicable was read from."""
    found = list[Diagnostic]()
    for each in stores:
        try:
            found += checked(each)[0]
        except InvalidInput as error:
            found += error.diagnostics
    return tuple(found)


def _require_library(engine: Engine, store: str) -> None:
    with transaction(engine, store) as connection:
        version = version_of(connection)
    if not version:
        raise refusal(store, "this is no library of Cellwright", "name another file")
    if version > CURRENT:
        said = f"the library has schema {version}; this version reads up to {CURRENT}"
        raise refusal(store, said, "install a newer Cellwright")


def _looked(engine: Engine, store: str, look: Callable[[Connection], Iterable[str]]) -> list[str]:
    """What one look finds. That the database or a row cannot be read is a finding, too."""
    try:
        with transaction(engine, store) as connection:
            return list(islice(look(connection), MOST))
    except InvalidInput as error:
        return [error.diagnostics[0].message]
    except (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError) as error:
        return [f"a row cannot be read: {error!r}"[:200]]


def _count(connection: Connection, table: Table, rows: Rows) -> Iterator[str]:
    if inspect(connection).has_table(table.name):
        rows[table.name] = int(connection.scalar(select(func.count()).select_from(table)) or 0)
    yield from ()


def _pages(connection: Connection) -> Iterator[str]:
    """What SQLite finds in its file."""
    if connection.dialect.name != "sqlite":
        return
    for (said,) in connection.execute(text(f"PRAGMA integrity_check({MOST})")):
        if said != "ok":
            yield " ".join(f"the file is damaged: {said}".split())[:200]


def _shape(connection: Connection) -> Iterator[str]:
    """Tables and columns that are not there. Tables of an older version are made when the library is opened."""
    known = inspect(connection)
    names = set(known.get_table_names())
    needed = {each.name for each in library_tables.sorted_tables} - {dependencies.name}
    if version_of(connection) == CURRENT:
        yield from (f"the table '{name}' is not there" for name in sorted(needed - names))
    for table in tables():
        there = {each["name"] for each in known.get_columns(table.name)} if table.name in names else set()
        missing = sorted({each.name for each in table.columns} - there) if there else []
        yield from (f"the table '{table.name}' has no column '{name}'" for name in missing)


def _references(connection: Connection) -> Iterator[str]:
    """Rows that refer to rows which are not there."""
    names = set(inspect(connection).get_table_names())
    refers = [(key.parent, key.column) for table in tables() for key in table.foreign_keys]
    refers.append((lines.c.run, runs.c.run))
    for column, other in refers:
        if {column.table.name, other.table.name} <= names:
            yield from _dangling(connection, column, other)
    if {macrops.name, outlines.name, usage.name} <= names:
        for table in (outlines, usage):
            missing = select(macrops.c.id).where(
                ~select(table.c.macrop).where(table.c.macrop == macrops.c.id).exists()
            )
            for (number,) in connection.execute(missing.limit(MOST)):
                yield f"MACROP {number} has no row in '{table.name}'"


def _dangling(connection: Connection, column: Column[Any], other: Column[Any]) -> Iterator[str]:
    there = select(other).where(other == column).exists()
    for (value,) in connection.execute(select(column).where(~there).distinct().limit(MOST)):
        yield f"a row in '{column.table.name}' refers to {value}, which is not in '{other.table.name}'"


def _macrops(connection: Connection) -> Iterator[str]:
    for number, document, digest in _rows(
        connection, macrops, macrops.c.id, macrops.c.document, macrops.c.fingerprint
    ):
        try:
            loads(document)
        except NotationError as error:
            yield f"MACROP {number} cannot be read: {error}"[:200]
            continue
        if fingerprint(document) != digest:
            yield f"MACROP {number} was changed: it does not fit its fingerprint"


def _shared(connection: Connection) -> Iterator[str]:
    for number, said, digest in _rows(connection, shared, shared.c.id, shared.c.text, shared.c.fingerprint):
        if fingerprint(said) != digest:
            yield f"the shared text {number} was changed: it does not fit its fingerprint"


def _requirements(connection: Connection) -> Iterator[str]:
    known = {number for (number,) in _rows(connection, shared, shared.c.id)}
    for number, words in _rows(connection, outlines, outlines.c.macrop, outlines.c.requirements):
        wanted = {int(word.partition("*")[0]) for word in (words or "").split()}
        for each in sorted(wanted - known):
            yield f"MACROP {number} requires the shared text {each}, which is not there"


def _journals(connection: Connection) -> Iterator[str]:
    """Journals whose lines do not count from 1 without gaps."""
    asked = select(lines.c.run, func.count(), func.min(lines.c.number), func.max(lines.c.number)).group_by(
        lines.c.run
    )
    if not inspect(connection).has_table(lines.name):
        return
    for run, count, first, last in connection.execute(asked):
        if (first, last) != (1, count):
            yield f"the journal of run '{run}' has {count} lines, from {first} to {last}: some are missing"


def _json_in(table: Table, kind: type, *columns: Column[Any]) -> Callable[[Connection], Iterator[str]]:
    """A look at columns that hold JSON of a kind."""
    keys = list(table.primary_key.columns)

    def look(connection: Connection) -> Iterator[str]:
        for row in _rows(connection, table, *keys, *columns):
            for column, said in zip(columns, row[len(keys) :], strict=True):
                if not isinstance(_parsed(said), kind):
                    key = ", ".join(map(str, row[: len(keys)]))
                    yield f"'{column.name}' of {key} in '{table.name}' cannot be read"

    return look


def _parsed(said: str) -> object:
    try:
        return parsed(said)
    except (ValueError, TypeError):
        return None


def _rows(connection: Connection, table: Table, *columns: Column[Any]) -> Iterator[tuple[Any, ...]]:
    if inspect(connection).has_table(table.name):
        yield from connection.execution_options(yield_per=1000).execute(select(*columns))


_DOCUMENTS: tuple[Callable[[Connection], Iterable[str]], ...] = (
    _macrops,
    _shared,
    _requirements,
    _json_in(sequences, dict, sequences.c.document),
    _json_in(poses, dict, poses.c.document),
    _json_in(units, dict, units.c.document),
    _json_in(cases, list, cases.c.causes, cases.c.observations),
    _json_in(runs, dict, runs.c.document),
    _json_in(lines, dict, lines.c.content),
    _journals,
)
