"""Operations of two arms in `cell.yaml`: what is lacking is told."""

from pathlib import Path

import pytest

from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader.cell import load_cell
from cellwright.kb.model.cell_model import Cell

CELL = """
cell: pair
arms:
  one: {model: ur5}
  other: {model: ur5, at: [0, 1, 0]}
parts:
  bar: {shapes: [{box: [0.1, 0.1, 0.1]}], features: {end: {at: [0.1, 0, 0]}}}
places:
  here: {arm: one, at: [0.4, 0, 0.4]}
  there: {arm: other, at: [0.4, 1, 0.4]}
"""


def test_two_places_are_read(tmp_path: Path) -> None:
    cell = written(tmp_path, "operations:\n  lift(Item): {at: here, with: there, carries: Item}\n")
    (operation,) = cell.operations
    assert (str(operation.at), str(operation.with_place), str(operation.carries)) == (
        "here",
        "there",
        "Item",
    )


@pytest.mark.parametrize(
    ("said", "code"),
    [
        ("operations:\n  lift(Item): {with: there}\n", "K005"),
        ("operations:\n  lift(Item): {at: here, carries: bar}\n", "K005"),
        ("operations:\n  lift(Item): {at: here, with: nowhere}\n", "K101"),
        ("operations:\n  lift(Item): {at: here, with: there, carries: beam}\n", "K101"),
        ("operations:\n  lift(Item): {at: here, with: there, carries: Bar}\n", "K105"),
        ("locations:\n  held(X): {body: bar, in: one.tool, by: middle}\n", "K101"),
    ],
)
def test_what_is_lacking_is_told(tmp_path: Path, said: str, code: str) -> None:
    with pytest.raises(InvalidInput) as refused:
        written(tmp_path, said)
    assert [each.code for each in refused.value.diagnostics] == [code]


def written(folder: Path, more: str) -> Cell:
    (folder / "cell.yaml").write_text(CELL + more)
    return load_cell(folder / "cell.yaml")
