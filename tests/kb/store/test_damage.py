"""Whatever happens to the file of a library, each command that uses it answers, and never with
a bug.
"""

import contextlib
import json
import random
import shutil
import sqlite3
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from benchmarks.stores_damage import read_everything, spoil
from cellwright.engine.faces.cli import app
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.store.store_maintenance import store_tables

COMMANDS = [
    ["macros", "list"],
    ["macros", "stats"],
    ["macros", "show", "1"],
    ["plan", "bulkhead/one_point"],
    ["diagnose", "bulkhead", "--history"],
    ["sequence", "bulkhead/one_point", "--next"],
    ["results", "r"],
    ["store", "check"],
]


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A library with MACROPs, a kept sequence, closed cases and a journal."""
    folder = tmp_path_factory.mktemp("sound")
    file = folder / "library.db"
    counts = folder / "counts.json"
    counts.write_text('{"probe_not_seated": {}}')
    for each in (
        ["plan", "bulkhead/one_point"],
        ["plan", "bulkhead/both_tools"],
        ["sequence", "bulkhead/one_point"],
        ["diagnose", "bulkhead", "--history"],
        ["run", "bulkhead/one_point", "--name", "r", "--factor", "0"],
    ):
        told = CliRunner().invoke(app, [*each, "--store", str(file)])
        assert told.exit_code in (0, 2), told.output
    _closed(file)
    return file


def _closed(file: Path) -> None:
    from cellwright.kb.store.case_store import Cases, ClosedCase
    from cellwright.kb.store.database import connect_engine

    with Cases(str(file)) as cases:
        cases.add([ClosedCase("bulkhead", "lost", ("slipped",), 1.0, (("look", "seen"),))] * 3)
    engine = connect_engine(str(file))
    with engine.connect() as connection:
        connection.exec_driver_sql("PRAGMA wal_checkpoint(TRUNCATE)")
    engine.dispose()


def corrupted(sound: Path, folder: Path, seed: int) -> Path:
    """A copy with bits turned, bytes overwritten, pages exchanged, zeroed or cut off."""
    chance, file = random.Random(seed), folder / "library.db"
    for each in folder.iterdir():
        each.unlink()
    shutil.copy(sound, file)
    data = bytearray(file.read_bytes())
    for _ in range(chance.choice((1, 1, 3, 30))):
        spoil(chance, data)
    file.write_bytes(data)
    return file


def bugs(sound: Path, folder: Path, seeds: range) -> Iterator[str]:
    """The internal errors of commands on corrupted copies."""
    for seed in seeds:
        chance = random.Random(-seed - 1)
        command = chance.choice(COMMANDS)
        file = corrupted(sound, folder, seed)
        told = CliRunner().invoke(app, [*command, "--store", str(file), "--format", "json"])
        said = json.loads(told.stdout) if told.stdout else {}
        if told.exit_code not in (0, 1, 2, 10, 12) or said.get("status") == "internal error":
            yield f"{seed} {command} {told.exit_code}: {told.stdout[-300:]} {told.exception!r}"
        if told.exit_code == 2 and not said["diagnostics"]:
            yield f"{seed} {command}: no diagnostic"


def _misread(target: Path) -> Iterator[str]:
    for name, read in read_everything(str(target), "bulkhead"):
        try:
            read()
        except InvalidInput as error:
            if not error.diagnostics:
                yield f"{name}: no diagnostic"
        except Exception as error:
            yield f"{name}: {type(error).__name__}: {error}"


@pytest.mark.slow
def test_a_value_of_another_type_in_any_column_is_read_or_refused(
    sound: Path, tmp_path: Path
) -> None:
    """SQLite keeps any value in any column: what reads a library from Python meets them all,
    and knows none as a bug.
    """
    wrong = []
    file = Path(shutil.copy(sound, tmp_path / "library.db"))
    for table, column in [(each.name, own.name) for each in store_tables() for own in each.columns]:
        for value in (7, 1.5, "x", "[3]", b"\xff"):
            shutil.copy(sound, file)
            with (
                contextlib.closing(sqlite3.connect(file)) as raw,
                contextlib.suppress(sqlite3.IntegrityError),
            ):
                raw.execute(f"UPDATE {table} SET {column} = ?", (value,))
                raw.commit()
            wrong += [f"{table}.{column} = {value!r}: {each}" for each in _misread(file)]
    assert wrong == []


@pytest.mark.slow
def test_damage_ends_with_diagnostics(sound: Path, tmp_path: Path) -> None:
    assert list(bugs(sound, tmp_path, range(15))) == []


@pytest.mark.slow
def test_much_more_damage_ends_with_diagnostics(sound: Path, tmp_path: Path) -> None:
    assert list(bugs(sound, tmp_path, range(1000, 1120))) == []
