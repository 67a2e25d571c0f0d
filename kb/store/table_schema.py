"""The tables of a store, and the migrations from each version to the next.

A new library goes through all migrations, so that the migrations for old files are used, and
tested, every day.
"""

import hashlib
import json
from collections.abc import Callable, Mapping

from sqlalchemy import (
    Column,
    Connection,
    Float,
    ForeignKey,
    Index,
    Integer,
    MetaData,
    String,
    Table,
    Text,
    UniqueConstraint,
    insert,
    inspect,
    literal,
    select,
    text,
    update,
)

metadata = MetaData()

versions = Table("cellwright_schema", metadata, Column("version", Integer, nullable=False))

macrops = Table(
    "macrops",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("domain", String, nullable=False),
    Column("signature", Text, nullable=False),
    Column("name", Text, nullable=False),
    Column("fingerprint", String(32), nullable=False),
    Column("document", Text, nullable=False),
    Column("steps", Integer, nullable=False),
    UniqueConstraint("fingerprint", name="one_of_each"),
    Index("by_goals", "domain", "signature"),
)

dependencies = Table(
    "dependencies",
    metadata,
    Column("macrop", Integer, ForeignKey("macrops.id", ondelete="CASCADE"), primary_key=True),
    Column("part", String, primary_key=True),
    Column("digest", String(16), nullable=False),
    Index("by_part", "part", "digest"),
)

usage = Table(
    "usage",
    metadata,
    Column("macrop", Integer, ForeignKey("macrops.id", ondelete="CASCADE"), primary_key=True),
    Column("uses", Integer, nullable=False, default=0),
    Column("planning_s", Float, nullable=False, default=0.0),
    Column("lookup_s", Float, nullable=False, default=0.0),
)

trials = Table(
    "trials",
    metadata,
    Column("domain", String, primary_key=True),
    Column("signature", String, primary_key=True),
    Column("successes", Integer, nullable=False, default=0),
    Column("failures", Integer, nullable=False, default=0),
)

sequences = Table(
    "sequences",
    metadata,
    Column("domain", String, primary_key=True),
    Column("problem", String, primary_key=True),
    Column(
        "version", Integer, nullable=False
    ),  # counts the changes: a writer must have read the last version
    Column("document", Text, nullable=False),
)

utility = Table(
    "utility",
    metadata,
    Column("macrop", Integer, ForeignKey("macrops.id", ondelete="CASCADE"), primary_key=True),
    Column("search", String, primary_key=True),
    Column("offered", Integer, nullable=False, default=0),
    Column("used", Integer, nullable=False, default=0),
    Column("trials", Integer, nullable=False, default=0),
    Column("without", Integer, nullable=False, default=0),
    Column("beside", Integer, nullable=False, default=0),
)

# Texts that many MACROPs share: what they depend on, and conditions of the index. Texts are only
# added.
shared = Table(
    "shared",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("fingerprint", String(32), nullable=False),
    Column("text", Text, nullable=False),
    UniqueConstraint("fingerprint", name="one_of_each_text"),
)

outlines = Table(
    "outlines",
    metadata,
    Column("macrop", Integer, ForeignKey("macrops.id", ondelete="CASCADE"), primary_key=True),
    Column("depends", Integer, ForeignKey("shared.id"), nullable=False, index=True),
    Column("cost", Integer),
    Column("requirements", Text),  # numbers of shared texts; NULL in rows of older versions
)

# Where an arm can stand to take measurements: one row for each measurement, tool and station of a
# problem.
poses = Table(
    "poses",
    metadata,
    Column("domain", String, primary_key=True),
    Column("problem", String, primary_key=True),
    Column("measurement", String, primary_key=True),
    Column("tool", String, primary_key=True),
    Column("station", String, primary_key=True),
    Column("document", Text, nullable=False),
)

# Results of finished pieces of a work that is not finished as a whole. `key` is a digest of all
# that a result depends on.
units = Table(
    "units",
    metadata,
    Column("kind", String, primary_key=True),
    Column("name", String, primary_key=True),
    Column("key", String(64), nullable=False),
    Column("document", Text, nullable=False),
)


def _create_first_tables(connection: Connection) -> None:
    metadata.create_all(connection, [macrops, dependencies])


