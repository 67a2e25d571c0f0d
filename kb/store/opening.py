"""Opens a database of Cellwright. It is made if there is none, and updated if its schema is older."""

import contextlib
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from sqlalchemy import Engine, event
from sqlalchemy.exc import SQLAlchemyError

from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.files import is_file
from cellwright.kb.store.engines import (
    MIGRATION,
    OutOfReach,
    connected,
    is_writable,
    lock,
    refusal,
    refused_by,
    transaction,
    write_ahead,
)
from cellwright.kb.store.schema import CURRENT, NewerSchema, migrate, version_of

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


def reading(target: str) -> Engine:
    """The engine of a library that cannot be opened for writing, because the disk is full say. Raises `InvalidInput`."""
    engine = connected(target, reads=True)
    try:
        _require_current(engine, target)
    except BaseException:
        engine.dispose()
        raise
    return engine


def otherwise(target: str, error: InvalidInput) -> Engine:
    """The engine of a library that cannot be opened for writing: for reading, else of an empty one in memory, which is gone when
    it is closed. Raises the error if it tells a mistake in the name."""
    try:
        return reading(target)
    except InvalidInput:
        if not isinstance(error, OutOfReach):
            raise error from None
    engine = connected(":memory:")
    _prepared(engine, ":memory:")
    return engine


def opened(target: str, durable: bool = False) -> Engine:
    """The engine of a database, given by a file or a URL, with all tables. A file that cannot be written is only read.

    What is committed survives a loss of power if it is `durable`; if not, SQLite may lose the last commits, and nothing else.

    Raises `InvalidInput`.
    """
    engine = connected(target)
    _opened[target] = None
    if durable and engine.dialect.name == "sqlite":
        event.listen(engine, "connect", _sync_commits)
    try:
        if is_writable(engine):
            _prepared(engine, target)
        else:
            _require_current(engine, target)
    except BaseException:
        engine.dispose()
        raise
    return engine


class Database:
    """A database, given by a file or a URL. Its connections are closed at the end of a `with`. Raises `InvalidInput`.

    What is committed survives a loss of power if it is `durable`.
    """

    def __init__(self, target: str, durable: bool = False) -> None:
        self.target = target
        self._engine = self._opened(durable)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close all connections."""
        self._engine.dispose()

    def _opened(self, durable: bool) -> Engine:
        return opened(self.target, durable)


@contextlib.contextmanager
def existing(store: str) -> Iterator[Engine]:
    """The engine of a library that is there, as it is: nothing is made or brought up to date. Raises `InvalidInput`."""
    engine = connected(store)
    try:
        if (
            engine.dialect.name == "sqlite"
            and is_writable(engine)
            and not is_file(Path(engine.url.database or ""))
        ):
            raise refusal(store, "there is no library here", "`cellwright prepare` makes one")
        yield engine
    finally:
        engine.dispose()


def _sync_commits(raw: Any, _record: object) -> None:
    raw.execute("PRAGMA synchronous = FULL")


def _require_current(engine: Engine, target: str) -> None:
    with transaction(engine, target) as connection:
        version = version_of(connection)
    if version != CURRENT:
        said = (
            f"the library has schema {version}, not {CURRENT}, and cannot be updated because it is read-only"
        )
        raise refusal(target, said, "open it once as a user who may write it")


def _prepared(engine: Engine, target: str) -> None:
    try:
        write_ahead(engine)
    except (sqlite3.Error, SQLAlchemyError) as error:
        raise refused_by(error, target, "this cannot be used as a library", "give another file") from error
    try:
        with transaction(engine, target) as connection:
            version = version_of(connection)
        if version != CURRENT:
            with transaction(engine, target, writes=True) as connection:
                lock(connection, MIGRATION)
                migrate(connection)
    except NewerSchema as error:
        raise refusal(target, str(error), "install a newer Cellwright") from error
