"""Opening a database of Cellwright: made where there is none, brought to the current schema where it is older."""

import sqlite3

from sqlalchemy import Engine
from sqlalchemy.exc import SQLAlchemyError

from kb.store.engines import connected, is_writable, lock_schema, refusal, transaction, write_ahead
from kb.store.schema import CURRENT, NewerSchema, migrate, version_of


def opened(target: str) -> Engine:
    """The engine of a database, a file or a URL, with all tables in it; a file that may not be written is only read.

    Raises `InvalidInput`.
    """
    engine = connected(target)
    try:
        if is_writable(engine):
            _prepared(engine, target)
        else:
            _require_current(engine, target)
    except BaseException:
        engine.dispose()
        raise
    return engine


def _require_current(engine: Engine, target: str) -> None:
    with transaction(engine, target) as connection:
        version = version_of(connection)
    if version != CURRENT:
        said = f"the library has schema {version}, not {CURRENT}, and may not be written"
        raise refusal(target, said, "let someone who may write it open it once")


def _prepared(engine: Engine, target: str) -> None:
    try:
        write_ahead(engine)
    except (sqlite3.Error, SQLAlchemyError) as error:
        said = " ".join(str(getattr(error, "orig", error)).split())
        raise refusal(target, f"this cannot be used as a library: {said}", "give another file") from error
    try:
        with transaction(engine, target) as connection:
            version = version_of(connection)
        if version != CURRENT:
            with transaction(engine, target, writes=True) as connection:
                lock_schema(connection)
                migrate(connection)
    except NewerSchema as error:
        raise refusal(target, str(error), "install a newer Cellwright") from error
