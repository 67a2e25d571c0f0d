"""The reference is what the schemas say now, of every kind of file and of every key."""

import re

import pytest
from golden_texts import compare_with_golden

from cellwright.kb.schema import FORM_KINDS, json_schema
from tests.docs.pages import TOP
from tests.docs.reference import FILES, page

PAGE = TOP / "docs" / "reference.md"


def test_the_reference_is_current(request: pytest.FixtureRequest) -> None:
    compare_with_golden(PAGE, page(), request.config.getoption("--update-golden"))


def test_every_kind_of_file_is_in_it() -> None:
    assert set(FILES) == set(FORM_KINDS)


@pytest.mark.parametrize("kind", FORM_KINDS)
def test_every_key_is_in_it(kind: str) -> None:
    text = PAGE.read_text("utf-8")
    schema = json_schema(kind)
    keys = {
        key
        for part in [schema, *schema.get("$defs", {}).values()]
        for key in part.get("properties", {})
    }
    assert keys
    assert {key for key in keys if f"| `{key}`" not in text} == set()


def test_every_row_has_three_cells_and_a_meaning() -> None:
    rows = [line for line in PAGE.read_text("utf-8").splitlines() if line.startswith("| `")]
    cells = [re.split(r"(?<!\\)\|", row)[1:-1] for row in rows]
    assert len(rows) > 200
    assert [
        row
        for row, each in zip(rows, cells, strict=True)
        if len(each) != 3 or not all(map(str.strip, each))
    ] == []
