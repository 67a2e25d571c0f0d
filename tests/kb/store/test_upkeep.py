"""A library is checked, backed up while others write, and restored into either kind of database."""

import sqlite3
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from macrops import macrop

from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.store import Library, Record, Use
from cellwright.kb.store.case_store import Cases, ClosedCase
from cellwright.kb.store.database import connect_engine, open_transaction
from cellwright.kb.store.inspection_store import PlannedVisit, PoseStore, SequencePlan, Sequences
from cellwright.kb.store.journal import Journal, JournalLine, lines
from cellwright.kb.store.store_maintenance import (
    check_library,
    migrate_library,
    restore_backup,
    write_backup,
)
from cellwright.kb.store.table_schema import macrops, outlines, shared


def fill(target: str) -> None:
    with Library(target) as library:
        library.add(
            [
                Record(macrop("go"), "go/0", 1.0, (("goal\ngo", 1),)),
                Record(macrop("stay"), "stay/0"),
            ]
        )
        library.forget([1])
        library.add([Record(macrop("back"), "back/0", 1.0, (("goal\ngo", 2),))])
        library.note_uses({2: Use(3, 0.5)})
    with Cases(target) as cases:
        cases.add([ClosedCase("cell", "lost", ("slipped",), 2.5, (("look", "seen"),))])
    with Sequences(target) as sequences:
        sequences.keep(SequencePlan("cell", "p", rest=(PlannedVisit("m1", "probe", (1.0, 2.0)),)))
    with Journal(target) as journal:
        journal.begin("r", "2026-11-22", {"target": "x"})
        journal.append(
            "r",
            [
                JournalLine(1, 0, "phase", {"phase": "ready"}),
                JournalLine(2, 5, "done", {"step": 1}),
            ],
        )


def content(target: str) -> tuple[object, ...]:
    with (
        Library(target) as library,
        Cases(target) as cases,
        Sequences(target) as sequences,
        Journal(target) as journal,
    ):
        return (
            [(each.id, each.macrop, each.uses, each.planning_s) for each in library.all()],
            [(each.name, each.requirements, each.depends) for each in library.outlines("bulkhead")],
            cases.history("cell"),
            sequences.of("cell", "p"),
            journal.begun(),
            list(journal.lines("r")),
        )


def messages(target: str) -> list[str]:
    return [each.message for each in check_library(target)[0]]


def test_what_is_backed_up_is_restored_and_used_on(target: str, tmp_path: Path) -> None:
    fill(target)
    backup = tmp_path / "backup.db"
    assert messages(target) == []
    rows = write_backup(target, backup)
    assert (rows["macrops"], rows["journal"]) == (2, 2)
    other = str(tmp_path / "other.db")
    restore_backup(backup, other)
    assert content(other) == content(target)
    with pytest.raises(InvalidInput, match="not empty"):
        restore_backup(backup, target)
    with Library(target) as library:
        library.add([Record(macrop("new"), "new/0")])
    restore_backup(backup, target, replaces=True)
    assert content(other) == content(target)
    with Library(target) as library:
        assert library.add([Record(macrop("new"), "new/0")]) == [4]
    assert sorted(each.name for each in tmp_path.iterdir() if "part" in each.name) == []


def test_a_library_moves_to_the_other_kind_of_database_and_stays_where_it_was(
    target: str, tmp_path: Path
) -> None:
    first, back = str(tmp_path / "first.db"), str(tmp_path / "back.db")
    fill(first)
    rows = migrate_library(first, target)
    assert (rows["macrops"], rows["journal"]) == (2, 2)
    migrate_library(target, back)
    assert content(first) == content(target) == content(back)
    with Library(target) as library:
        assert library.add([Record(macrop("new"), "new/0")]) == [4]
    with pytest.raises(InvalidInput, match="not empty"):
        migrate_library(first, target)
    with pytest.raises(InvalidInput, match="shall be copied to"):
        migrate_library(target, target)


