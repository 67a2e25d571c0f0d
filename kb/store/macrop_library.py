"""The library of MACROPs in a database, and a draft whose changes wait in memory."""

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace

from sqlalchemy import Connection, Engine, bindparam, delete, func, select
from sqlalchemy.dialects import postgresql, sqlite

from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.plan_model import Macrop
from cellwright.kb.store.database import (
    Database,
    fallback_engine,
    is_writable,
    open_transaction,
    store_refusal,
)
from cellwright.kb.store.macrop_documents import Figures, Record, Stored, Use, dumps, loads
from cellwright.kb.store.macrop_outlines import Outline, SharedTexts, row_chunks, words_of
from cellwright.kb.store.table_schema import (
    depends_text,
    macrops,
    outlines,
    text_fingerprint,
    usage,
    version_of,
)
from cellwright.kb.store.term_notation import NotationError, Requirement
from cellwright.kb.store.usage_counts import (
    Utility,
    UtilityFigures,
    add_figures,
    add_trials,
    add_uses,
    figures_in,
    library_holdings,
    trials_of,
)
from cellwright.kb.store.usage_counts import UtilityFigures as Utilities


class Library(Database):
    """A library in a database. Every method is one transaction, and raises `InvalidInput` if the
    database reports an error.

    A library that is not `writable` can still be read; then uses are not counted. Beside an answer
    that matters more (`beside`), what cannot be written is not raised: `loss` says why, and nothing
    more is written. If the system or the server refuses even to open it, the library is empty.
    """

    def __init__(self, target: str, beside: bool = False) -> None:
        """Open a library. It is made if it does not exist, and updated to the current schema.

        `target` is a file or a URL.
        """
        self.beside, self.loss = beside, ""
        super().__init__(target)
        self.writable = is_writable(self._engine) and not self.loss
        self._shared = SharedTexts()

    def _opened(self, durable: bool) -> Engine:
        try:
            return super()._opened(durable)
        except InvalidInput as error:
            if not self.beside:
                raise
            engine = fallback_engine(self.target, error)
            self._lose(error)
            return engine

    def _lose(self, error: InvalidInput) -> None:
        if not self.beside:
            raise error
        self.loss, self.writable = error.diagnostics[0].message, False

    def kept(self, write: Callable[[], None]) -> None:
        """Call a function that writes, unless something is lost already.

        Raises `InvalidInput`, if not `beside` an answer.
        """
        try:
            if not self.loss:
                write()
        except InvalidInput as error:
            self._lose(error)

    def add(self, records: Iterable[Record]) -> list[int | None]:
        """Store MACROPs. Returns the number of each, None for those that were stored before, or
        are lost.
        """
        made = list(records)
        numbers: list[int | None] = []
        self.kept(lambda: numbers.extend(self._add(made)))
        return numbers or [None] * len(made)

    def _add(self, records: Iterable[Record]) -> list[int | None]:
        texts = [(record, dumps(record.macrop)) for record in records]
        try:
            with open_transaction(self._engine, self.target, writes=True) as connection:
                return self._stored_by(connection, texts)
        except BaseException:
            self._shared.forget()
            raise

    def _stored_by(
        self, connection: Connection, texts: Sequence[tuple[Record, str]]
    ) -> list[int | None]:
        """Store MACROPs with their documents in a transaction; their numbers, None for those
        that were stored before.
        """
        numbers = [_insert_macrop(connection, macrop_record, text) for macrop_record, text in texts]
        self._describe(connection, [(n, r) for n, (r, _) in zip(numbers, texts, strict=True) if n])
        return numbers

    def _describe(self, connection: Connection, new: list[tuple[int, Record]]) -> None:
        """Store the outlines of new MACROPs, and zero uses for each."""
        if not new:
            return
        proofs = {number: depends_text(record.macrop.depends) for number, record in new}
        required = (text for _, record in new for text, _ in record.requirements or ())
        shared = self._shared.numbers(connection, {*proofs.values(), *required})
        rows = [
            {
                "macrop": number,
                "depends": shared[proofs[number]],
                "cost": record.macrop.cost,
                "requirements": _requirement_words(record.requirements, shared),
            }
            for number, record in new
        ]
        connection.execute(outlines.insert(), rows)
        unused = [
            {"macrop": n, "uses": 0, "planning_s": r.planning_s, "lookup_s": 0.0} for n, r in new
        ]
        connection.execute(usage.insert(), unused)

    def outlines(self, domain: str, signature: str | None = None, above: int = 0) -> list[Outline]:
        """The MACROPs of a domain with numbers greater than `above`, by number; only for goals
        of one signature if it is given.
        """
        where = (macrops.c.domain == domain) & (macrops.c.id > above)
        if signature is not None:
            where &= macrops.c.signature == signature
        with open_transaction(self._engine, self.target, apart=True) as connection:
            return self._shared.outlines(connection, where)

    def holdings(self, domain: str, last: int | None = None) -> tuple[int, int, str]:
        """How many MACROPs of a domain there are, and number and fingerprint of the last; only
        those up to `last` if it is given.
        """
        with open_transaction(self._engine, self.target, apart=True) as connection:
            return library_holdings(connection, domain, last)

    def note_outlines(
        self, outlined: Iterable[tuple[Macrop, int, tuple[Requirement, ...]]]
    ) -> None:
        """Store requirements that were computed for MACROPs of older versions, by number."""
        new = list(outlined) if self.writable else []
        if new:
            self.kept(lambda: self._note_outlines(new))

    def _note_outlines(self, new: list[tuple[Macrop, int, tuple[Requirement, ...]]]) -> None:
        try:
            with open_transaction(self._engine, self.target, writes=True) as connection:
                shared = self._shared.numbers(
                    connection, {text for _, _, own in new for text, _ in own}
                )
                rows = [
                    {"number": number, "own_cost": macrop.cost, "words": words_of(own, shared)}
                    for macrop, number, own in new
                ]
                values: dict[str, object] = {
                    "cost": bindparam("own_cost"),
                    "requirements": bindparam("words"),
                }
                made = (
                    outlines.update().where(outlines.c.macrop == bindparam("number")).values(values)
                )
                connection.execute(made, rows)
        except BaseException:
            self._shared.forget()
            raise

    def serving(self, domain: str, signature: str) -> list[Stored]:
        """The MACROPs stored under one signature, with their documents, by number."""
        return self._read((macrops.c.domain == domain) & (macrops.c.signature == signature))

    def all(self, domain: str = "") -> list[Stored]:
        """All MACROPs, or those of one domain if it is named, by number."""
        return self._read(macrops.c.domain == domain if domain else None)

    def among(self, numbers: Collection[int]) -> list[Stored]:
        """The MACROPs with these numbers."""
        chunks_read = (self._read(macrops.c.id.in_(chunk)) for chunk in row_chunks(sorted(numbers)))
        return [stored_macrop for chunk in chunks_read for stored_macrop in chunk]

    def numbered(self, number: int) -> Stored | None:
        """One MACROP by its number."""
        return next(iter(self._read(macrops.c.id == number)), None)

    def macrop(self, number: int) -> Macrop | None:
        """One MACROP by its number, without its uses."""
        with open_transaction(self._engine, self.target, apart=True) as connection:
            row = connection.execute(_MACROP_BY_NUMBER, {"own": number}).first()
        return self._parsed(number, *row) if row is not None else None

    def _read(self, where: object) -> list[Stored]:
        columns = (macrops.c.id, macrops.c.document, macrops.c.fingerprint, macrops.c.signature)
        figures = (usage.c.uses, usage.c.planning_s, usage.c.lookup_s)
        asked = select(*columns, *figures).outerjoin_from(macrops, usage).order_by(macrops.c.id)
        if where is not None:
            asked = asked.where(where)  # type: ignore[arg-type]
        with open_transaction(self._engine, self.target) as connection:
            rows = connection.execute(asked).all()
        return [self._stored(*row) for row in rows]

    def _stored(
        self,
        number: int,
        text: str,
        digest: str,
        signature: str,
        uses: int | None,
        planning_s: float | None,
        lookup_s: float | None,
    ) -> Stored:
        macrop = self._parsed(number, text, digest)
        return Stored(number, macrop, signature, uses or 0, planning_s or 0.0, lookup_s or 0.0)

    def _parsed(self, number: int, text: str, digest: str) -> Macrop:
        try:
            if not isinstance(text, str) or text_fingerprint(text) != digest:
                raise NotationError("it does not fit its fingerprint")
            return loads(text)
        except NotationError as error:
            hint = f"`cellwright macros forget {number}` removes it"
            raise store_refusal(
                self.target, f"MACROP {number} cannot be read: {error}", hint
            ) from error

    def outdated(self, domain: str, digest: Callable[[str], str]) -> dict[int, tuple[str, ...]]:
        """The MACROPs of a domain that depend on parts with a new `digest`, with the names of
        these parts.
        """
        own = select(outlines.c.macrop, outlines.c.depends).join_from(outlines, macrops)
        with open_transaction(self._engine, self.target) as connection:
            rests = connection.execute(own.where(macrops.c.domain == domain)).all()
            depends = self._shared.depends(connection, {proof for _, proof in rests})
        changed = {
            proof: tuple(sorted(part for part, old in parts.items() if digest(part) != old))
            for proof, parts in depends.items()
        }
        return {
            number: changed[proof] for number, proof in sorted(map(tuple, rests)) if changed[proof]
        }

    def forget(self, numbers: Collection[int]) -> int:
        """Remove MACROPs; returns how many were found."""
        counts = [0]
        self.kept(lambda: counts.append(self._forget(numbers)))
        return counts[-1]

    def _forget(self, numbers: Collection[int]) -> int:
        with open_transaction(self._engine, self.target, writes=True) as connection:
            return remove_macrops(connection, numbers)

    def note_uses(self, uses: Mapping[int, Use]) -> None:
        """Add uses to MACROPs."""
        if uses and self.writable:
            self._written(lambda connection: add_uses(connection, uses), len(uses) == 1)

    def trials(self, domain: str, signature: str) -> tuple[int, int]:
        """How often plans for goals of one signature could be composed of MACROPs, and how
        often not.
        """
        with open_transaction(self._engine, self.target, apart=True) as connection:
            return trials_of(connection, domain, signature)

    def note_trial(self, domain: str, signature: str, success: bool) -> None:
        """Count one more attempt to compose a plan."""
        if self.writable:
            counts = (int(success), int(not success))
            self._written(
                lambda connection: add_trials(connection, domain, signature, *counts), apart=True
            )

    def utilities(self, domain: str = "") -> dict[tuple[int, str], Utility]:
        """The usefulness of all sub-sequences, or of those of one domain if it is named."""
        with open_transaction(self._engine, self.target) as connection:
            return figures_in(connection, domain)

    def note_utilities(self, more: Utilities) -> None:
        """Add to the usefulness of sub-sequences. What is said of removed MACROPs is dropped."""
        if more:
            self._written(lambda connection: add_figures(connection, more))

    def _written(self, write: Callable[[Connection], None], apart: bool = False) -> None:
        def whole() -> None:
            with open_transaction(
                self._engine, self.target, writes=True, apart=apart
            ) as connection:
                write(connection)

        self.kept(whole)

    def figures(self) -> Figures:
        """The figures of the library."""
        shapes = select(macrops.c.domain, macrops.c.signature).distinct().subquery()
        saved = func.sum(usage.c.uses * usage.c.planning_s - usage.c.lookup_s)
        by_domain = (
            select(macrops.c.domain, func.count())
            .group_by(macrops.c.domain)
            .order_by(macrops.c.domain)
        )
        with open_transaction(self._engine, self.target) as connection:
            domains = {str(name): int(count) for name, count in connection.execute(by_domain)}
            uses, seconds = connection.execute(select(func.sum(usage.c.uses), saved)).one()
            count = connection.execute(select(func.count()).select_from(shapes)).scalar_one()
            schema = version_of(connection)
        return Figures(
            sum(domains.values()), count, int(uses or 0), float(seconds or 0.0), domains, schema
        )


