"""A library of MACROPs: what was learned, what each proof depends on, and how often it served."""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from types import TracebackType

from sqlalchemy import Connection, delete, func, select
from sqlalchemy.dialects import postgresql, sqlite

from kb.model.macro import Macrop
from kb.store.documents import dumps, fingerprint, loads
from kb.store.engines import refusal, transaction
from kb.store.notation import NotationError
from kb.store.opening import opened
from kb.store.schema import dependencies, macrops, trials, usage, version_of

CHUNK = 500  # rows named in one statement


@dataclass(frozen=True, slots=True)
class Record:
    """A MACROP to be kept, under the signature of its goals. `planning_s` is what planning took when it was learned."""

    macrop: Macrop
    signature: str
    planning_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Stored:
    """A MACROP of a library with its number there, and what it has been good for."""

    id: int
    macrop: Macrop
    signature: str
    uses: int = 0
    planning_s: float = 0.0
    lookup_s: float = 0.0

    @property
    def saved_s(self) -> float:
        """Seconds of planning that it has saved, less what looking it up took."""
        return self.uses * self.planning_s - self.lookup_s


@dataclass(frozen=True, slots=True)
class Use:
    """How often a MACROP served, and the seconds that looking it up took in all."""

    times: int
    lookup_s: float


@dataclass(frozen=True, slots=True)
class Figures:
    """A library in numbers. `domains` counts MACROPs by domain."""

    macrops: int
    shapes: int
    uses: int
    saved_s: float
    domains: Mapping[str, int]
    schema: int


class Library:
    """A library in a database. Every method is one transaction; all of them raise `InvalidInput` where it refuses."""

    def __init__(self, target: str) -> None:
        """Open a library, make it, or bring it to the current schema. `target` is a file or a URL."""
        self.target = target
        self._engine = opened(target)

    def __enter__(self) -> "Library":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Give up all connections."""
        self._engine.dispose()

    def transaction(self, writes: bool = False) -> AbstractContextManager[Connection]:
        """One transaction, for what else is kept about MACROPs. Raises `InvalidInput` where the database refuses."""
        return transaction(self._engine, self.target, writes)

    def add(self, records: Iterable[Record]) -> list[int | None]:
        """Keep MACROPs; the number of each, None for those that are there already."""
        with transaction(self._engine, self.target, writes=True) as connection:
            return [self._add(connection, each) for each in records]

    def _add(self, connection: Connection, record: Record) -> int | None:
        macrop, text = record.macrop, dumps(record.macrop)
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
        if row is None:
            return None
        number = int(row[0])
        parts = [{"macrop": number, "part": p, "digest": d} for p, d in sorted(macrop.depends.items())]
        if parts:
            connection.execute(dependencies.insert(), parts)
        connection.execute(
            usage.insert().values(macrop=number, uses=0, planning_s=record.planning_s, lookup_s=0.0)
        )
        return number

    def serving(self, domain: str, signature: str, above: int = 0) -> list[Stored]:
        """The MACROPs for goals of one signature, in order of number; those beyond a number only."""
        where = (macrops.c.domain == domain) & (macrops.c.signature == signature) & (macrops.c.id > above)
        return self._read(where)

    def all(self, domain: str = "") -> list[Stored]:
        """Every MACROP, of one domain if that is named, in order of number."""
        return self._read(macrops.c.domain == domain if domain else None)

    def numbered(self, number: int) -> Stored | None:
        """One MACROP by its number."""
        return next(iter(self._read(macrops.c.id == number)), None)

    def _read(self, where: object) -> list[Stored]:
        columns = (macrops.c.id, macrops.c.document, macrops.c.signature)
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
        signature: str,
        uses: int | None,
        planning_s: float | None,
        lookup_s: float | None,
    ) -> Stored:
        try:
            macrop = loads(text)
        except NotationError as error:
            hint = f"`cellwright macros forget {number}` removes it"
            raise refusal(self.target, f"MACROP {number} cannot be read: {error}", hint) from error
        return Stored(number, macrop, signature, uses or 0, planning_s or 0.0, lookup_s or 0.0)

    def outdated(self, domain: str, digest: Callable[[str], str]) -> dict[int, tuple[str, ...]]:
        """The MACROPs of a domain that rest on parts which `digest` knows otherwise now, with the names of these parts."""
        own = macrops.c.domain == domain
        pairs = (
            select(dependencies.c.part, dependencies.c.digest)
            .join_from(dependencies, macrops)
            .where(own)
            .distinct()
        )
        with transaction(self._engine, self.target) as connection:
            changed = [(part, old) for part, old in connection.execute(pairs) if digest(part) != old]
            found: dict[int, list[str]] = {}
            for part, old in changed:
                rests = select(macrops.c.id).join_from(dependencies, macrops)
                rests = rests.where(own & (dependencies.c.part == part) & (dependencies.c.digest == old))
                for (number,) in connection.execute(rests):
                    found.setdefault(number, []).append(part)
        return {number: tuple(sorted(parts)) for number, parts in sorted(found.items())}

    def forget(self, numbers: Collection[int]) -> int:
        """Remove MACROPs; how many were there."""
        with transaction(self._engine, self.target, writes=True) as connection:
            return sum(
                connection.execute(delete(macrops).where(macrops.c.id.in_(chunk))).rowcount
                for chunk in _chunks(sorted(numbers))
            )

    def used(self, uses: Mapping[int, Use]) -> None:
        """Add to what MACROPs have been good for."""
        with transaction(self._engine, self.target, writes=True) as connection:
            for number, use in sorted(uses.items()):
                more = {"uses": usage.c.uses + use.times, "lookup_s": usage.c.lookup_s + use.lookup_s}
                connection.execute(usage.update().where(usage.c.macrop == number).values(more))

    def tried(self, domain: str, signature: str) -> tuple[int, int]:
        """How often plans for goals of a kind could be composed of MACROPs, and how often not."""
        own = (trials.c.domain == domain) & (trials.c.signature == signature)
        with transaction(self._engine, self.target) as connection:
            row = connection.execute(select(trials.c.successes, trials.c.failures).where(own)).first()
        return (int(row[0]), int(row[1])) if row else (0, 0)

    def note_trial(self, domain: str, signature: str, success: bool) -> None:
        """Count one more attempt to compose a plan."""
        one, other = int(success), int(not success)
        with transaction(self._engine, self.target, writes=True) as connection:
            insert = sqlite.insert if connection.dialect.name == "sqlite" else postgresql.insert
            made = insert(trials).values(domain=domain, signature=signature, successes=one, failures=other)
            more = {"successes": trials.c.successes + one, "failures": trials.c.failures + other}
            connection.execute(made.on_conflict_do_update(index_elements=["domain", "signature"], set_=more))

    def figures(self) -> Figures:
        """The library in numbers."""
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


def _chunks(numbers: list[int]) -> Iterator[list[int]]:
    for start in range(0, len(numbers), CHUNK):
        yield numbers[start : start + CHUNK]
