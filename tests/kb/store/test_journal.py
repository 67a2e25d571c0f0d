"""What a journal has acknowledged stays, whatever happens to the file behind it."""

import random
import shutil
from pathlib import Path

import pytest

from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.store.journal import Journal, JournalFailure, JournalLine


def lines(first: int, count: int) -> list[JournalLine]:
    return [
        JournalLine(n, n * 10, "done", {"step": n, "adds": ["at(a, b)"]})
        for n in range(first, first + count)
    ]


def test_lines_come_back_in_order_and_by_kind(tmp_path: Path) -> None:
    with Journal(str(tmp_path / "j.db")) as journal:
        assert journal.begin("r", "2026-11-22", {"target": "x"})
        assert not journal.begin("r", "2026-11-22", {})
        journal.append("r", lines(1, 3))
        journal.append("r", [JournalLine(4, 40, "end", {"why": "ü"})])
        assert list(journal.lines("r")) == [*lines(1, 3), JournalLine(4, 40, "end", {"why": "ü"})]
        assert [each.number for each in journal.lines("r", after=2, kinds=["done"])] == [3]
        assert (journal.last("r"), journal.last("r", "done"), journal.last("other")) == (4, 3, 0)


def test_a_number_that_is_taken_is_refused_and_nothing_of_its_group_is_there(
    tmp_path: Path,
) -> None:
    with Journal(str(tmp_path / "j.db")) as journal:
        journal.begin("r", "", {})
        journal.append("r", lines(1, 3))
        with pytest.raises(JournalFailure):
            journal.append("r", lines(3, 2))
        assert journal.last("r") == 3
        journal.append("r", lines(4, 1))
        assert journal.last("r") == 4


@pytest.mark.parametrize("seed", range(12))
def test_a_file_cut_behind_its_last_sync_loses_nothing_that_was_acknowledged(
    tmp_path: Path, seed: int
) -> None:
    chance = random.Random(seed)
    file, copy = tmp_path / "j.db", tmp_path / "after"
    copy.mkdir()
    with Journal(str(file)) as journal:
        journal.begin("r", "", {})
        acknowledged = 0
        for _ in range(chance.randrange(1, 8)):
            group = lines(acknowledged + 1, chance.randrange(1, 6))
            journal.append("r", group)
            acknowledged += len(group)
        log = tmp_path / "j.db-wal"
        synced = log.stat().st_size
        shutil.copy(file, copy / "j.db")
        journal.append("r", lines(acknowledged + 1, 5))
        content = log.read_bytes()
    cut = chance.randrange(synced, len(content) + 1)
    (copy / "j.db-wal").write_bytes(content[:cut])
    with Journal(str(copy / "j.db")) as journal:
        found = [each.number for each in journal.lines("r")]
    assert found[:acknowledged] == list(range(1, acknowledged + 1))
    assert found in (found[:acknowledged], list(range(1, acknowledged + 6)))


def test_a_full_disk_is_told_and_leaves_the_journal_as_it_was(tmp_path: Path) -> None:
    with Journal(str(tmp_path / "j.db")) as journal:
        journal.begin("r", "", {})
        journal.append("r", lines(1, 2))
        held = journal._writing()
        pages = held.cursor().execute("PRAGMA page_count").fetchone()[0]
        held.cursor().execute(f"PRAGMA max_page_count = {pages}")
        with pytest.raises(JournalFailure, match="full"):
            journal.append("r", [JournalLine(3, 0, "done", {"text": "x" * 200_000})])
        assert journal.last("r") == 2
        journal.append("r", lines(3, 1))


def test_a_folder_that_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput):
        Journal(str(tmp_path / "none" / "j.db"))
