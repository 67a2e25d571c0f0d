"""A library of MACROPs: the MACROPs, what each proof depends on, and how often each was used."""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence

from sqlalchemy import Connection, Engine, bindparam, delete, func, select
from sqlalchemy.dialects import postgresql, sqlite

from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.macro import Macrop
from cellwright.kb.store.counts import add_trials, add_uses, holdings, trials_of
from cellwright.kb.store.documents import dumps, loads
from cellwright.kb.store.engines import is_writable, refusal, transaction
from cellwright.kb.store.notation import NotationError, Requirement
from cellwright.kb.store.opening import Database, otherwise
from cellwright.kb.store.outlines import Outline, SharedTexts, chunks, words_of
from cellwright.kb.store.records import Figures, Record, Stored, Use
from cellwright.kb.store.schema import depends_text, fingerprint, macrops, outlines, usage, version_of
from cellwright.kb.store.utilities import Figures as Utilities
from cellwright.kb.store.utilities import Utility, add_figures, figures_in


class Library(Database):
    """A library in a database. Every method is one transaction, and raises `InvalidInput` if the database reports an error.

    A library that is not `writable` can still be read; then uses are not counted. Beside an answer that matters more
    (`beside`), what cannot be written is not raised: `loss` says why, and nothing more is written. If the system or the server
    refuses even to open it, the library is empty.
    """

    def __init__(self, target: str, beside: bool = False) -> None:
        """Open a library. It is made if it does not exist, and updated to the current schema. `target` is a file or a URL."""
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
            engine = otherwise(self.target, error)
            self._lose(error)
            return engine

    def _lose(self, error: InvalidInput) -> None:
        if not self.beside:
            raise error
        self.loss, self.writable = error.diagnostics[0].message, False

    def kept(self, write: Callable[[], None]) -> None:
        """Call a function that writes, unless something is lost already. Raises `InvalidInput`, if not `beside` an answer."""
        try:
            if not self.loss:
                write()
        except InvalidInput as error:
            self._lose(error)

    def add(self, records: Iterable[Record]) -> list[int | None]:
        """Store MACROPs. Returns the number of each, None for those that were stored before, or are lost."""
        made = list(records)
        numbers: list[int | None] = []
        self.kept(lambda: numbers.extend(self._add(made)))
        return numbers or [None] * len(made)

    def _add(self, records: Iterable[Record]) -> list[int | None]:
        texts = [(each, dumps(each.macrop)) for each in records]
        try:
            with transaction(self._engine, self.target, writes=True) as connection:
                return self._stored_by(connection, texts)
        except BaseException:
            self._shared.forget()
            raise

    def _stored_by(self, connection: Connection, texts: Sequence[tuple[Record, str]]) -> list[int | None]:
        """Store MACROPs with their documents in a transaction; their numbers, None for those that were stored before."""
        numbers = [_insert(connection, each, text) for each, text in texts]
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
                "requirements": _words(record.requirements, shared),
            }
            for number, record in new
        ]
        connection.execute(outlines.insert(), rows)
        unused = [{"macrop": n, "uses": 0, "planning_s": r.planning_s, "lookup_s": 0.0} for n, r in new]
        connection.execute(usage.insert(), unused)

    def outlines(self, domain: str, signature: str | None = None, above: int = 0) -> list[Outline]:
        """The MACROPs of a domain with numbers greater than `above`, by number; only for goals of one signature if it is given."""
        where = (macrops.c.domain == domain) & (macrops.c.id > above)
        if signature is not None:
            where &= macrops.c.signature == signature
        with transaction(self._engine, self.target, apart=True) as connection:
            return self._shared.outlines(connection, where)

    def holdings(self, domain: str, last: int | None = None) -> tuple[int, int, str]:
        """How many MACROPs of a domain there are, and number and fingerprint of the last; only those up to `last` if it is given."""
        with transaction(self._engine, self.target, apart=True) as connection:
            return holdings(connection, domain, last)

    def note_outlines(self, found: Iterable[tuple[Macrop, int, tuple[Requirement, ...]]]) -> None:
        """Store requirements that were computed for MACROPs of older versions, by number."""
        new = list(found) if self.writable else []
        if new:
            self.kept(lambda: self._note_outlines(new))

    def _note_outlines(self, new: list[tuple[Macrop, int, tuple[Requirement, ...]]]) -> None:
        try:
            with transaction(self._engine, self.target, writes=True) as connection:
                shared = self._shared.numbers(connection, {text for _, _, own in new for text, _ in own})
                rows = [
                    {"number": number, "own_cost": each.cost, "words": words_of(own, shared)}
                    for each, number, own in new
                ]
                values: dict[str, object] = {
                    "cost": bindparam("own_cost"),
                    "requirements": bindparam("words"),
                }
                made = outlines.update().where(outlines.c.macrop == bindparam("number")).values(values)
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
        found = (self._read(macrops.c.id.in_(chunk)) for chunk in chunks(sorted(numbers)))
        return [each for chunk in found for each in chunk]

    def numbered(self, number: int) -> Stored | None:
        """One MACROP by its number."""
        return next(iter(self._read(macrops.c.id == number)), None)

    def macrop(self, number: int) -> Macrop | None:
        """One MACROP by its number, without its uses."""
        with transaction(self._engine, self.target, apart=True) as connection:
            row = connection.execute(_NUMBERED, {"own": number}).first()
        return self._parsed(number, *row) if row is not None else None

    def _read(self, where: object) -> list[Stored]:
        columns = (macrops.c.id, macrops.c.document, macrops.c.fingerprint, macrops.c.signature)
        figures = (usage.c.uses, usage.c.planning_s, usage.c.lookup_s)
        asked = select(*columns, *figures).outerjoin_from(macrops, usage).order_by(macrops.c.id)
        if where is not None:
            asked = asked.where(where)  # type: ignore[arg-type]
        with transaction(self._engine, self.target) as connection:
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
            if not isinstance(text, str) or fingerprint(text) != digest:
                raise NotationError("it does not fit its fingerprint")
            return loads(text)
        except NotationError as error:
            hint = f"`cellwright macros forget {number}` removes it"
            raise refusal(self.target, f"MACROP {number} cannot be read: {error}", hint) from error

    def outdated(self, domain: str, digest: Callable[[str], str]) -> dict[int, tuple[str, ...]]:
        """The MACROPs of a domain that depend on parts with a new `digest`, with the names of these parts."""
        own = select(outlines.c.macrop, outlines.c.depends).join_from(outlines, macrops)
        with transaction(self._engine, self.target) as connection:
            rests = connection.execute(own.where(macrops.c.domain == domain)).all()
            depends = self._shared.depends(connection, {proof for _, proof in rests})
        changed = {
            proof: tuple(sorted(part for part, old in parts.items() if digest(part) != old))
            for proof, parts in depends.items()
        }
        return {number: changed[proof] for number, proof in sorted(map(tuple, rests)) if changed[proof]}

    def forget(self, numbers: Collection[int]) -> int:
        """Remove MACROPs; returns how many were found."""
        counts = [0]
        self.kept(lambda: counts.append(self._forget(numbers)))
        return counts[-1]

    def _forget(self, numbers: Collection[int]) -> int:
        with transaction(self._engine, self.target, writes=True) as connection:
            return removed(connection, numbers)

    def note_uses(self, uses: Mapping[int, Use]) -> None:
        """Add uses to MACROPs."""
        if uses and self.writable:
            self._written(lambda connection: add_uses(connection, uses), len(uses) == 1)

    def trials(self, domain: str, signature: str) -> tuple[int, int]:
        """How often plans for goals of one signature could be composed of MACROPs, and how often not."""
        with transaction(self._engine, self.target, apart=True) as connection:
            return trials_of(connection, domain, signature)

    def note_trial(self, domain: str, signature: str, success: bool) -> None:
        """Count one more attempt to compose a plan."""
        if self.writable:
            counts = (int(success), int(not success))
            self._written(lambda connection: add_trials(connection, domain, signature, *counts), apart=True)

    def utilities(self, domain: str = "") -> dict[tuple[int, str], Utility]:
        """The usefulness of all sub-sequences, or of those of one domain if it is named."""
        with transaction(self._engine, self.target) as connection:
            return figures_in(connection, domain)

    def note_utilities(self, more: Utilities) -> None:
        """Add to the usefulness of sub-sequences. What is said of removed MACROPs is dropped."""
        if more:
            self._written(lambda connection: add_figures(connection, more))

    def _written(self, write: Callable[[Connection], None], apart: bool = False) -> None:
        def whole() -> None:
            with transaction(self._engine, self.target, writes=True, apart=apart) as connection:
                write(connection)

        self.kept(whole)

    def figures(self) -> Figures:
        """The figures of the library."""
        shapes = select(macrops.c.domain, macrops.c.signature).distinct().subquery()
        saved = func.sum(usage.c.uses * usage.c.planning_s - usage.c.lookup_s)
        by_domain = (
            select(macrops.c.domain, func.count()).group_by(macrops.c.domain).order_by(macrops.c.domain)
        )
        with transaction(self._engine, self.target) as connection:
            domains = {str(name): int(count) for name, count in connection.execute(by_domain)}
            uses, seconds = connection.execute(select(func.sum(usage.c.uses), saved)).one()
            count = connection.execute(select(func.count()).select_from(shapes)).scalar_one()
            schema = version_of(connection)
        return Figures(sum(domains.values()), count, int(uses or 0), float(seconds or 0.0), domains, schema)


_NUMBERED = select(macrops.c.document, macrops.c.fingerprint).where(macrops.c.id == bindparam("own"))


def removed(connection: Connection, numbers: Collection[int]) -> int:
    """Remove MACROPs in a transaction; how many were there."""
    return sum(
        connection.execute(delete(macrops).where(macrops.c.id.in_(chunk))).rowcount
        for chunk in chunks(sorted(numbers))
    )


def _insert(connection: Connection, record: Record, text: str) -> int | None:
    """The number of a new MACROP; None if it was stored before."""
    macrop = record.macrop
    insert = sqlite.insert if connection.dialect.name == "sqlite" else postgresql.insert
    made = insert(macrops).values(
        domain=macrop.domain,
        signature=record.signature,
        name=str(macrop.name),
        fingerprint=fingerprint(text),
        document=text,
        steps=len(macrop.steps),
    )
    row = connection.execute(made.on_conflict_do_nothing().returning(macrops.c.id)).first()
    return int(row[0]) if row is not None else None


def _words(requirements: tuple[Requirement, ...] | None, numbers: Mapping[str, int]) -> str | None:
    return words_of(requirements, numbers) if requirements is not None else None
