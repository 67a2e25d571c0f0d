"""The page on the papers names modules that are there, each with an idea and its section."""

import re

from tests.docs.pages import TOP

PAGE = (TOP / "docs" / "sources.md").read_text("utf-8")
ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in PAGE.splitlines()
    if line.startswith("| ") and not line.startswith(("| ---", "| section"))
]


def test_every_row_has_section_idea_and_place() -> None:
    assert len(ROWS) >= 55
    assert [row for row in ROWS if len(row) != 4 or not all(row[:3])] == []


def test_the_modules_that_realise_ideas_are_there() -> None:
    names = [
        name
        for row in ROWS
        for name in re.findall(r"`cellwright\.((?:kb|engine)[\w.]*)`", " ".join(row[2:]))
    ]
    assert len(names) >= 70
    missing = {
        name
        for name in names
        if not (path := TOP.joinpath(*name.split("."))).is_dir()
        and not path.with_suffix(".py").is_file()
    }
    assert missing == set()
    assert all(re.search(r"`cellwright\.(?:kb|engine)", row[2]) for row in ROWS)
