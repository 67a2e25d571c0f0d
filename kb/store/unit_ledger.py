"""The ledger of unfinished work: results of finished units, until all are done.

A row has the name of a unit, and a key: a digest of all that its result depends on. A result counts
only for the same key. So a unit whose input was edited is done again, and its new result takes the
place of the old one.
"""

import json
from collections.abc import Callable, Collection, Mapping
from typing import Any

from sqlalchemy import Connection, delete, select
from sqlalchemy.dialects import postgresql, sqlite

from cellwright.kb.json_text import parse_json
from cellwright.kb.store.database import DRAFTS, Database, is_writable, lock_key, open_transaction
from cellwright.kb.store.macrop_library import LibraryDraft
from cellwright.kb.store.macrop_outlines import row_chunks
from cellwright.kb.store.table_schema import units


class UnitStore(Database):
    """The finished units of one kind of work, in a database.

    Raises `InvalidInput` if the database reports an error.
    """

    def __init__(self, target: str, kind: str) -> None:
        super().__init__(target)
        self.kind = kind

    def finished(self, keys: Mapping[str, str]) -> dict[str, dict[str, Any]]:
        """The results of those units, given by name and key, that are finished.

        One that cannot be read is not.
        """
        results: dict[str, dict[str, Any]] = {}
        with open_transaction(self._engine, self.target) as connection:
            for chunk in row_chunks(sorted(keys)):
                mine = (units.c.kind == self.kind) & units.c.name.in_(chunk)
                for name, key, document in connection.execute(
                    select(units.c.name, units.c.key, units.c.document).where(mine)
                ):
                    if key == keys[name] and (result := _read_result(document)) is not None:
                        results[name] = result
        return results

    def keep(self, name: str, key: str, result: Mapping[str, Any]) -> None:
        """Keep the result of a unit, in the place of an older one. To keep the same one twice
        changes nothing.

        In a library that may only be read nothing is kept.
        """
        if is_writable(self._engine):
            with open_transaction(self._engine, self.target, writes=True) as connection:
                self._keep(connection, name, key, result)

    def settle(
        self, name: str, key: str, draft: LibraryDraft, result: Callable[[], Mapping[str, Any]]
    ) -> bool:
        """Write a draft and keep the result of its unit, in one transaction. `result` is asked when
        the draft is written.

        Nothing is written, and the answer is False, if the unit was settled by another process in
        the meantime, or if the library may only be read.
        """
        if not is_writable(self._engine):
            return False
        with open_transaction(self._engine, self.target, writes=True) as connection:
            lock_key(connection, DRAFTS)  # drafts change rows in no common order
            mine = (units.c.kind == self.kind) & (units.c.name == name) & (units.c.key == key)
            if connection.execute(select(units.c.key).where(mine)).first() is not None:
                return False
            draft.write(connection)
            self._keep(connection, name, key, result())
            return True

    def _keep(self, connection: Connection, name: str, key: str, result: Mapping[str, Any]) -> None:
        row = {"key": key, "document": json.dumps(result, ensure_ascii=False)}
        insert = sqlite.insert if connection.dialect.name == "sqlite" else postgresql.insert
        made = insert(units).values(kind=self.kind, name=name, **row)
        connection.execute(made.on_conflict_do_update(index_elements=["kind", "name"], set_=row))

    def clear(self, names: Collection[str]) -> None:
        """Remove the results of units: the whole is finished."""
        if not is_writable(self._engine):
            return
        with open_transaction(self._engine, self.target, writes=True) as connection:
            for chunk in row_chunks(sorted(names)):
                connection.execute(
                    delete(units).where((units.c.kind == self.kind) & units.c.name.in_(chunk))
                )


def _read_result(document: str) -> dict[str, Any] | None:
    try:
        result = parse_json(document)
    except ValueError:
        return None
    return result if isinstance(result, dict) else None
