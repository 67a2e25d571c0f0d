"""What a run keeps is for its owner alone."""

import os
import stat
from pathlib import Path

import pytest

from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.store.database import open_engine
from cellwright.kb.store.default_path import default_store
from cellwright.kb.store.journal import Journal, JournalLine


def rights(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


def test_a_new_library_and_the_logs_beside_it_are_for_their_owner(tmp_path: Path) -> None:
    before = os.umask(0o022)
    try:
        with Journal(str(tmp_path / "j.db")) as journal:
            journal.begin("r", "2026-11-29", {})
            journal.append("r", [JournalLine(1, 0, "run")])
            files = {path.name: rights(path) for path in tmp_path.iterdir()}
    finally:
        os.umask(before)
    assert set(files) >= {"j.db", "j.db-wal"}
    assert set(files.values()) == {0o600}


def test_a_library_that_was_shared_stays_so(tmp_path: Path) -> None:
    file = tmp_path / "j.db"
    open_engine(str(file)).dispose()
    file.chmod(0o664)
    open_engine(str(file)).dispose()
    assert rights(file) == 0o664


def test_the_folder_of_the_state_is_closed_to_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    default_store()
    folder = tmp_path / "cellwright"
    assert rights(folder) == 0o700
    folder.chmod(0o755)
    default_store()
    assert rights(folder) == 0o700


def test_a_text_that_is_no_text_is_damage(tmp_path: Path) -> None:
    file = tmp_path / "j.db"
    with Journal(str(file)) as journal:
        journal.begin("r", "2026-11-29", {})
        journal.append("r", [JournalLine(1, 0, "run")])
        with journal._engine.begin() as connection:
            spoiled = "UPDATE journal SET content = CAST(x'ff7b' AS TEXT)"
            connection.exec_driver_sql(spoiled)
        with pytest.raises(InvalidInput) as told:
            journal.require_whole("r")
    assert told.value.diagnostics[0].code == "K422"
