"""Opens databases: connections to SQLite and PostgreSQL, transactions, schema updates.

SQLite writers take the lock at the beginning, so that no other process can write between their
reads and writes. Readers see one consistent state and block no one. If a process is killed, its
last transaction is undone completely.

Each message to PostgreSQL and back takes time, above all on a busy machine. Every statement sees a
state of its own there. So a reader, or a writer with one statement, can do without begin and end:
its statements stand apart.
"""

import contextlib
import logging
import os
import select
import sqlite3
import time
import weakref
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, Self
from urllib.parse import quote

from sqlalchemy import URL, Connection, Engine, create_engine, event, make_url, text
from sqlalchemy.exc import ArgumentError, InvalidatePoolError, OperationalError, SQLAlchemyError

from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import is_file
from cellwright.kb.store.table_schema import CURRENT_SCHEMA, NewerSchema, update_schema, version_of

BUSY_S = 60.0  # how long a SQLite writer waits for others
MIGRATION, POSES, DRAFTS = 0x43656C6C, 0x43656C6D, 0x43656C6E  # keys of PostgreSQL's advisory locks
POSTGRES_SCHEMES = ("postgres", "postgresql", "postgresql+psycopg")


class OutOfReach(InvalidInput):
    """The system or the server refuses what was asked of a library: nothing is wrong with its
    name.
    """


def store_refusal(where: str, message: str, hint: str = "", code: str = "K416") -> InvalidInput:
    """The error for a library that cannot be used, with the reason."""
    return InvalidInput([Diagnostic(Source(where), code, message, hint)])


def refused_by(error: Exception, where: str, message: str, hint: str) -> InvalidInput:
    """The error for what a database has reported: `OutOfReach` if it could not do its work."""
    cause = getattr(error, "orig", None) or error
    said = " ".join(next(iter(str(cause).strip().splitlines()), "").split())[:200]
    made = Diagnostic(Source(where), "K416", f"{message}: {said}", hint)
    unable = isinstance(error, (OperationalError, sqlite3.OperationalError))
    return (OutOfReach if unable else InvalidInput)([made])


def store_url(target: str) -> URL:
    """The URL of a library: a path names a SQLite file. Raises `InvalidInput`."""
    if not target.strip() or not target.isprintable() or "%00" in target:
        raise store_refusal("--store", "this is not the name of a library", _ADDRESS_HINT)
    if "://" not in target:
        return URL.create("sqlite", database=_expand_path(target))
    try:
        url = make_url(target)
    except (ArgumentError, ValueError):
        raise store_refusal("--store", "this is not the URL of a library", _ADDRESS_HINT) from None
    if url.drivername in POSTGRES_SCHEMES:
        return _postgres_url(url)
    if url.drivername != "sqlite":
        raise store_refusal(
            "--store", f"a library cannot be kept in '{url.drivername}'", _ADDRESS_HINT
        )
    if not url.database or url.query:
        said = "options are not taken here" if url.query else "the address names no file"
        raise store_refusal("--store", said, _ADDRESS_HINT)
    return url


def _expand_path(file: str) -> str:
    try:
        return str(Path(file).expanduser())
    except RuntimeError:  # nobody has this home
        return file


def _postgres_url(url: URL) -> URL:
    if not url.username:
        raise store_refusal("--store", "the address names no user", _ADDRESS_HINT)
    if url.port is not None and not 0 < url.port < 65_536:
        raise store_refusal(
            "--store", f"{url.port} is not a port", "from 1 to 65535; without one it is 5432"
        )
    return url.set(drivername="postgresql+psycopg")


_ADDRESS_HINT = "give a file, or postgresql://USER@HOST/DATABASE"


def connect_engine(target: str, reads: bool = False) -> Engine:
    """The engine of a library, or one that only `reads`.

    Raises `InvalidInput` if the driver or the folder is missing.
    """
    url = store_url(target)
    if url.drivername == "sqlite":
        return _sqlite_engine(url, reads)
    # a connection that cannot even be closed is told as the error of its statement; nobody needs a
    # traceback of it
    logging.getLogger("sqlalchemy.pool").addHandler(logging.NullHandler())
    try:
        engine = create_engine(url)
    except ModuleNotFoundError:
        hint = "install the extra: pip install 'cellwright[postgres]'"
        raise store_refusal(
            "--store", "the driver for PostgreSQL is not installed", hint, "K414"
        ) from None
    event.listen(engine, "checkout", _require_silent)
    return _note_engine(engine)