def test_a_backup_shows_one_moment_while_others_write(target: str, tmp_path: Path) -> None:
    fill(target)
    with Journal(target) as journal:
        for number in range(3, 9):
            journal.append("r", [JournalLine(number, number, "done", {})])
            write_backup(target, tmp_path / f"{number}.db")
            assert messages(str(tmp_path / f"{number}.db")) == []
            with Journal(str(tmp_path / f"{number}.db")) as copy:
                assert copy.last("r") == number


def test_an_existing_file_is_not_overwritten_by_a_backup(tmp_path: Path) -> None:
    fill(str(tmp_path / "a.db"))
    (tmp_path / "b.db").write_text("mine")
    with pytest.raises(InvalidInput, match="already"):
        write_backup(str(tmp_path / "a.db"), tmp_path / "b.db")
    assert (tmp_path / "b.db").read_text() == "mine"


def test_each_damage_is_told(target: str) -> None:
    fill(target)
    engine = connect_engine(target)
    with open_transaction(engine, target, writes=True) as connection:
        connection.execute(macrops.update().where(macrops.c.id == 2).values(document="{"))
        connection.execute(shared.update().values(text="other"))
        connection.execute(outlines.update().values(requirements="77*2"))
        connection.execute(lines.delete().where(lines.c.number == 1))
        connection.execute(
            lines.insert().values(run="ghost", number=1, at_ms=0, kind="done", content="[]")
        )
    engine.dispose()
    said = "\n".join(messages(target))
    for each in (
        "MACROP 2 cannot be read",
        "shared text 1 was changed",
        "requires the shared text 77, which is not there",
        "the journal of run 'r': line 1 is missing",
        "refers to ghost, which is not in 'runs'",
        "'content' of ghost, 1 in 'journal' cannot be read",
    ):
        assert each in said


def test_rows_that_refer_to_nothing_and_missing_tables_are_told(tmp_path: Path) -> None:
    file = tmp_path / "a.db"
    fill(str(file))
    raw = sqlite3.connect(file)
    raw.execute("DELETE FROM macrops WHERE id = 2")
    raw.execute("DROP TABLE trials")
    raw.commit()
    raw.close()
    said = "\n".join(messages(str(file)))
    assert "a row in 'usage' refers to 2, which is not in 'macrops'" in said
    assert "the table 'trials' is not there" in said


def test_a_damaged_file_is_replaced_and_kept(tmp_path: Path) -> None:
    file, backup = tmp_path / "a.db", tmp_path / "b.db"
    fill(str(file))
    write_backup(str(file), backup)
    file.write_bytes(b"no database" * 1000)
    for each in ("a.db-wal", "a.db-shm"):
        (tmp_path / each).unlink(missing_ok=True)
    restore_backup(backup, str(file), replaces=True)
    assert content(str(file)) == content(str(backup))
    assert (tmp_path / "a.db.damaged").read_bytes().startswith(b"no database")


def test_what_is_no_library_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="no library here"):
        check_library(str(tmp_path / "none.db"))
    sqlite3.connect(tmp_path / "empty.db").close()
    with pytest.raises(InvalidInput):
        check_library(str(tmp_path / "empty.db"))
    assert sorted(each.name for each in tmp_path.iterdir()) == ["empty.db"]


def test_poses_are_kept_by_several_writers_at_once(target: str) -> None:
    def keep(number: int) -> None:
        with Cases(target), Journal(target), PoseStore(target) as poses:
            for _ in range(4):
                poses.keep(
                    "cell",
                    "p",
                    {("m1", "probe", "s"): str(number), ("m2", "probe", "s"): str(number)},
                )

    with ThreadPoolExecutor(4) as writers:
        list(writers.map(keep, range(4)))
    with PoseStore(target) as poses:
        assert len(set(poses.of("cell", "p").values())) == 1
