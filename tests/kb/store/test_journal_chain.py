"""What does not fit in a journal is seen, whatever was changed in it."""

import sqlite3
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.store import check_library
from cellwright.kb.store.journal import Journal, JournalFailure, JournalLine
from cellwright.kb.store.journal_chain import (
    ChainHead,
    StoredLine,
    chain_findings,
    first_link,
    next_link,
    seal_of,
)
from cellwright.kb.store.table_schema import CURRENT_SCHEMA

FIRST = first_link("r", "2026-11-29", "{}")


@dataclass(frozen=True)
class Written:
    """A journal as it was written."""

    lines: tuple[StoredLine, ...]
    head: ChainHead


@st.composite
def written(draw: st.DrawFn) -> Written:
    contents = draw(st.lists(st.sampled_from(['{"a": 1}', "{}", '{"b": "x"}']), max_size=8))
    kinds = st.sampled_from(["done", "reply", "command"])
    link, made = FIRST, list[StoredLine]()
    for number, content in enumerate(contents, start=1):
        kind, at_ms = draw(kinds), draw(st.integers(0, 2**40))
        link = next_link(link, number, at_ms, kind, content)
        made.append(StoredLine(number, at_ms, kind, content, link))
    return Written(tuple(made), ChainHead(len(made), link))


@given(written())
def test_a_journal_as_it_was_written_is_whole(journal: Written) -> None:
    assert list(chain_findings(FIRST, journal.lines, journal.head)) == []


@given(written(), st.data())
def test_any_change_is_seen(journal: Written, data: st.DataObject) -> None:
    lines = list(journal.lines)
    if lines:
        place = data.draw(st.integers(0, len(lines) - 1))
        match data.draw(st.sampled_from(["field", "leave out", "exchange", "repeat", "cut"])):
            case "field":
                name = data.draw(st.sampled_from(["at_ms", "kind", "content", "number", "link"]))
                lines[place] = lines[place]._replace(**{name: 77})
            case "leave out":
                del lines[place]
            case "exchange":
                other = data.draw(st.integers(0, len(lines) - 1))
                lines[place], lines[other] = (
                    lines[other]._replace(number=lines[place].number),
                    lines[place]._replace(number=lines[other].number),
                )
            case "repeat":
                lines.append(lines[place]._replace(number=len(lines) + 1))
            case _:
                del lines[place:]
    if tuple(lines) != journal.lines:
        assert list(chain_findings(FIRST, lines, journal.head))
    assert list(chain_findings(first_link("r", "", ""), journal.lines, journal.head)) or not lines


def write(target: str, count: int = 3, key: bytes | None = None) -> None:
    with Journal(target, key) as journal:
        journal.begin("r", "2026-11-29", {"target": "x"})
        for number in range(1, count + 1):
            journal.append("r", [JournalLine(number, 10**11 + number, "done", {"step": number})])


def refused(target: str, key: bytes | None = None, unchained: bool = False) -> str:
    with Journal(target, key) as journal:
        try:
            journal.require_whole("r", unchained)
        except InvalidInput as error:
            return error.diagnostics[0].message
    return ""


def test_what_is_written_is_whole_and_times_may_be_long(target: str) -> None:
    write(target)
    assert refused(target) == ""
    with Journal(target) as journal:
        assert [line.at_ms for line in journal.lines("r")] == [10**11 + n for n in (1, 2, 3)]
    assert check_library(target)[0] == []


DAMAGES = {
    "DELETE FROM journal WHERE number = 2": "line 2 is missing",
    "DELETE FROM journal WHERE number > 1": "the end is missing: it has 1 lines, and 3 were",
    "DELETE FROM journal": "the end is missing: it has 0 lines, and 3 were written",
    "UPDATE journal SET content = '{\"step\": 4}' WHERE number = 2": "line 2 is not as it was",
    "UPDATE journal SET link = NULL": "line 1 is not as it was written",
    "UPDATE runs SET document = '{}'": "line 1 is not as it was written",
    "DELETE FROM journal_heads": "its head is missing",
    "DELETE FROM runs": "what the run was begun with is missing",
    "UPDATE journal_heads SET number = 2": "its end does not fit: it has 3 lines, and 2 were",
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_what_was_done_to_a_file_is_told(tmp_path: Path, damage: str) -> None:
    target = str(tmp_path / "j.db")
    write(target)
    edit(target, damage)
    assert DAMAGES[damage] in refused(target)
    assert any(DAMAGES[damage] in each.message for each in check_library(target)[0])


def edit(target: str, *statements: str) -> None:
    connection: Any = sqlite3.connect(target)
    for statement in statements:
        connection.execute(statement)
    connection.commit()
    connection.close()


def test_a_journal_of_an_older_version_is_taken_where_that_is_asked_for(tmp_path: Path) -> None:
    target = str(tmp_path / "j.db")
    write(target)
    edit(
        target,
        "ALTER TABLE journal DROP COLUMN link",
        "DROP TABLE journal_heads",
        f"UPDATE cellwright_schema SET version = {CURRENT_SCHEMA - 1}",
    )
    assert check_library(target)[0] == []
    assert "has no digests" in refused(target)
    assert refused(target, unchained=True) == ""
    with Journal(target) as journal:
        journal.append("r", [JournalLine(4, 4, "end", {})])
    assert refused(target, unchained=True) == ""
    edit(target, "DELETE FROM journal WHERE number = 2")
    assert "line 2 is missing" in refused(target, unchained=True)


def test_whoever_has_no_key_cannot_write_a_journal_anew(tmp_path: Path) -> None:
    ours, theirs = str(tmp_path / "ours.db"), str(tmp_path / "theirs.db")
    write(ours, key=b"site")
    write(theirs)
    assert refused(ours, b"site") == refused(ours) == ""
    assert "not sealed with this key" in refused(theirs, b"site")
    assert "not sealed with this key" in refused(ours, b"other")
    assert seal_of(b"site", "r", ChainHead(3, "x")) != seal_of(b"site", "r", ChainHead(2, "x"))


def test_of_two_that_write_to_one_journal_the_second_fails(target: str) -> None:
    write(target)
    with Journal(target) as one, Journal(target) as other:
        one._head_of("r")
        other._head_of("r")
        one.append("r", [JournalLine(4, 0, "done", {})])
        with pytest.raises(JournalFailure, match="another process"):
            other.append("r", [JournalLine(5, 0, "done", {})])
        assert one.last("r") == 4
    assert refused(target) == ""
