"""Maintenance of a store: damage checks, backup, restore, and copies between databases.

A library is only read. Each kind of damage is told a few times, not once for each row.
"""

import contextlib
import os
import sqlite3
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

from sqlalchemy import (
    Column,
    Connection,
    Engine,
    Table,
    delete,
    func,
    insert,
    inspect,
    select,
    text,
)

from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import is_file, is_there
from cellwright.kb.json_text import parse_json
from cellwright.kb.store.case_store import cases
from cellwright.kb.store.case_store import metadata as case_tables
from cellwright.kb.store.database import (
    at_one_moment,
    connect_engine,
    existing_engine,
    open_engine,
    open_transaction,
    store_refusal,
    store_url,
)
from cellwright.kb.store.journal import JournalProof, journal_proof, lines, runs
from cellwright.kb.store.journal import metadata as journal_tables
from cellwright.kb.store.macrop_documents import loads
from cellwright.kb.store.site_key import site_key
from cellwright.kb.store.table_schema import (
    CURRENT_SCHEMA,
    FIRST_CHAINED_SCHEMA,
    dependencies,
    macrops,
    outlines,
    poses,
    sequences,
    shared,
    text_fingerprint,
    units,
    usage,
    version_of,
    versions,
)
from cellwright.kb.store.table_schema import metadata as library_tables
from cellwright.kb.store.term_notation import NotationError

MAX_FINDINGS_OF_KIND = 5  # findings of one kind
DAMAGE_CODE = "K422"
RESTORE_HINT = "`cellwright store restore BACKUP --replace` puts a backup in its place"

Rows = dict[str, int]


def store_tables() -> list[Table]:
    """All tables of a library, cases and journals included; those that others refer to come
    first.
    """
    tables_found = [
        *library_tables.sorted_tables,
        *case_tables.sorted_tables,
        *journal_tables.sorted_tables,
    ]
    return [table for table in tables_found if table not in (dependencies, versions)]


def check_library(store: str) -> tuple[list[Diagnostic], Rows]:
    """What is wrong in a library, and the rows of each of its tables.

    Raises `InvalidInput` if this is no library.
    """
    damages, rows = list[str](), Rows()
    with existing_engine(store) as opened:
        _require_library(opened, store)
        engine = at_one_moment(opened)
        for look in (_page_damage, _schema_damage, _reference_damage, *_DOCUMENT_CHECKS):
            damages += _look_for_damage(engine, store, look)
        for store_table in store_tables():
            damages += _look_for_damage(
                engine, store, partial(_count_rows, table=store_table, rows=rows)
            )
    return [
        Diagnostic(Source(store), DAMAGE_CODE, damage_text, RESTORE_HINT)
        for damage_text in dict.fromkeys(damages)
    ], rows


def store_damage(stores: Iterable[str]) -> tuple[Diagnostic, ...]:
    """What is wrong in libraries that something inexplicable was read from."""
    diagnostics = list[Diagnostic]()
    for library in stores:
        try:
            diagnostics += check_library(library)[0]
        except InvalidInput as error:
            diagnostics += error.diagnostics
    return tuple(diagnostics)


def _require_library(engine: Engine, store: str) -> None:
    with open_transaction(engine, store) as connection:
        version = version_of(connection)
    if not version:
        raise store_refusal(store, "this is no library of Cellwright", "name another file")
    if version > CURRENT_SCHEMA:
        said = f"the library has schema {version}; this version reads up to {CURRENT_SCHEMA}"
        raise store_refusal(store, said, "install a newer Cellwright")


def _look_for_damage(
    engine: Engine, store: str, look: Callable[[Connection], Iterable[str]]
) -> list[str]:
    """What one look finds. That the database or a row cannot be read is a finding, too."""
    try:
        with open_transaction(engine, store) as connection:
            return list(islice(look(connection), MAX_FINDINGS_OF_KIND))
    except InvalidInput as error:
        return [error.diagnostics[0].message]
    except (
        ValueError,
        TypeError,
        KeyError,
        AttributeError,
        OverflowError,
        RecursionError,
    ) as error:
        return [f"a row cannot be read: {error!r}"[:200]]