def _require_silent(raw: Any, _record: object, _proxy: object) -> None:
    """Replace a connection that has ended while nobody used it.

    A server says nothing unasked but that.
    """
    if raw.closed or _is_readable(raw.fileno()):
        raise InvalidatePoolError("the connection has ended")


def _is_readable(socket: int) -> bool:
    """Whether something has come from the other end, or the other end is gone."""
    if not hasattr(select, "poll"):
        return bool(select.select([socket], [], [], 0)[0])
    poll = select.poll()
    poll.register(socket, select.POLLIN)
    return bool(poll.poll(0))


def _sqlite_engine(url: URL, reads: bool) -> Engine:
    file = Path(url.database or "")
    if not file.parent.is_dir():
        raise store_refusal(
            str(url.database), "the folder of this file does not exist", "make the folder first"
        )
    engine = create_engine(
        _reading_url(file) if reads or _is_kept_from_writing(file) else url,
        connect_args={"timeout": BUSY_S},
    )
    event.listen(engine, "connect", _prepare_connection)
    event.listen(engine, "begin", _begin_transaction)
    return _note_engine(engine)


_OPEN_ENGINES = weakref.WeakSet[Engine]()


def _note_engine(engine: Engine) -> Engine:
    _OPEN_ENGINES.add(engine)
    return engine


def close_all() -> None:
    """Close all connections of this process that nobody works with: it ends."""
    for engine in list(_OPEN_ENGINES):
        engine.dispose()


def _is_kept_from_writing(file: Path) -> bool:
    """Whether a file exists but cannot be written.

    Its folder must be writable too, because the log is beside the file.
    """
    try:
        return file.is_file() and not all(os.access(path, os.W_OK) for path in (file, file.parent))
    except (OSError, ValueError):  # opening the file will report the reason
        return False


def _reading_url(file: Path) -> URL:
    """The URL for reading a file: unchanging, or, if a log beside it shows that others write,
    with their changes.
    """
    log = file.with_name(f"{file.name}-wal")
    logged = log.exists() and log.stat().st_size
    asked = "mode=ro" if logged else "mode=ro&immutable=1"
    return URL.create("sqlite", database=f"file:{quote(str(file))}?{asked}", query={"uri": "true"})


def is_writable(engine: Engine) -> bool:
    """Whether a database may be written."""
    return engine.url.query.get("uri") != "true"


def _prepare_connection(raw: Any, _record: object) -> None:
    # otherwise the driver begins late and upgrades the lock later, which can fail
    raw.isolation_level = None
    raw.execute(f"PRAGMA busy_timeout = {int(BUSY_S * 1000)}")
    raw.execute("PRAGMA foreign_keys = ON")
    raw.execute("PRAGMA synchronous = NORMAL")


