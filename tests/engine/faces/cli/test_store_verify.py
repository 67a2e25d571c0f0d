"""`store verify` tells of each journal who began it, and whether it is as it was written."""

import json
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app
from cellwright.kb.store.journal import Journal, JournalLine

runner = CliRunner()


def begin(store: Path, run: str) -> None:
    with Journal(str(store)) as journal:
        journal.begin(run, "2026-11-29T06:00:00+00:00", {"account": "ann@cell"})
        for number in (1, 2, 3):
            journal.append(run, [JournalLine(number, number, "done", {"step": number})])


def verified(store: Path, code: int) -> dict[str, tuple[str, bool, list[str]]]:
    result = runner.invoke(app, ["store", "verify", "--store", str(store), "--format", "json"])
    assert result.exit_code == code, result.output
    return {
        entry["run"]: (entry["account"], entry["sealed"], entry["findings"])
        for entry in json.loads(result.stdout)["data"]["journals"]
    }


def test_each_journal_is_told_with_what_does_not_fit(tmp_path: Path) -> None:
    store = tmp_path / "j.db"
    begin(store, "monday")
    begin(store, "tuesday")
    assert verified(store, 0) == {
        "monday": ("ann@cell", False, []),
        "tuesday": ("ann@cell", False, []),
    }
    with closing(sqlite3.connect(store)) as connection, connection:
        connection.execute("DELETE FROM journal WHERE run = 'monday' AND number = 3")
    assert verified(store, 1) == {
        "monday": (
            "ann@cell",
            False,
            ["the end is missing: it has 2 lines, and 3 were written"],
        ),
        "tuesday": ("ann@cell", False, []),
    }


def test_a_key_of_the_site_is_asked_of_every_journal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store, key = tmp_path / "j.db", tmp_path / "site.key"
    begin(store, "monday")
    key.write_bytes(bytes(range(32)))
    monkeypatch.setenv("CELLWRIGHT_KEY", str(key))
    begin(store, "tuesday")
    assert verified(store, 1) == {
        "monday": ("ann@cell", False, ["it is not sealed with this key"]),
        "tuesday": ("ann@cell", True, []),
    }


@pytest.mark.parametrize(("content", "said"), [(None, "no such file"), (b"short", "and this one")])
def test_a_key_that_is_none_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, content: bytes | None, said: str
) -> None:
    store, key = tmp_path / "j.db", tmp_path / "site.key"
    begin(store, "monday")
    if content is not None:
        key.write_bytes(content)
    monkeypatch.setenv("CELLWRIGHT_KEY", str(key))
    result = runner.invoke(app, ["store", "verify", "--store", str(store)])
    assert result.exit_code == 2
    assert "K416" in result.output
    assert said in result.output
