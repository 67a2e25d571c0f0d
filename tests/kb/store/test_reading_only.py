"""A library that may only be read serves, learns nothing, and stays as it is."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from macrops import macrop

from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.store import Library, Record, Use
from cellwright.kb.store.database import connect_engine, open_transaction
from cellwright.kb.store.table_schema import versions

NOBODY = 65534


@contextmanager
def _as_reader() -> Iterator[None]:
    """Without the rights of the superuser, whom no mode keeps from writing."""
    if os.geteuid():
        yield
        return
    real, effective, saved = os.getresuid()
    os.setresuid(NOBODY, NOBODY, saved)
    try:
        yield
    finally:
        os.setresuid(real, effective, saved)


@pytest.fixture
def file() -> Iterator[Path]:
    folder = Path(tempfile.mkdtemp())
    made = folder / "some library.db"
    with Library(str(made)) as library:
        library.add([Record(macrop("go"), "go/0", 1.0, (("goal\ngo", 1),))])
    yield made
    folder.chmod(0o755)
    shutil.rmtree(folder)


def _lock(file: Path, folder_mode: int) -> None:
    file.chmod(0o444)
    file.parent.chmod(folder_mode)


@pytest.mark.parametrize("folder_mode", [0o555, 0o777])
def test_it_serves_and_nothing_changes(file: Path, folder_mode: int) -> None:
    _lock(file, folder_mode)
    before = file.read_bytes()
    with _as_reader(), Library(str(file)) as library:
        assert not library.writable
        assert [each.name for each in library.outlines("bulkhead", "go/0")] == ["go"]
        assert [str(each.macrop.name) for each in library.all()] == ["go"]
        library.note_uses({1: Use(1, 0.1)})
        library.note_trial("bulkhead", "go/0", True)
        library.note_outlines([(macrop("go"), 1, ())])
        with pytest.raises(InvalidInput, match="cannot be used"):
            library.add([Record(macrop("stay"), "stay/0")])
    assert file.read_bytes() == before
    assert os.listdir(file.parent) == [file.name]


def test_what_others_write_meanwhile_is_seen(file: Path) -> None:
    with Library(str(file)) as writer:
        writer.add([Record(macrop("stay"), "stay/0")])
        file.parent.chmod(0o755)
        for each in file.parent.iterdir():
            each.chmod(0o444)
        with _as_reader(), Library(str(file)) as library:
            assert len(library.all()) == 2


def test_an_older_one_is_refused_with_the_way_out(file: Path) -> None:
    engine = connect_engine(str(file))
    with open_transaction(engine, str(file), writes=True) as connection:
        connection.execute(versions.update().values(version=2))
    engine.dispose()
    _lock(file, 0o555)
    with _as_reader(), pytest.raises(InvalidInput, match="a user who may write it"):
        Library(str(file))
