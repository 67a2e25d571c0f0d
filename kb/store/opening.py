"""Opening a database of Cellwright: made where there is none, brought to the current schema where it is older."""

import sqlite3

from sqlalchemy import Engine
from sqlalchemy.exc import SQLAlchemyError

from kb.store.engines import connected, lock_schema, refusal, transaction, write_ahead
from kb.store.schema import CURRENT, NewerSchema, migrate, version_of


def opened(target: str) -> Engine:
    """The engine of a database, a file or a URL, with all tables in it. Raises `InvalidInput`."""
    engine = connected(target)
    try:
        _prepared(engine, target)
    except BaseException:
        engine.dispose()
        raise
    return engine


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
