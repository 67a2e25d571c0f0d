"""Prose in Markdown ends at 100 columns; tables, links, headings and code are excepted."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.places import TOP

WIDTH = 100
FILES = sorted(
    path
    for folder in (TOP, TOP / "docs", TOP / "domains", TOP / "editors")
    for path in folder.glob("*.md" if folder == TOP else "**/*.md")
)


def long_lines(text: str) -> Iterator[tuple[int, str]]:
    """Lines of prose beyond the width, each with its number."""
    fenced = False
    for number, line in enumerate(text.splitlines(), 1):
        if re.match(r"\s*(```|~~~)", line):
            fenced = not fenced
        table_or_heading = line.lstrip().startswith(("|", "#", "<"))
        # a link, or anything else without a blank, cannot be broken
        longest = max((len(word) for word in re.split(r"\s+(?![^\[\]]*\]\()", line)), default=0)
        breakable = longest + len(line) - len(line.lstrip()) <= WIDTH
        if fenced or line.startswith("    ") or table_or_heading:
            continue
        if len(line) > WIDTH and breakable:
            yield number, line


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(TOP)))
def test_prose_ends_at_the_width(path: Path) -> None:
    assert list(long_lines(path.read_text("utf-8"))) == []


@pytest.mark.parametrize(
    ("text", "lines"),
    [
        ("word " * 30, [1]),
        ("# " + "word " * 30, []),
        ("| " + "word " * 30 + "|", []),
        ("```\n" + "word " * 30 + "\n```\n" + "word " * 30, [4]),
        ("    cellwright " + "word " * 30, []),
        ("[a link](https://example.org/" + "x" * 100 + ")", []),
        ("- an item\n  " + "word " * 30, [2]),
    ],
)
def test_what_is_measured(text: str, lines: list[int]) -> None:
    assert [number for number, _ in long_lines(text)] == lines