def _count_rows(connection: Connection, table: Table, rows: Rows) -> Iterator[str]:
    if inspect(connection).has_table(table.name):
        rows[table.name] = int(connection.scalar(select(func.count()).select_from(table)) or 0)
    yield from ()


def _page_damage(connection: Connection) -> Iterator[str]:
    """What SQLite finds in its file."""
    if connection.dialect.name != "sqlite":
        return
    for (said,) in connection.execute(text(f"PRAGMA integrity_check({MAX_FINDINGS_OF_KIND})")):
        if said != "ok":
            yield " ".join(f"the file is damaged: {said}".split())[:200]


def _schema_damage(connection: Connection) -> Iterator[str]:
    """Tables and columns that are not there.

    Tables of an older version are made when the library is opened.
    """
    known = inspect(connection)
    names = set(known.get_table_names())
    needed = {own_table.name for own_table in library_tables.sorted_tables} - {dependencies.name}
    if version_of(connection) == CURRENT_SCHEMA:
        yield from (f"the table '{name}' is not there" for name in sorted(needed - names))
    for table in store_tables():
        columns_there = (
            {own_column["name"] for own_column in known.get_columns(table.name)}
            if table.name in names
            else set()
        )
        missing = (
            sorted({column.name for column in table.columns} - columns_there)
            if columns_there
            else []
        )
        if version_of(connection) < FIRST_CHAINED_SCHEMA and table.name == lines.name:
            missing = [name for name in missing if name != lines.c.link.name]
        yield from (f"the table '{table.name}' has no column '{name}'" for name in missing)


def _reference_damage(connection: Connection) -> Iterator[str]:
    """Rows that refer to rows which are not there."""
    names = set(inspect(connection).get_table_names())
    refers = [(key.parent, key.column) for table in store_tables() for key in table.foreign_keys]
    refers.append((lines.c.run, runs.c.run))
    for column, other in refers:
        if {column.table.name, other.table.name} <= names:
            yield from _dangling_rows(connection, column, other)
    if {macrops.name, outlines.name, usage.name} <= names:
        for table in (outlines, usage):
            missing = select(macrops.c.id).where(
                ~select(table.c.macrop).where(table.c.macrop == macrops.c.id).exists()
            )
            for (number,) in connection.execute(missing.limit(MAX_FINDINGS_OF_KIND)):
                yield f"MACROP {number} has no row in '{table.name}'"


def _dangling_rows(
    connection: Connection, column: Column[Any], other: Column[Any]
) -> Iterator[str]:
    there = select(other).where(other == column).exists()
    for (value,) in connection.execute(
        select(column).where(~there).distinct().limit(MAX_FINDINGS_OF_KIND)
    ):
        yield (
            f"a row in '{column.table.name}' refers to {value}, which is not in "
            f"'{other.table.name}'"
        )


def _macrop_damage(connection: Connection) -> Iterator[str]:
    for number, document, digest in _select_rows(
        connection, macrops, macrops.c.id, macrops.c.document, macrops.c.fingerprint
    ):
        try:
            loads(document)
        except NotationError as error:
            yield f"MACROP {number} cannot be read: {error}"[:200]
            continue
        if text_fingerprint(document) != digest:
            yield f"MACROP {number} was changed: it does not fit its fingerprint"


def _shared_text_damage(connection: Connection) -> Iterator[str]:
    for number, said, digest in _select_rows(
        connection, shared, shared.c.id, shared.c.text, shared.c.fingerprint
    ):
        if text_fingerprint(said) != digest:
            yield f"the shared text {number} was changed: it does not fit its fingerprint"


