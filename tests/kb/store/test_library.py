"""A library keeps what it is told, once, whoever else writes, and whatever dies."""

import os
import random
import re
import signal
import sqlite3
import time
from multiprocessing.context import BaseContext
from pathlib import Path

import pytest
from macrops import macrop
from sqlalchemy import text

from benchmarks.postgres import emptied
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.store import Library, Record, Use
from cellwright.kb.store import table_schema as tables
from cellwright.kb.store.database import connect_engine, open_transaction


def record(name: str, domain: str = "bulkhead", planning_s: float = 0.0, **depends: str) -> Record:
    return Record(macrop(name, domain, **depends), f"{name}/0", planning_s)


def test_what_is_added_is_there_once(target: str) -> None:
    with Library(target) as library:
        assert library.add([record("go"), record("stay"), record("go")]) == [1, 2, None]
        assert library.add([record("go")]) == [None]
        assert [each.macrop for each in library.all()] == [macrop("go"), macrop("stay")]
    with Library(target) as library:
        assert [each.signature for each in library.outlines("bulkhead", "stay/0")] == ["stay/0"]
        assert library.outlines("bulkhead", "stay/0", above=library.all()[-1].id) == []


def test_forgetting_removes_everything_that_belongs_to_a_macrop(target: str) -> None:
    with Library(target) as library:
        first, _ = library.add([record("go", move="a"), record("stay", move="a")])
        assert first is not None
        assert library.forget([first, 4711]) == 1
        assert library.numbered(first) is None
        assert list(library.outdated("bulkhead", lambda _: "b").values()) == [("operator move",)]


def test_exactly_those_are_outdated_that_rest_on_a_changed_part(target: str) -> None:
    now = {"operator move": "new", "operator pick": "same"}
    with Library(target) as library:
        library.add(
            [
                record("a", move="old"),
                record("b", pick="same"),
                record("c", move="new", pick="other"),
            ]
        )
        library.add([record("d", "themse", move="old")])
        assert library.outdated("bulkhead", now.__getitem__) == {
            1: ("operator move",),
            3: ("operator pick",),
        }


def test_uses_add_up_to_seconds_saved(target: str) -> None:
    with Library(target) as library:
        library.add([record("go", planning_s=2.0), record("stay", "themse", planning_s=1.0)])
        library.note_uses({1: Use(3, 0.5), 2: Use(1, 0.25)})
        library.note_uses({1: Use(1, 0.5)})
        figures = library.figures()
        assert (figures.macrops, figures.shapes, figures.uses, figures.saved_s) == (2, 2, 5, 7.75)
        assert figures.domains == {"bulkhead": 1, "themse": 1}
        found = library.numbered(1)
        assert found is not None
        assert found.saved_s == 7.0


def _write(target: str, names: list[str]) -> None:
    with Library(target) as library:
        for name in names:
            library.add([record(name, move="a")])


def test_concurrent_writers_lose_nothing_and_keep_nothing_twice(
    target: str, processes: BaseContext
) -> None:
    shared = [f"shared{n}" for n in range(20)]
    own = [[f"own{writer}_{n}" for n in range(20)] for writer in range(4)]
    writers = [processes.Process(target=_write, args=(target, [*names, *shared])) for names in own]
    for each in writers:
        each.start()
    for each in writers:
        each.join(120)
    assert [each.exitcode for each in writers] == [0, 0, 0, 0]
    with Library(target) as library:
        found = sorted(str(each.macrop.name) for each in library.all())
        assert found == sorted([*shared, *(name for names in own for name in names)])


def _write_for_ever(target: str, seed: int) -> None:
    with Library(target) as library:
        for number in range(1_000_000):
            library.add([record(f"p{seed}_{number}_{n}", move="a", pick="b") for n in range(3)])


@pytest.mark.parametrize("seed", [1, 2])
def test_a_killed_writer_leaves_whole_transactions(
    target: str, seed: int, processes: BaseContext
) -> None:
    writer = processes.Process(target=_write_for_ever, args=(target, seed))
    writer.start()
    Library(target).close()
    deadline = time.monotonic() + 60
    while _count(target) < 9 and time.monotonic() < deadline:
        time.sleep(0.05)
    time.sleep(random.Random(seed).random() * 0.1)
    assert writer.pid is not None
    os.kill(writer.pid, signal.SIGKILL)
    writer.join(30)
    with Library(target) as library:
        found = library.all()
        assert len(found) >= 9
        assert len(found) % 3 == 0
        assert all(len(each.macrop.depends) == 2 for each in found)
        assert len(library.outdated("bulkhead", lambda _: "changed")) == len(found)
        assert library.add([record("after")]) != [None]


