"""Damage to libraries: bits, bytes and pages of a SQLite file, documents in the rows of any
database; and all that reads them.
"""

import random
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

from sqlalchemy import Column, Integer, select, update

from cellwright.kb.store import Library
from cellwright.kb.store.case_store import Cases
from cellwright.kb.store.database import connect_engine, open_transaction
from cellwright.kb.store.inspection_store import PoseStore, Sequences
from cellwright.kb.store.journal import Journal
from cellwright.kb.store.store_maintenance import check_library, store_tables, write_backup

PAGE = 4096
TEXTS = (
    "",
    "{",
    "[]",
    "null",
    "7",
    '"x"',
    "\x01",
    "é" * 40,
    '{"steps": 3}',
    "[" * 3000,
    "9" * 400,
    "1*x 2*",
)


def damaged(target: str, sound: Path, rows: bool, chance: random.Random) -> Callable[[], None]:
    """Damage a library. The result makes it sound again."""
    if rows:
        return _spoil_rows(target, chance)
    data = bytearray(sound.read_bytes())
    for _ in range(chance.choice((1, 1, 3, 30))):
        spoil(chance, data)
    for end in ("-wal", "-shm"):
        Path(target + end).unlink(missing_ok=True)
    Path(target).write_bytes(data)
    return lambda: (shutil.copy(sound, target), None)[1]


def spoil(chance: random.Random, data: bytearray) -> None:
    """Change some bytes of a database: bits, pages, its end, or its head."""
    pages = max(len(data) // PAGE, 1)
    at, one, other = (
        chance.randrange(len(data)),
        PAGE * chance.randrange(pages),
        PAGE * chance.randrange(pages),
    )
    match chance.randrange(7):
        case 0:
            data[at] ^= 1 << chance.randrange(8)
        case 1:
            data[at : at + 8] = chance.randbytes(8)
        case 2:
            data[one : one + PAGE] = data[other : other + PAGE]
        case 3:
            data[one : one + PAGE] = bytes(PAGE)
        case 4 if len(data) > PAGE:
            del data[at:]
            data.extend(b"\0" * chance.choice((1, 100)))
        case 5:
            data[chance.randrange(min(100, len(data)))] = chance.randrange(256)
        case _:
            data[one + chance.randrange(120) : one + 124] = chance.randbytes(4)


def _spoil_rows(target: str, chance: random.Random) -> Callable[[], None]:
    """Put something strange into a text of some rows of a table."""
    found = [
        (table, column)
        for table in store_tables()
        for column in table.columns
        if not isinstance(column.type, Integer) and not column.foreign_keys and not column.unique
    ]
    table, column = chance.choice(found)
    key: Column[int] | Column[str] = next(iter(table.primary_key.columns))
    engine = connect_engine(target)
    with open_transaction(engine, target, writes=True) as connection:
        before = connection.execute(select(key, column)).all()
        new = (
            chance.choice(TEXTS)
            if column.type.python_type is str
            else chance.choice((-1.0, 1e300, 0.0))
        )
        if isinstance(new, str):
            new = new[: getattr(column.type, "length", None)]  # PostgreSQL takes no longer one
        if before and column is not key and not column.primary_key:
            row = chance.choice(before)[0]
            connection.execute(update(table).where(key == row).values({column.name: new}))

    def undo() -> None:
        with open_transaction(engine, target, writes=True) as connection:
            for row, old in before if column is not key and not column.primary_key else ():
                connection.execute(update(table).where(key == row).values({column.name: old}))
        engine.dispose()

    return undo


def read_everything(
    target: str, domain: str = "cell"
) -> Iterator[tuple[str, Callable[[], object]]]:
    """All that reads a library, by name; where a domain is asked for, with this one."""
    yield "check", lambda: check_library(target)
    yield "MACROPs", lambda: _with(Library, target, lambda found: list(found.all()))
    yield "outlines", lambda: _with(Library, target, lambda found: list(found.outlines(domain)))
    yield "figures", lambda: _with(Library, target, lambda found: found.figures())
    yield (
        "outdated",
        lambda: _with(Library, target, lambda found: found.outdated(domain, lambda _: "new")),
    )
    yield "cases", lambda: _with(Cases, target, lambda found: found.history(domain))
    yield "sequences", lambda: _with(Sequences, target, _sequences(target, domain))
    yield "poses", lambda: _with(PoseStore, target, lambda found: found.of(domain, "shared"))
    yield (
        "journal",
        lambda: _with(
            Journal, target, lambda found: [list(found.lines(each.run)) for each in found.begun()]
        ),
    )
    backup = Path(f"{target}.backup") if "://" not in target else None
    if backup is not None:
        yield "backup", lambda: (backup.unlink(missing_ok=True), write_backup(target, backup))


def _sequences(target: str, domain: str) -> Callable[[Sequences], object]:
    def read(found: Sequences) -> object:
        names = _with(
            Cases, target, lambda cases: [each.exception for each in cases.history(domain)]
        )
        return [found.of(domain, name) for name in names]  # type: ignore[attr-defined]

    return read


def _with(kind: Callable[[str], object], target: str, read: Callable[..., object]) -> object:
    with kind(target) as found:  # type: ignore[attr-defined]
        return read(found)
