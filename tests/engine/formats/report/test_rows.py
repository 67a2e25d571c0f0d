"""Tables on narrow terminals: nothing is cut, and no word that fits on a line is broken."""

import io
import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console, RenderableType

from cellwright.engine.formats.report.plans import outcome_tables
from cellwright.engine.formats.report.text_tables import TextTable
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.kb.loader import load_problem

cells = st.lists(st.text("ab_", min_size=1, max_size=9), max_size=5).map(" ".join)
tables = st.integers(1, 4).flatmap(
    lambda n: st.tuples(
        st.lists(cells, min_size=n, max_size=n),
        st.lists(st.lists(cells, min_size=n, max_size=n), min_size=1, max_size=5),
    )
)


def lines(made: RenderableType, width: int) -> list[str]:
    stream = io.StringIO()
    Console(file=stream, width=width, color_system=None).print(made)
    return [line.rstrip() for line in stream.getvalue().splitlines()]


def words(said: str) -> set[str]:
    return set(re.findall(r"\w+", said))


@given(tables, st.integers(16, 60))
@settings(deadline=None)
def test_every_word_of_every_row_is_there_whole_and_no_line_is_too_long(
    table: tuple[list[str], list[list[str]]], width: int
) -> None:
    headings, rows = table
    shown = lines(TextTable(headings, rows), width)
    assert max(map(len, shown)) <= width
    assert words(" ".join(cell for row in rows for cell in row)) <= words(" ".join(shown))


@given(tables)
@settings(deadline=None)
def test_with_room_a_row_is_a_line_under_its_headings(
    table: tuple[list[str], list[list[str]]],
) -> None:
    headings, rows = table
    shown = lines(TextTable(headings, rows), 400)
    assert [line.split() for line in shown] == [
        " ".join(row).split() for row in ([headings] if any(headings) else []) + rows
    ]


def test_numbers_stand_right_and_brackets_are_no_markup() -> None:
    assert lines(TextTable(("n", "of"), [("7", "[bold]"), ("10", "x")], right=("n",)), 40) == [
        " n  of",
        " 7  [bold]",
        "10  x",
    ]


@pytest.mark.parametrize("target", ["bulkhead/one_point", "themse/one"])
def test_a_narrow_terminal_shows_the_words_of_a_wide_one(target: str) -> None:
    problem = load_problem(target)
    made = outcome_tables.outcome_text(checked_plan.plan_problem(problem), problem)
    wide = words("\n".join(lines(made, 400)))
    for width in (30, 40, 50):
        narrow = lines(made, width)
        assert max(map(len, narrow)) <= width
        assert words("\n".join(narrow)) <= wide | {"from", "for"}
