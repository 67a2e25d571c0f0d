"""Journals of runs in the database of the MACROPs: what was appended is on disk when `append`
returns.

A journal is only appended to. Its lines count from 1 without gaps, and each carries a digest that
depends on all lines before it (`cellwright.kb.store.journal_chain`). The last number and digest are
kept in a table of their own and are written with the line, so what is missing, changed or exchanged
is seen, and a kill never looks like a cut.
"""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from sqlalchemy import (
    BigInteger,
    Column,
    Connection,
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
    at_one_moment,
    lock_key,
    open_transaction,
    store_refusal,
)
from cellwright.kb.store.journal_chain import (
    ChainHead,
    StoredLine,
    chain_findings,
    first_link,
    next_link,
    seal_of,
)
from cellwright.kb.store.site_key import site_key

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
    Column("at_ms", BigInteger, nullable=False),
    Column("kind", String, nullable=False),
    Column("content", Text, nullable=False),
    Column("link", String(64)),  # NULL in journals that were begun before schema 9
    sqlite_with_rowid=False,
)
heads = Table(
    "journal_heads",
    metadata,
    Column("run", String, primary_key=True),
    Column("number", Integer, nullable=False),
    Column("link", String(64), nullable=False),
    Column("seal", String(64)),
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
    """The journals in a database, given by a file or a URL. With a `key`, heads are sealed; without
    one, the key of the site is taken if it has one.

    Raises `InvalidInput` if the database cannot be opened, or the key cannot be read.
    """

    def __init__(self, target: str, key: bytes | None = None) -> None:
        self._key = site_key() if key is None else key
        super().__init__(target, durable=True)
        self._held: PoolProxiedConnection | None = None
        self._heads: dict[str, ChainHead | None] = {}  # None: a journal without a chain
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
        text = json.dumps(document, ensure_ascii=False)
        head = self._sealed(run, 0, first_link(run, begun, text))
        with open_transaction(self._engine, self.target, writes=True) as connection:
            connection.execute(runs.insert(), [{"run": run, "begun": begun, "document": text}])
            connection.execute(heads.insert(), [{"run": run, **head._asdict()}])
        return True

    def withdraw(self, run: str) -> None:
        """Take a run off the list if it has no line: it never began."""
        if not self.last(run):
            with open_transaction(self._engine, self.target, writes=True) as connection:
                connection.execute(runs.delete().where(runs.c.run == run))
                connection.execute(heads.delete().where(heads.c.run == run))

    def append(self, run: str, group: Sequence[JournalLine]) -> None:
        """Append lines in one transaction, and have them written to the disk.

        Raises `JournalFailure`, also if another process has appended to this journal meanwhile.
        """
        errors = self._engine.dialect.loaded_dbapi.Error
        lite = self._engine.dialect.name == "sqlite"
        mark = "?" if lite else "%s"
        try:
            head = self._head_of(run)
            rows, new = _linked_rows(group, head)
            held = self._writing()
            cursor = held.cursor()
            if lite:
                cursor.execute("BEGIN IMMEDIATE")
            cursor.executemany(
                "INSERT INTO journal (run, number, at_ms, kind, content, link) "
                f"VALUES ({', '.join([mark] * 6)})",
                [(run, *row) for row in rows],
            )
            if head is not None and new is not None:
                new = self._sealed(run, new.number, new.link)
                cursor.execute(
                    f"UPDATE journal_heads SET number = {mark}, link = {mark}, seal = {mark} "
                    f"WHERE run = {mark} AND link = {mark}",
                    (*new, run, head.link),
                )
                if cursor.rowcount != 1:
                    raise JournalFailure("another process has written to the journal of this run")
            held.commit()
        except (errors, InvalidInput) as error:
            self._forget(run)
            raise JournalFailure(" ".join(str(error).split())[:200]) from error
        except JournalFailure:
            self._forget(run)
            raise
        self._heads[run] = new

    def _head_of(self, run: str) -> ChainHead | None:
        """The head behind which the next line is written; None if the journal has no chain."""
        if run not in self._heads:
            with open_transaction(self._engine, self.target) as connection:
                self._heads[run] = _stored_head(connection, run)
        return self._heads[run]

    def _sealed(self, run: str, number: int, link: str) -> ChainHead:
        head = ChainHead(number, link)
        return head if self._key is None else head._replace(seal=seal_of(self._key, run, head))

    def _writing(self) -> PoolProxiedConnection:
        """The connection that appends."""
        if self._held is None:
            self._held = self._engine.raw_connection()
        return self._held

    def _forget(self, run: str) -> None:
        """Give up the connection, and with it what was not committed."""
        self._heads.pop(run, None)
        held, self._held = self._held, None
        if held is not None:
            held.invalidate()

    def require_whole(self, run: str, unchained: bool = False) -> None:
        """Prove that nothing of a journal was changed, exchanged or left out since it was written.

        A journal that has no chain, because an older version began it, is accepted if the caller
        says so; its numbers have no gaps then. Raises `InvalidInput`.
        """
        with open_transaction(at_one_moment(self._engine), self.target) as connection:
            proved = journal_proof(connection, run, self._key)
        if proved.findings:
            said = "; ".join(proved.findings)
            message = f"the journal of run '{run}' is damaged: {said}"
            raise store_refusal(self.target, message, WHOLE_HINT, "K422")
        if not proved.chained and not unchained:
            message = f"the journal of run '{run}' has no digests: an older version began it"
            hint = "--unchained goes on with it: then only its numbers are checked"
            raise store_refusal(self.target, message, hint, "K421")

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


WHOLE_HINT = "`cellwright store restore BACKUP --replace` puts a backup in its place"


class JournalProof(NamedTuple):
    """What a look at a whole journal has shown: what does not fit, how many lines it has, whether
    they are chained, and whether the head has the seal of the key that was given.
    """

    findings: tuple[str, ...]
    lines: int
    chained: bool
    sealed: bool = False


def journal_proof(connection: Connection, run: str, key: bytes | None = None) -> JournalProof:
    """Look at each line of a journal, and at its head."""
    head, first = _stored_head(connection, run), _stored_beginning(connection, run)
    count = 0

    def stored() -> Iterator[StoredLine]:
        nonlocal count
        asked = select(
            lines.c.number, lines.c.at_ms, lines.c.kind, lines.c.content, lines.c.link
        ).where(lines.c.run == run)
        options = {"yield_per": JOURNAL_PAGE_LINES}
        for row in connection.execute(asked.order_by(lines.c.number), execution_options=options):
            count += 1
            yield StoredLine(*row)

    if head is None:
        findings, linked = _unchained_findings(stored())
        return JournalProof(findings, count, chained=linked)
    if first is None:
        return JournalProof(("what the run was begun with is missing",), count, chained=True)
    found = list(chain_findings(first, stored(), head))
    sealed = key is not None and head.seal is not None
    if key is not None and head.seal != seal_of(key, run, head):
        found.append("it is not sealed with this key")
    return JournalProof(tuple(found), count, chained=True, sealed=sealed)


def _unchained_findings(stored: Iterable[StoredLine]) -> tuple[tuple[str, ...], bool]:
    """What does not fit in a journal without a head, and whether it had one."""
    findings, linked = list[str](), False
    for number, line in enumerate(stored, start=1):
        linked |= line.link is not None
        if line.number != number:
            findings.append(f"line {number} is missing")
            break
    return tuple([*findings, "its head is missing"] if linked else findings), linked


def _stored_head(connection: Connection, run: str) -> ChainHead | None:
    asked = select(heads.c.number, heads.c.link, heads.c.seal).where(heads.c.run == run)
    row = connection.execute(asked).first()
    return None if row is None else ChainHead(*row)


def _stored_beginning(connection: Connection, run: str) -> str | None:
    """The digest before the first line of a run."""
    row = connection.execute(select(runs).where(runs.c.run == run)).first()
    return None if row is None else first_link(*row)


def _linked_rows(
    group: Sequence[JournalLine], head: ChainHead | None
) -> tuple[list[tuple[int, int, str, str, str | None]], ChainHead | None]:
    """The rows of lines behind a head, and the head behind them."""
    rows = list[tuple[int, int, str, str, str | None]]()
    for line in group:
        text = _encoded(line.content)
        link = head and next_link(head.link, line.number, line.at_ms, line.kind, text)
        rows.append((line.number, line.at_ms, line.kind, text, link))
        head = ChainHead(line.number, link) if link else None
    return rows, head


def _line_content(target: str, text: str) -> dict[str, Any]:
    try:
        line_content = parse_json(text)
    except ValueError as error:
        raise store_refusal(
            target, f"a line of the journal cannot be read: {error}", "give another file"
        ) from error
    return line_content if isinstance(line_content, dict) else {}