def _requirement_damage(connection: Connection) -> Iterator[str]:
    known = {number for (number,) in _select_rows(connection, shared, shared.c.id)}
    for number, words in _select_rows(
        connection, outlines, outlines.c.macrop, outlines.c.requirements
    ):
        wanted = {int(word.partition("*")[0]) for word in (words or "").split()}
        for missing_number in sorted(wanted - known):
            yield f"MACROP {number} requires the shared text {missing_number}, which is not there"


def _journal_damage(connection: Connection) -> Iterator[str]:
    """Journals that are not as they were written, or whose numbers have gaps."""
    if not inspect(connection).has_table(lines.name):
        return
    if version_of(connection) < FIRST_CHAINED_SCHEMA:
        yield from _numbering_damage(connection)
        return
    for run in known_journals(connection):
        for finding in journal_proof(connection, run).findings:
            yield f"the journal of run '{run}': {finding}"


@dataclass(frozen=True, slots=True)
class VerifiedJournal:
    """A journal that was looked at from its first line to its head, and who began it when."""

    run: str
    begun: str
    account: str
    proof: JournalProof


def verify_journals(store: str) -> tuple[VerifiedJournal, ...]:
    """Each journal of a library, proved line by line, and by the key of the site if it has one.

    Raises `InvalidInput` if this is no library, or one of an older version.
    """
    key = site_key()
    with existing_engine(store) as opened:
        _require_library(opened, store)
        with open_transaction(at_one_moment(opened), store) as connection:
            if version_of(connection) < FIRST_CHAINED_SCHEMA:
                hint = "any command that writes to it brings it up to date"
                raise store_refusal(store, "journals of this version have no chains", hint)
            stored_runs = {run: rest for run, *rest in connection.execute(select(runs))}
            verified = list[VerifiedJournal]()
            for run in known_journals(connection):
                begun, text = stored_runs.get(run, ("", "{}"))
                about = _parse_json(text)
                account = about.get("account", "") if isinstance(about, dict) else ""
                proof = journal_proof(connection, run, key)
                verified.append(VerifiedJournal(run, begun, str(account), proof))
    return tuple(verified)


def known_journals(connection: Connection) -> list[str]:
    """The runs that have a journal, or of whose journal something is left."""
    names = set(inspect(connection).get_table_names())
    tables = [table for table in journal_tables.sorted_tables if table.name in names]
    return sorted({run for table in tables for (run,) in connection.execute(select(table.c.run))})


def _numbering_damage(connection: Connection) -> Iterator[str]:
    """Journals of older versions whose lines do not count from 1 without gaps."""
    asked = select(
        lines.c.run, func.count(), func.min(lines.c.number), func.max(lines.c.number)
    ).group_by(lines.c.run)
    for run, count, first, last in connection.execute(asked):
        if (first, last) != (1, count):
            yield (
                f"the journal of run '{run}' has {count} lines, from {first} to {last}: some "
                "are missing"
            )


def _json_in(
    table: Table, kind: type, *columns: Column[Any]
) -> Callable[[Connection], Iterator[str]]:
    """A look at columns that hold JSON of a kind."""
    keys = list(table.primary_key.columns)

    def look(connection: Connection) -> Iterator[str]:
        for row in _select_rows(connection, table, *keys, *columns):
            for column, said in zip(columns, row[len(keys) :], strict=True):
                if not isinstance(_parse_json(said), kind):
                    key = ", ".join(map(str, row[: len(keys)]))
                    yield f"'{column.name}' of {key} in '{table.name}' cannot be read"

    return look


def _parse_json(said: str) -> object:
    try:
        return parse_json(said)
    except (ValueError, TypeError):
        return None


def _select_rows(
    connection: Connection, table: Table, *columns: Column[Any]
) -> Iterator[tuple[Any, ...]]:
    if inspect(connection).has_table(table.name):
        yield from connection.execution_options(yield_per=1000).execute(select(*columns))


