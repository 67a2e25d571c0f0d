"""Connections to SQLite (one file, write-ahead log) and PostgreSQL (through pg8000), with transactions that mean it.

SQLite writers take the lock when they begin, so that reading and then writing is one undisturbed act; readers see one
state and block nobody. A process that is killed leaves its last transaction undone, never half done.
"""

import contextlib
import os
import sqlite3
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

from sqlalchemy import URL, Connection, Engine, create_engine, event, make_url, text
from sqlalchemy.exc import ArgumentError, SQLAlchemyError

from kb.diagnostics import Diagnostic, InvalidInput, Source

BUSY_S = 60.0  # that a SQLite writer waits for others
LOCK = 0x43656C6C  # PostgreSQL's advisory lock around migration
POSTGRES = ("postgres", "postgresql", "postgresql+pg8000")


def refusal(where: str, message: str, hint: str = "", code: str = "K416") -> InvalidInput:
    """The error for a library that cannot be used, with the reason."""
    return InvalidInput([Diagnostic(Source(where), code, message, hint)])


def address(target: str) -> URL:
    """The URL of a library: a path names a SQLite file. Raises `InvalidInput`."""
    if "://" not in target:
        return URL.create("sqlite", database=str(Path(target).expanduser()))
    try:
        url = make_url(target)
    except ArgumentError:
        raise refusal("--store", "this is no URL of a library", _WAYS) from None
    if url.drivername in POSTGRES:
        if not url.username:
            raise refusal("--store", "the address names no user", _WAYS)
        return url.set(drivername="postgresql+pg8000")
    if url.drivername == "sqlite":
        return url
    raise refusal("--store", f"no library is kept in '{url.drivername}'", _WAYS)


_WAYS = "give a file, or postgresql://USER@HOST/DATABASE"


def connected(target: str) -> Engine:
    """The engine of a library. Raises `InvalidInput` where the driver is missing or the place cannot hold a file."""
    url = address(target)
    if url.drivername == "sqlite":
        return _sqlite(url)
    try:
        return create_engine(url, pool_pre_ping=True)
    except ModuleNotFoundError:
        hint = "install the extra: pip install 'cellwright[postgres]'"
        raise refusal("--store", "the driver for PostgreSQL is not installed", hint, "K414") from None


def _sqlite(url: URL) -> Engine:
    file = Path(url.database or "")
    if not file.parent.is_dir():
        raise refusal(str(url.database), "there is no such folder for a library", "make the folder first")
    engine = create_engine(
        _reading(file) if _is_kept_from_writing(file) else url, connect_args={"timeout": BUSY_S}
    )
    event.listen(engine, "connect", _prepare)
    event.listen(engine, "begin", _begin)
    return engine


def _is_kept_from_writing(file: Path) -> bool:
    """Whether a file is there that may be read only; the log beside it needs a folder that may be written, too."""
    try:
        return file.is_file() and not all(os.access(each, os.W_OK) for each in (file, file.parent))
    except (OSError, ValueError):  # opening it says why
        return False


def _reading(file: Path) -> URL:
    """A file as it stands, or, where a log beside it shows that others write, with what they write."""
    logged = file.with_name(f"{file.name}-wal").exists()
    asked = "mode=ro" if logged else "mode=ro&immutable=1"
    return URL.create("sqlite", database=f"file:{quote(str(file))}?{asked}", query={"uri": "true"})


def is_writable(engine: Engine) -> bool:
    """Whether a database may be written."""
    return engine.url.query.get("uri") != "true"


def _prepare(raw: Any, _record: object) -> None:
    raw.isolation_level = None  # else the driver begins late, and upgrades where that can fail
    raw.execute(f"PRAGMA busy_timeout = {int(BUSY_S * 1000)}")
    raw.execute("PRAGMA foreign_keys = ON")
    raw.execute("PRAGMA synchronous = NORMAL")


def _begin(connection: Connection) -> None:
    writes = connection.get_execution_options().get("writes", False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")


def write_ahead(engine: Engine) -> None:
    """Let a SQLite file keep a write-ahead log; the busy timeout does not cover this switch, so it is tried again."""
    if engine.dialect.name != "sqlite":
        return
    deadline = time.monotonic() + BUSY_S
    while True:
        try:
            with contextlib.closing(engine.raw_connection()) as raw:
                raw.cursor().execute("PRAGMA journal_mode = WAL")
                return
        except sqlite3.Error as error:
            if "locked" not in str(error) or time.monotonic() > deadline:
                raise
            time.sleep(0.01)


@contextlib.contextmanager
def transaction(engine: Engine, where: str, writes: bool = False) -> Iterator[Connection]:
    """One transaction, undone if anything goes wrong. Raises `InvalidInput` where the database refuses."""
    try:
        with engine.connect().execution_options(writes=writes) as connection, connection.begin():
            yield connection
    except SQLAlchemyError as error:
        cause = getattr(error, "orig", None) or error
        said = " ".join(str(cause).split())[:200]
        raise refusal(
            where, f"the library cannot be used: {said}", "is it a library, and may you write it?"
        ) from error


def lock_schema(connection: Connection) -> None:
    """Let one process at a time migrate; SQLite's write lock is enough there."""
    if connection.dialect.name == "postgresql":
        connection.execute(text(f"SELECT pg_advisory_xact_lock({LOCK})"))