_MACROP_BY_NUMBER = select(macrops.c.document, macrops.c.fingerprint).where(
    macrops.c.id == bindparam("own")
)


def remove_macrops(connection: Connection, numbers: Collection[int]) -> int:
    """Remove MACROPs in a transaction; how many were there."""
    return sum(
        connection.execute(delete(macrops).where(macrops.c.id.in_(chunk))).rowcount
        for chunk in row_chunks(sorted(numbers))
    )


def _insert_macrop(connection: Connection, record: Record, text: str) -> int | None:
    """The number of a new MACROP; None if it was stored before."""
    macrop = record.macrop
    insert = sqlite.insert if connection.dialect.name == "sqlite" else postgresql.insert
    made = insert(macrops).values(
        domain=macrop.domain,
        signature=record.signature,
        name=str(macrop.name),
        fingerprint=text_fingerprint(text),
        document=text,
        steps=len(macrop.steps),
    )
    row = connection.execute(made.on_conflict_do_nothing().returning(macrops.c.id)).first()
    return int(row[0]) if row is not None else None


def _requirement_words(
    requirements: tuple[Requirement, ...] | None, numbers: Mapping[str, int]
) -> str | None:
    return words_of(requirements, numbers) if requirements is not None else None


FIRST_DRAFT_NUMBER = (
    2**31
)  # the first number of a MACROP that is not written: above all numbers that a database gives
NO_USE = Use(0, 0.0)