_DOCUMENT_CHECKS: tuple[Callable[[Connection], Iterable[str]], ...] = (
    _macrop_damage,
    _shared_text_damage,
    _requirement_damage,
    _json_in(sequences, dict, sequences.c.document),
    _json_in(poses, dict, poses.c.document),
    _json_in(units, dict, units.c.document),
    _json_in(cases, list, cases.c.causes, cases.c.observations),
    _json_in(runs, dict, runs.c.document),
    _json_in(lines, dict, lines.c.content),
    _journal_damage,
)


ROWS_PER_COPY = 1000  # that are copied at once
_NOT_EMPTY_HINT = (
    "name an empty one, or put a backup in its place: `cellwright store restore BACKUP --replace`"
)


def write_backup(store: str, file: Path) -> dict[str, int]:
    """Write a library as it is at one moment into a new file; returns the rows of each table.
    Raises `InvalidInput`.

    The file appears under its name when it is whole and on the disk.
    """
    if is_there(file):
        raise store_refusal(
            str(file), "there is a file of this name already", "name another file", "K403"
        )
    new = file.with_name(f"{file.name}.part")
    with existing_engine(store) as engine, _removed_at_the_end(new):
        if engine.dialect.name == "sqlite":
            _copy_pages(engine, store, new)
        else:
            _make_library(str(new))
            with _both_transactions(engine, store, connect_engine(str(new)), str(new)) as (
                source,
                target,
            ):
                _copy_rows(source, target)
        row_counts = _finish_copy(new)
        os.replace(new, file)
        _sync_file(file.parent)
    return row_counts


def restore_backup(file: Path, store: str, replaces: bool = False) -> dict[str, int]:
    """Put a backup in the place of a library, which must be empty unless it is replaced; returns
    the rows of each table.

    Everything is done in one transaction, so others see the library before or after it. Raises
    `InvalidInput`.
    """
    findings = check_library(str(file))[0]
    if findings:
        raise store_refusal(
            str(file), f"this backup is damaged: {findings[0].message}", "take another one", "K422"
        )
    return _put_library(str(file), store, replaces)


def migrate_library(source: str, store: str) -> dict[str, int]:
    """Copy a library as it is at one moment into an empty one, which may be of the other kind;
    returns the rows of each table.

    The source stays as it is. The copy is checked. Raises `InvalidInput`.
    """
    if store_url(source) == store_url(store):
        raise store_refusal(
            source, "this is the library that it shall be copied to", "name another one", "K409"
        )
    findings = check_library(source)[0]
    if findings:
        hint = "`cellwright store check` lists it all"
        raise store_refusal(source, f"this library is damaged: {findings[0].message}", hint, "K422")
    row_counts = _put_library(source, store, replaces=False)
    if lost := check_library(store)[0]:
        raise store_refusal(
            store, f"the copy is damaged: {lost[0].message}", "empty it, and start again", "K422"
        )
    return row_counts


def _put_library(origin: str, store: str, replaces: bool) -> dict[str, int]:
    """Put what is in a library into another one, in one transaction."""
    _make_library(store) if not replaces else _make_anew(store)
    with (
        existing_engine(origin) as held,
        _both_transactions(held, origin, connect_engine(store), store) as (source, target),
    ):
        if not replaces and any(_row_count(target, own_table) for own_table in store_tables()):
            raise store_refusal(store, "this library is not empty", _NOT_EMPTY_HINT, "K403")
        for emptied_table in reversed(store_tables()):
            target.execute(delete(emptied_table))
        _copy_rows(source, target)
        return {own_table.name: _row_count(target, own_table) for own_table in store_tables()}


def _make_library(store: str) -> None:
    """Make a library with all tables, or bring it up to date."""
    engine = open_engine(store)
    try:
        with open_transaction(engine, store, writes=True) as connection:
            case_tables.create_all(connection)
            journal_tables.create_all(connection)
    finally:
        engine.dispose()