def _with_usage(connection: Connection) -> None:
    metadata.create_all(connection, [usage])
    nothing = select(macrops.c.id, literal(0), literal(0.0), literal(0.0))
    connection.execute(
        insert(usage).from_select(["macrop", "uses", "planning_s", "lookup_s"], nothing)
    )


def _with_trials(connection: Connection) -> None:
    metadata.create_all(connection, [trials])


def _with_sequences(connection: Connection) -> None:
    metadata.create_all(connection, [sequences])


def _with_utility(connection: Connection) -> None:
    metadata.create_all(connection, [utility])


def _with_outlines(connection: Connection) -> None:
    """Store what MACROPs depend on once for all MACROPs that depend on the same parts."""
    metadata.create_all(connection, [shared, outlines])
    depends: dict[int, dict[str, str]] = {
        n: {} for (n,) in connection.execute(select(macrops.c.id))
    }
    for number, part, digest in connection.execute(select(dependencies)):
        depends[number][part] = digest
    texts = {number: depends_text(depends_on) for number, depends_on in sorted(depends.items())}
    if texts:
        rows = [
            {"fingerprint": text_fingerprint(text), "text": text}
            for text in sorted(set(texts.values()))
        ]
        connection.execute(insert(shared), rows)
        numbers = {text: n for n, text in connection.execute(select(shared.c.id, shared.c.text))}
        connection.execute(
            insert(outlines), [{"macrop": n, "depends": numbers[text]} for n, text in texts.items()]
        )
    dependencies.drop(connection)


def depends_text(depends: Mapping[str, str]) -> str:
    """The parts that a MACROP depends on, as text. The same parts give the same text."""
    return json.dumps(dict(sorted(depends.items())), ensure_ascii=False)


def text_fingerprint(text: str) -> str:
    """A hash that distinguishes texts."""
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def _with_poses(connection: Connection) -> None:
    metadata.create_all(connection, [poses])


def _with_units(connection: Connection) -> None:
    metadata.create_all(connection, [units])


def _with_chained_journals(connection: Connection) -> None:
    """Give lines of journals a place for their digest, and times of more than 24 days.

    Journals that are there already stay without a chain.
    """
    if not inspect(connection).has_table("journal"):
        return
    if "link" not in {column["name"] for column in inspect(connection).get_columns("journal")}:
        connection.execute(text("ALTER TABLE journal ADD COLUMN link VARCHAR(64)"))
    if connection.dialect.name == "postgresql":
        connection.execute(text("ALTER TABLE journal ALTER COLUMN at_ms TYPE BIGINT"))


SCHEMA_MIGRATIONS: tuple[Callable[[Connection], None], ...] = (
    _create_first_tables,
    _with_usage,
    _with_trials,
    _with_sequences,
    _with_utility,
    _with_outlines,
    _with_poses,
    _with_units,
    _with_chained_journals,
)
CURRENT_SCHEMA = len(SCHEMA_MIGRATIONS)
FIRST_CHAINED_SCHEMA = 9  # whose journals have chains


class NewerSchema(Exception):
    """The library was written by a later version of Cellwright."""

    def __init__(self, version: int) -> None:
        super().__init__(
            f"the library has schema {version}; this version reads up to {CURRENT_SCHEMA}"
        )


def version_of(connection: Connection) -> int:
    """The version of the tables; 0 if there are none."""
    if not inspect(connection).has_table(versions.name):
        return 0
    return connection.execute(select(versions.c.version)).scalar_one_or_none() or 0


def update_schema(connection: Connection) -> None:
    """Update the tables to the current version, inside the caller's transaction.

    Raises `NewerSchema`.
    """
    version = version_of(connection)
    if version > CURRENT_SCHEMA:
        raise NewerSchema(version)
    if version == CURRENT_SCHEMA:
        return
    metadata.create_all(connection, [versions])
    for step in SCHEMA_MIGRATIONS[version:]:
        step(connection)
    if version or connection.execute(select(versions.c.version)).first() is not None:
        connection.execute(update(versions).values(version=CURRENT_SCHEMA))
    else:
        connection.execute(insert(versions).values(version=CURRENT_SCHEMA))
