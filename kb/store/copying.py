"""Back up a library while others use it, restore it, and copy it to a database of the other kind: a backup is a library in one SQLite file, whatever it came from."""

import contextlib
import os
import sqlite3
from collections.abc import Iterator
from pathlib import Path

from sqlalchemy import Connection, Engine, Table, delete, func, insert, inspect, select, text

from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.files import is_file, is_there
from cellwright.kb.store.cases import metadata as case_tables
from cellwright.kb.store.checking import checked, tables
from cellwright.kb.store.engines import address, connected, refusal, transaction
from cellwright.kb.store.journal import metadata as journal_tables
from cellwright.kb.store.opening import existing, opened

ROWS = 1000  # that are copied at once
_FULL = "name an empty one, or put a backup in its place: `cellwright store restore BACKUP --replace`"


def back_up(store: str, file: Path) -> dict[str, int]:
    """Write a library as it is at one moment into a new file; returns the rows of each table. Raises `InvalidInput`.

    The file appears under its name when it is whole and on the disk.
    """
    if is_there(file):
        raise refusal(str(file), "there is a file of this name already", "name another file", "K403")
    new = file.with_name(f"{file.name}.part")
    with existing(store) as engine, _removed_at_the_end(new):
        if engine.dialect.name == "sqlite":
            _copy_pages(engine, store, new)
        else:
            _make(str(new))
            with _both(engine, store, connected(str(new)), str(new)) as (source, target):
                _copy_rows(source, target)
        found = _finished(new)
        os.replace(new, file)
        _sync(file.parent)
    return found


def restore(file: Path, store: str, replaces: bool = False) -> dict[str, int]:
    """Put a backup in the place of a library, which must be empty unless it is replaced; returns the rows of each table.

    Everything is done in one transaction, so others see the library before or after it. Raises `InvalidInput`.
    """
    findings = checked(str(file))[0]
    if findings:
        raise refusal(str(file), f"this backup is damaged: {findings[0].message}", "take another one", "K422")
    return _put(str(file), store, replaces)


def migrate(source: str, store: str) -> dict[str, int]:
    """Copy a library as it is at one moment into an empty one, which may be of the other kind; returns the rows of each table.

    The source stays as it is. The copy is checked. Raises `InvalidInput`.
    """
    if address(source) == address(store):
        raise refusal(source, "this is the library that it shall be copied to", "name another one", "K409")
    findings = checked(source)[0]
    if findings:
        hint = "`cellwright store check` lists it all"
        raise refusal(source, f"this library is damaged: {findings[0].message}", hint, "K422")
    found = _put(source, store, replaces=False)
    if lost := checked(store)[0]:
        raise refusal(store, f"the copy is damaged: {lost[0].message}", "empty it, and start again", "K422")
    return found


def _put(origin: str, store: str, replaces: bool) -> dict[str, int]:
    """Put what is in a library into another one, in one transaction."""
    _make(store) if not replaces else _make_anew(store)
    with existing(origin) as held, _both(held, origin, connected(store), store) as (source, target):
        if not replaces and any(_count(target, each) for each in tables()):
            raise refusal(store, "this library is not empty", _FULL, "K403")
        for each in reversed(tables()):
            target.execute(delete(each))
        _copy_rows(source, target)
        return {each.name: _count(target, each) for each in tables()}


def _make(store: str) -> None:
    """Make a library with all tables, or bring it up to date."""
    engine = opened(store)
    try:
        with transaction(engine, store, writes=True) as connection:
            case_tables.create_all(connection)
            journal_tables.create_all(connection)
    finally:
        engine.dispose()


def _make_anew(store: str) -> None:
    """Make a library where there may be a damaged one: a file that cannot be used gets the ending `.damaged`."""
    try:
        _make(store)
        with existing(store) as engine, transaction(engine, store) as connection:
            for each in tables():
                _count(connection, each)
    except InvalidInput:
        file = Path(connected(store).url.database or "")
        if address(store).drivername != "sqlite" or not is_file(file):
            raise
        for end in ("-wal", "-shm", ""):
            with contextlib.suppress(FileNotFoundError):
                os.replace(f"{file}{end}", f"{file}.damaged{end}")
        _make(store)


@contextlib.contextmanager
def _both(one: Engine, its: str, other: Engine, name: str) -> Iterator[tuple[Connection, Connection]]:
    """A transaction that reads from one database, and one that writes to another."""
    options = {} if one.dialect.name == "sqlite" else {"isolation_level": "REPEATABLE READ"}
    reading, writing = one.execution_options(**options), transaction(other, name, writes=True)
    try:
        with transaction(reading, its) as source, writing as target:
            yield source, target
    finally:
        other.dispose()


def _copy_rows(source: Connection, target: Connection) -> None:
    known = set(inspect(source).get_table_names())
    for table in tables():
        if table.name not in known:
            continue
        rows = source.execution_options(yield_per=ROWS).execute(select(table))
        for some in rows.mappings().partitions(ROWS):
            target.execute(insert(table), [dict(each) for each in some])
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
        raise refusal(
            store, f"the library cannot be copied: {error}", "`cellwright store check` says more"
        ) from error


def _finished(file: Path) -> dict[str, int]:
    """The rows of a copy, which was found sound and is on the disk."""
    findings, rows = checked(str(file))
    if findings:
        hint = "`cellwright store check` lists it all"
        raise refusal(str(file), f"the library is damaged: {findings[0].message}", hint, "K422")
    _sync(file)
    return rows


def _sync(path: Path) -> None:
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
        raise refusal(
            str(file), f"cannot be written: {error.strerror}", "name another place", "K415"
        ) from error
    finally:
        for end in ("", "-wal", "-shm", "-journal"):
            with contextlib.suppress(OSError):
                file.with_name(f"{file.name}{end}").unlink(missing_ok=True)


def _count(connection: Connection, table: Table) -> int:
    return int(connection.scalar(select(func.count()).select_from(table)) or 0)
