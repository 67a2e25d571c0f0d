"""What a store holds, so that two can be compared."""

from pathlib import Path
from typing import Any

from sqlalchemy import text

from cellwright.kb.store.database import connect_engine


def rows(store: str, table: str) -> list[tuple[Any, ...]]:
    """The rows of a table; none if the database or the table is not there at this moment."""
    engine = connect_engine(store) if "://" in store or Path(store).is_file() else None
    if engine is None:
        return []
    try:
        with engine.connect() as connection:
            return [tuple(row) for row in connection.execute(text(f"SELECT * FROM {table}"))]
    except Exception:  # the driver of a database that was just killed raises what it likes
        return []
    finally:
        engine.dispose()


def knowledge(store: str) -> dict[str, Any]:
    """What a store holds, without the numbers that its rows got and the seconds that work took."""
    macrops = {row[0]: row for row in rows(store, "macrops")}
    return {
        "macrops": sorted(row[1:] for row in macrops.values()),
        "counted": sorted((macrops[row[0]][4], row[1]) for row in rows(store, "usage")),
        "sub-sequences": sorted((macrops[row[0]][4], *row[1:]) for row in rows(store, "utility")),
        "trials": sorted(rows(store, "trials")),
        "texts": sorted(row[1:] for row in rows(store, "shared")),
        "sequences": sorted(rows(store, "sequences")),
        "poses": sorted(rows(store, "poses")),
        "ledger": rows(store, "units"),
    }
