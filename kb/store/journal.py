"""Journals of runs in the database of the MACROPs: what was appended is on disk when `append`
returns.

A journal is only appended to. Its lines count from 1 without gaps, so what is missing would be
seen.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from sqlalchemy import (
    Column,
    Integer,
    MetaData,
    PoolProxiedConnection,
    String,
    Table,
    Text,
    select,
)

from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, nearest_hint
from cellwright.kb.json_text import parse_json
from cellwright.kb.store.database import (
    MIGRATION,
    Database,
    lock_key,
    open_transaction,
    store_refusal,
)

metadata = MetaData()
runs = Table(
    "runs",
    metadata,
    Column("run", String, primary_key=True),
    Column("begun", String, nullable=False),  # date and time, UTC
    Column("document", Text, nullable=False),
)
lines = Table(
    "journal",
    metadata,
    Column("run", String, primary_key=True),
    Column("number", Integer, primary_key=True, autoincrement=False),
    Column("at_ms", Integer, nullable=False),
    Column("kind", String, nullable=False),
    Column("content", Text, nullable=False),
    sqlite_with_rowid=False,
)
JOURNAL_PAGE_LINES = 5_000  # lines that are read at once
# made once: `json.dumps` makes one for each line
_encoded = json.JSONEncoder(ensure_ascii=False).encode


class JournalFailure(Exception):
    """A journal cannot be written: the disk is full, or the database does not answer.

    The message says why.
    """


@dataclass(frozen=True, slots=True)
class JournalLine:
    """One line of a journal: its number, the run's clock, what kind it is, and its content as
    plain JSON.
    """

    number: int
    at_ms: int
    kind: str
    content: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Begun:
    """A run that has a journal: its name, when it began (UTC), and what it was begun with."""

    run: str
    begun: str
    document: Mapping[str, Any]


class Journal(Database):
    """The journals in a database, given by a file or a URL.

    Raises `InvalidInput` if the database cannot be opened.
    """

    def __init__(self, target: str) -> None:
        super().__init__(target, durable=True)
        self._held: PoolProxiedConnection | None = None
        with open_transaction(self._engine, target, writes=True) as connection:
            lock_key(connection, MIGRATION)
            metadata.create_all(connection)

    def close(self) -> None:
        """Give back the connection."""
        if self._held is not None:
            self._held.close()
        super().close()

    def begin(self, run: str, begun: str, document: Mapping[str, Any]) -> bool:
        """Make a journal; False if there is one of this name already."""
        if self.run(run) is not None:
            return False
        with open_transaction(self._engine, self.target, writes=True) as connection:
            row = {"run": run, "begun": begun, "document": json.dumps(document, ensure_ascii=False)}
            connection.execute(runs.insert(), [row])
        return True

    def withdraw(self, run: str) -> None:
        """Take a run off the list if it has no line: it never began."""
        if not self.last(run):
            with open_transaction(self._engine, self.target, writes=True) as connection:
                connection.execute(runs.delete().where(runs.c.run == run))

    def append(self, run: str, group: Sequence[JournalLine]) -> None:
        """Append lines in one transaction, and have them written to the disk.

        Raises `JournalFailure`.
        """
        errors = self._engine.dialect.loaded_dbapi.Error
        lite = self._engine.dialect.name == "sqlite"
        marks = "?, ?, ?, ?, ?" if lite else "%s, %s, %s, %s, %s"
        try:
            held = self._writing()
            cursor = held.cursor()
            if lite:
                cursor.execute("BEGIN IMMEDIATE")
            cursor.executemany(
                f"INSERT INTO journal (run, number, at_ms, kind, content) VALUES ({marks})",
                [(run, *_line_row(line)) for line in group],
            )
            held.commit()
        except errors as error:
            self._forget()
            raise JournalFailure(" ".join(str(error).split())[:200]) from error

    def _writing(self) -> PoolProxiedConnection:
        """The connection that appends."""
        if self._held is None:
            self._held = self._engine.raw_connection()
        return self._held

    def _forget(self) -> None:
        """Give up the connection, and with it what was not committed."""
        held, self._held = self._held, None
        if held is not None:
            held.invalidate()

    def run(self, name: str) -> Begun | None:
        """The run of this name; None if there is none."""
        return next((begun_run for begun_run in self.begun() if begun_run.run == name), None)

    def known(self, name: str) -> Begun:
        """The run of this name. Raises `InvalidInput` if there is none."""
        begun_run = self.run(name)
        if begun_run is None:
            names = [known_run.run for known_run in self.begun()]
            hint = nearest_hint(name, names) or (
                f"one of: {', '.join(names[-8:])}" if names else "it has no runs yet"
            )
            message = f"there is no run of this name in {self.target}"
            raise InvalidInput([Diagnostic(Source(name), "K421", message, hint)])
        return begun_run

    def begun(self) -> tuple[Begun, ...]:
        """All runs, the oldest first."""
        with open_transaction(self._engine, self.target) as connection:
            rows = connection.execute(select(runs).order_by(runs.c.begun, runs.c.run)).all()
        return tuple(
            Begun(run, begun, _line_content(self.target, text)) for run, begun, text in rows
        )

    def last(self, run: str, kind: str = "", before: int | None = None) -> int:
        """The number of the last line, or of the last one of a kind, or `before` another one; 0
        if there is none.
        """
        asked = select(lines.c.number).where(lines.c.run == run)
        asked = asked.where(lines.c.kind == kind) if kind else asked
        asked = asked.where(lines.c.number < before) if before is not None else asked
        # read from the end: a maximum would read all
        asked = asked.order_by(lines.c.number.desc()).limit(1)
        with open_transaction(self._engine, self.target) as connection:
            return int(connection.execute(asked).scalar() or 0)

    def line(self, run: str, number: int) -> JournalLine | None:
        """One line of a run; None if there is none of this number."""
        asked = select(lines.c.at_ms, lines.c.kind, lines.c.content)
        asked = asked.where((lines.c.run == run) & (lines.c.number == number))
        with open_transaction(self._engine, self.target) as connection:
            line_row = connection.execute(asked).first()
        return (
            None
            if line_row is None
            else JournalLine(
                number, line_row[0], line_row[1], _line_content(self.target, line_row[2])
            )
        )

    def lines(
        self, run: str, after: int = 0, kinds: Sequence[str] = (), until: int | None = None
    ) -> Iterator[JournalLine]:
        """The lines of a run behind a number, up to another one if it is given, in order; only
        of some kinds, if they are named.
        """
        while True:
            asked = select(lines.c.number, lines.c.at_ms, lines.c.kind, lines.c.content)
            asked = asked.where((lines.c.run == run) & (lines.c.number > after))
            asked = asked.where(lines.c.kind.in_(kinds)) if kinds else asked
            asked = asked.where(lines.c.number <= until) if until is not None else asked
            with open_transaction(self._engine, self.target) as connection:
                page = connection.execute(
                    asked.order_by(lines.c.number).limit(JOURNAL_PAGE_LINES)
                ).all()
            for number, at_ms, kind, text in page:
                yield JournalLine(number, at_ms, kind, _line_content(self.target, text))
                after = number
            if len(page) < JOURNAL_PAGE_LINES:
                return


def _line_row(line: JournalLine) -> tuple[int, int, str, str]:
    return line.number, line.at_ms, line.kind, _encoded(line.content)


def _line_content(target: str, text: str) -> dict[str, Any]:
    try:
        line_content = parse_json(text)
    except ValueError as error:
        raise store_refusal(
            target, f"a line of the journal cannot be read: {error}", "give another file"
        ) from error
    return line_content if isinstance(line_content, dict) else {}