def _make_anew(store: str) -> None:
    """Make a library where there may be a damaged one: a file that cannot be used gets the
    ending `.damaged`.
    """
    try:
        _make_library(store)
        with existing_engine(store) as engine, open_transaction(engine, store) as connection:
            for table in store_tables():
                _row_count(connection, table)
    except InvalidInput:
        file = Path(connect_engine(store).url.database or "")
        if store_url(store).drivername != "sqlite" or not is_file(file):
            raise
        for end in ("-wal", "-shm", ""):
            with contextlib.suppress(FileNotFoundError):
                os.replace(f"{file}{end}", f"{file}.damaged{end}")
        _make_library(store)


@contextlib.contextmanager
def _both_transactions(
    one: Engine, its: str, other: Engine, name: str
) -> Iterator[tuple[Connection, Connection]]:
    """A transaction that reads from one database, and one that writes to another."""
    reading, writing = at_one_moment(one), open_transaction(other, name, writes=True)
    try:
        with open_transaction(reading, its) as source, writing as target:
            yield source, target
    finally:
        other.dispose()


def _copy_rows(source: Connection, target: Connection) -> None:
    known = set(inspect(source).get_table_names())
    for table in store_tables():
        if table.name not in known:
            continue
        rows = source.execution_options(yield_per=ROWS_PER_COPY).execute(select(table))
        for some in rows.mappings().partitions(ROWS_PER_COPY):
            target.execute(insert(table), [dict(table_row) for table_row in some])
        _count_on(target, table)


def _count_on(target: Connection, table: Table) -> None:
    """Have PostgreSQL give numbers above those that were copied."""
    column = next(iter(table.primary_key.columns))
    if target.dialect.name != "postgresql" or column is not table.autoincrement_column:
        return
    last = target.scalar(select(func.max(column)))
    if last is not None:
        said = "SELECT setval(pg_get_serial_sequence(:name, :column), :last)"
        target.execute(text(said), {"name": table.name, "column": column.name, "last": last})


def _copy_pages(engine: Engine, store: str, file: Path) -> None:
    """Copy a SQLite file page by page, as it was at one moment, also while others write."""
    try:
        with (
            contextlib.closing(engine.raw_connection()) as raw,
            contextlib.closing(sqlite3.connect(file)) as copy,
        ):
            held = raw.driver_connection
            assert isinstance(held, sqlite3.Connection)
            held.backup(copy)
            copy.execute("PRAGMA journal_mode = DELETE")
    except sqlite3.Error as error:
        raise store_refusal(
            store, f"the library cannot be copied: {error}", "`cellwright store check` says more"
        ) from error


def _finish_copy(file: Path) -> dict[str, int]:
    """The rows of a copy, which was found sound and is on the disk."""
    findings, rows = check_library(str(file))
    if findings:
        hint = "`cellwright store check` lists it all"
        raise store_refusal(
            str(file), f"the library is damaged: {findings[0].message}", hint, "K422"
        )
    _sync_file(file)
    return rows


def _sync_file(path: Path) -> None:
    held = os.open(path, os.O_RDONLY)
    try:
        os.fsync(held)
    finally:
        os.close(held)


@contextlib.contextmanager
def _removed_at_the_end(file: Path) -> Iterator[None]:
    """A context behind which a file and the logs beside it are gone."""
    try:
        yield
    except OSError as error:
        raise store_refusal(
            str(file), f"cannot be written: {error.strerror}", "name another place", "K415"
        ) from error
    finally:
        for end in ("", "-wal", "-shm", "-journal"):
            with contextlib.suppress(OSError):
                file.with_name(f"{file.name}{end}").unlink(missing_ok=True)


def _row_count(connection: Connection, table: Table) -> int:
    return int(connection.scalar(select(func.count()).select_from(table)) or 0)