def _count(target: str) -> int:
    with Library(target) as library:
        return library.figures().macrops


def test_a_library_of_the_first_schema_is_brought_up_to_date(target: str) -> None:
    engine = connect_engine(target)
    with open_transaction(engine, target, writes=True) as connection:
        tables.metadata.create_all(connection, [tables.versions])
        tables.SCHEMA_MIGRATIONS[0](connection)
        connection.execute(tables.versions.insert().values(version=1))
        from cellwright.kb.store import dumps

        text = dumps(macrop("go"))
        old = dict(domain="bulkhead", signature="go/0", name="go", steps=1, document=text)
        connection.execute(
            tables.macrops.insert().values(fingerprint=tables.text_fingerprint(text), **old)
        )
        connection.execute(
            tables.dependencies.insert().values(macrop=1, part="operator move", digest="a")
        )
    engine.dispose()
    with Library(target) as library:
        assert [str(each.macrop.name) for each in library.all()] == ["go"]
        assert library.figures().schema == tables.CURRENT_SCHEMA
        assert library.outdated("bulkhead", lambda _: "b") == {1: ("operator move",)}
        assert library.outdated("bulkhead", lambda _: "a") == {}
        assert [each.requirements for each in library.outlines("bulkhead")] == [None]
        library.note_outlines([(macrop("go"), 1, (("state\n\ngo", 2), ("goal\ngo", 1)))])
        assert [each.requirements for each in library.outlines("bulkhead", "go/0")] == [
            (("state\n\ngo", 2), ("goal\ngo", 1))
        ]
        library.note_uses({1: Use(1, 0.1)})
        assert library.figures().uses == 1


def test_a_newer_library_is_refused(target: str) -> None:
    Library(target).close()
    engine = connect_engine(target)
    with open_transaction(engine, target, writes=True) as connection:
        connection.execute(tables.versions.update().values(version=99))
    engine.dispose()
    with pytest.raises(InvalidInput, match="schema 99"):
        Library(target)


def test_a_file_that_is_no_library_is_refused_and_stays_as_it_is(tmp_path: Path) -> None:
    file = tmp_path / "notes.txt"
    file.write_text("remember the milk\n" * 100)
    with pytest.raises(InvalidInput, match="library"):
        Library(str(file))
    assert file.read_text() == "remember the milk\n" * 100


@pytest.mark.parametrize("target", ["mysql://there/x", "nowhere/at/all/x.db", "http://", "://"])
def test_other_places_are_refused(target: str) -> None:
    with pytest.raises(InvalidInput):
        Library(target)


def test_a_broken_document_is_told_with_the_way_out(tmp_path: Path) -> None:
    file = tmp_path / "library.db"
    with Library(str(file)) as library:
        library.add([record("go")])
    with sqlite3.connect(file) as raw:
        raw.execute("UPDATE macrops SET document = '{}'")
    raw.close()
    with Library(str(file)) as library:
        with pytest.raises(InvalidInput, match="forget 1"):
            library.all()
        assert library.forget([1]) == 1


def test_a_connection_that_ended_while_nobody_used_it_is_replaced(postgres: str) -> None:
    emptied(postgres)
    with Library(postgres) as library:
        library.add([record("go")])
        with open_transaction(library._engine, postgres) as connection:
            own = connection.execute(text("SELECT pg_backend_pid()")).scalar_one()
        other = connect_engine(postgres)
        with open_transaction(other, postgres) as connection:
            ended = text(f"SELECT pg_terminate_backend({own}, 5000)")
            assert connection.execute(ended).scalar_one()
        other.dispose()
        assert library.macrop(1) == macrop("go")
        library.note_uses({1: Use(2, 0.0)})
        assert library.figures().uses == 2


def test_the_server_is_asked_once_for_a_macrop_and_once_for_each_count(
    postgres: str, tmp_path: Path
) -> None:
    emptied(postgres)
    with Library(postgres) as library:
        library.add([record("go")])
        with open_transaction(library._engine, postgres) as connection:
            raw = connection.connection.driver_connection
        with (tmp_path / "trace").open("w") as file:
            raw.pgconn.trace(file.fileno())
            assert library.macrop(1) == macrop("go")
            library.note_uses({1: Use(1, 0.0)})
            library.note_trial("bulkhead", "go/0", True)
            raw.pgconn.untrace()
    asked = [
        line
        for line in (tmp_path / "trace").read_text().splitlines()
        if re.search(r"\t(Query|Sync)", line)
    ]
    assert len(asked) == 3