def _begin_transaction(connection: Connection) -> None:
    writes = connection.get_execution_options().get("writes", False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")


def write_ahead(engine: Engine) -> None:
    """Switch a SQLite file to a write-ahead log.

    The busy timeout does not cover this, so it is tried repeatedly.
    """
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
def open_transaction(
    engine: Engine, where: str, writes: bool = False, apart: bool = False
) -> Iterator[Connection]:
    """One transaction, undone after any error. Raises `InvalidInput` if the database reports an
    error.

    Its statements may stand `apart`: one that writes must be the only one. Then PostgreSQL is told
    no begin and no end.
    """
    try:
        with _open_connection(engine, writes, apart) as connection, connection.begin():
            yield connection
    except (SQLAlchemyError, UnicodeDecodeError) as error:
        hint = (
            "check that it is a library and that you may write it; `cellwright store check` "
            "looks for damage"
        )
        raise refused_by(error, where, "the library cannot be used", hint) from error


def at_one_moment(engine: Engine) -> Engine:
    """The engine with transactions in which all statements see the same state."""
    lite = engine.dialect.name == "sqlite"  # it knows no other ones
    return engine if lite else engine.execution_options(isolation_level="REPEATABLE READ")


def _open_connection(engine: Engine, writes: bool, apart: bool) -> Connection:
    opened = engine.connect().execution_options(writes=writes)
    return (
        opened.execution_options(isolation_level="AUTOCOMMIT")
        if apart and engine.dialect.name != "sqlite"
        else opened
    )


def lock_key(connection: Connection, key: int) -> None:
    """Let only one process at a time do what a key stands for, until its transaction ends.

    In SQLite, the write lock does that.
    """
    if connection.dialect.name == "postgresql":
        connection.execute(text(f"SELECT pg_advisory_xact_lock({key})"))


_opened: dict[str, None] = {}


def opened_so_far() -> tuple[str, ...]:
    """The libraries that this process has opened since the command began."""
    return tuple(_opened)


def note_opened(target: str) -> None:
    """A library that stayed open is used again."""
    _opened[target] = None


def begin_anew() -> None:
    """Forget the libraries that were opened: another command begins in this process."""
    _opened.clear()


def reading_engine(target: str) -> Engine:
    """The engine of a library that cannot be opened for writing, because the disk is full say.

    Raises `InvalidInput`.
    """
    engine = connect_engine(target, reads=True)
    try:
        _require_current(engine, target)
    except BaseException:
        engine.dispose()
        raise
    return engine


def fallback_engine(target: str, error: InvalidInput) -> Engine:
    """The engine of a library that cannot be opened for writing: for reading, else of an empty one
    in memory, which is gone when it is closed. Raises the error if it tells a mistake in the name.
    """
    try:
        return reading_engine(target)
    except InvalidInput:
        if not isinstance(error, OutOfReach):
            raise error from None
    engine = connect_engine(":memory:")
    _prepare_schema(engine, ":memory:")
    return engine


def open_engine(target: str, durable: bool = False) -> Engine:
    """The engine of a database, given by a file or a URL, with all tables. A file that cannot be
    written is only read.

    What is committed survives a loss of power if it is `durable`; if not, SQLite may lose the last
    commits, and nothing else.

    Raises `InvalidInput`.
    """
    engine = connect_engine(target)
    _opened[target] = None
    if durable and engine.dialect.name == "sqlite":
        event.listen(engine, "connect", _sync_commits)
    try:
        if is_writable(engine):
            _prepare_schema(engine, target)
        else:
            _require_current(engine, target)
    except BaseException:
        engine.dispose()
        raise
    return engine


class Database:
    """A database, given by a file or a URL. Its connections are closed at the end of a `with`.
    Raises `InvalidInput`.

    What is committed survives a loss of power if it is `durable`.
    """

    def __init__(self, target: str, durable: bool = False) -> None:
        self.target = target
        self._engine = self._opened(durable)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close all connections."""
        self._engine.dispose()

    def _opened(self, durable: bool) -> Engine:
        return open_engine(self.target, durable)


@contextlib.contextmanager
def existing_engine(store: str) -> Iterator[Engine]:
    """The engine of a library that is there, as it is: nothing is made or brought up to date.

    Raises `InvalidInput`.
    """
    engine = connect_engine(store)
    try:
        if (
            engine.dialect.name == "sqlite"
            and is_writable(engine)
            and not is_file(Path(engine.url.database or ""))
        ):
            raise store_refusal(store, "there is no library here", "`cellwright prepare` makes one")
        yield engine
    finally:
        engine.dispose()


def _sync_commits(raw: Any, _record: object) -> None:
    raw.execute("PRAGMA synchronous = FULL")


def _require_current(engine: Engine, target: str) -> None:
    with open_transaction(engine, target) as connection:
        version = version_of(connection)
    if version != CURRENT_SCHEMA:
        said = (
            f"the library has schema {version}, not {CURRENT_SCHEMA}, and cannot be updated "
            "because it is read-only"
        )
        raise store_refusal(target, said, "open it once as a user who may write it")


def _prepare_schema(engine: Engine, target: str) -> None:
    try:
        write_ahead(engine)
    except (sqlite3.Error, SQLAlchemyError) as error:
        raise refused_by(
            error, target, "this cannot be used as a library", "give another file"
        ) from error
    try:
        with open_transaction(engine, target) as connection:
            version = version_of(connection)
        if version != CURRENT_SCHEMA:
            with open_transaction(engine, target, writes=True) as connection:
                lock_key(connection, MIGRATION)
                update_schema(connection)
    except NewerSchema as error:
        raise store_refusal(target, str(error), "install a newer Cellwright") from error