class LibraryDraft(Library):
    """A library as one who changes it sees it: what is stored, and the changes. Nobody else sees
    them before `write`.

    A new MACROP has a number above all stored ones until it is written; `numbers` then gives its
    number in the library.
    """

    def __init__(self, target: str) -> None:
        super().__init__(target)
        self.numbers: dict[int, int] = {}
        self._new: dict[int, tuple[Record, str]] = {}
        self._gone: set[int] = set()
        self._uses: dict[int, Use] = {}
        self._trials: Counter[tuple[str, str, bool]] = Counter()
        self._utilities: dict[tuple[int, str], Utility] = {}
        self._next = FIRST_DRAFT_NUMBER

    def settled(self, number: int | None) -> int | None:
        """The number of a MACROP in the library; None for one that was not written."""
        return number if number is None or number < FIRST_DRAFT_NUMBER else self.numbers.get(number)

    def add(self, records: Iterable[Record]) -> list[int | None]:
        """See `Library`."""
        return [self._added(record, dumps(record.macrop)) for record in records]

    def _added(self, record: Record, text: str) -> int | None:
        if any(text == other for _, other in self._new.values()) or self._is_stored(text):
            return None
        self._next += 1
        self._new[self._next] = record, text
        return self._next

    def _is_stored(self, text: str) -> bool:
        with open_transaction(self._engine, self.target) as connection:
            return bool(_stored_numbers(connection, [text]))

    def serving(self, domain: str, signature: str) -> list[Stored]:
        """See `Library`."""
        stored = [
            stored_macrop
            for stored_macrop in super().serving(domain, signature)
            if stored_macrop.id not in self._gone
        ]
        new = [
            Stored(number, record.macrop, signature, planning_s=record.planning_s)
            for number, (record, _) in self._new.items()
            if (record.macrop.domain, record.signature) == (domain, signature)
        ]
        return [self._used(stored_macrop) for stored_macrop in (*stored, *new)]

    def _used(self, stored_macrop: Stored) -> Stored:
        more = self._uses.get(stored_macrop.id, NO_USE)
        return replace(
            stored_macrop,
            uses=stored_macrop.uses + more.times,
            lookup_s=stored_macrop.lookup_s + more.lookup_s,
        )

    def forget(self, numbers: Collection[int]) -> int:
        """See `Library`."""
        for number in numbers:
            if self._new.pop(number, None) is None:
                self._gone.add(number)
        return len(numbers)

    def note_uses(self, uses: Mapping[int, Use]) -> None:
        """See `Library`."""
        for number, more in uses.items():
            before = self._uses.get(number, NO_USE)
            self._uses[number] = Use(before.times + more.times, before.lookup_s + more.lookup_s)

    def trials(self, domain: str, signature: str) -> tuple[int, int]:
        """See `Library`."""
        successes, failures = super().trials(domain, signature)
        return successes + self._trials[domain, signature, True], failures + self._trials[
            domain, signature, False
        ]

    def note_trial(self, domain: str, signature: str, success: bool) -> None:
        """See `Library`."""
        self._trials[domain, signature, success] += 1

    def utilities(self, domain: str = "") -> dict[tuple[int, str], Utility]:
        """See `Library`. Those of other domains are not asked of a draft."""
        all_utilities = super().utilities(domain)
        for key, more in self._utilities.items():
            all_utilities[key] = all_utilities.get(key, Utility()) + more
        return all_utilities

    def note_utilities(self, more: UtilityFigures) -> None:
        """See `Library`."""
        for key, utility in more.items():
            self._utilities[key] = self._utilities.get(key, Utility()) + utility

    def write(self, connection: Connection) -> None:
        """Write all changes in a transaction.

        A MACROP that another process has stored meanwhile counts for this one.
        """
        self._shared.forget()
        numbers = self._stored_by(connection, list(self._new.values()))
        others = _stored_numbers(
            connection,
            (t for n, (_, t) in zip(numbers, self._new.values(), strict=True) if n is None),
        )
        self.numbers = {
            own: number if number is not None else others[text]
            for number, (own, (_, text)) in zip(numbers, self._new.items(), strict=True)
        }
        add_uses(connection, self._by_number(self._uses))
        for domain, signature in sorted({key[:2] for key in self._trials}):
            counts = (self._trials[domain, signature, success] for success in (True, False))
            add_trials(connection, domain, signature, *counts)
        figures = {
            (self.settled(n), search): utility for (n, search), utility in self._utilities.items()
        }
        add_figures(
            connection,
            {(n, search): utility for (n, search), utility in figures.items() if n is not None},
        )
        remove_macrops(connection, self._gone)

    def _by_number(self, uses: Mapping[int, Use]) -> dict[int, Use]:
        uses_by_number = {self.settled(number): use for number, use in uses.items()}
        return {number: use for number, use in uses_by_number.items() if number is not None}


def _stored_numbers(connection: Connection, texts: Iterable[str]) -> dict[str, int]:
    """The numbers of those MACROPs, given by their documents, that are stored."""
    digests = {text_fingerprint(text): text for text in texts}
    numbers_by_text: dict[str, int] = {}
    for chunk in row_chunks(sorted(digests)):
        asked = select(macrops.c.fingerprint, macrops.c.id).where(macrops.c.fingerprint.in_(chunk))
        numbers_by_text.update(
            (digests[digest], number) for digest, number in connection.execute(asked)
        )
    return numbers_by_text
