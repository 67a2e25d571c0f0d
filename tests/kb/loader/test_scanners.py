"""What a scanner sees is read from `cell.yaml`, and what makes no sense there is reported."""

from pathlib import Path

import pytest

from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader.cell import load_cell
from cellwright.kb.model.cell_model import Sight

CELL = """
cell: lab
arms: {ur5: {model: ur5}}
tools: {scanner: {features: {tip: {at: [0, 0, 0.5]}, eye: {at: [0, 0, 0.1]}}}}
measuring: {scanner: {patch: [20 mm, 60 mm], sight: %s}}
"""


def measured(folder: Path, sight: str) -> Sight | None:
    (folder / "cell.yaml").write_text(CELL % sight)
    return load_cell(folder / "cell.yaml").measuring["scanner"].sight


def test_eyes_range_incidence_and_back_are_read(tmp_path: Path) -> None:
    found = measured(tmp_path, "{eyes: [eye], range: [300 mm, 0.6], incidence: 45, back: 10 cm}")
    assert found == Sight(("eye",), (0.3, 0.6), pytest.approx(0.785398, abs=1e-6), 0.1)


@pytest.mark.parametrize(
    ("sight", "said"),
    [
        ("{eyes: [eya], range: [0.3, 0.6]}", "unknown feature of scanner 'eya'"),
        ("{eyes: [eye], range: [0.6, 0.3]}", "sees nothing in this range"),
        ("{eyes: [eye], range: [0.3, 0.6], incidence: 0}", "sees nothing at this incidence"),
        ("{eyes: [eye], range: [0.3, 0.6], incidence: 120}", "sees nothing at this incidence"),
        ("{eyes: [], range: [0.3, 0.6]}", "eyes"),
        ("{eyes: [eye]}", "range"),
    ],
)
def test_what_no_scanner_can_see_is_reported(tmp_path: Path, sight: str, said: str) -> None:
    with pytest.raises(InvalidInput) as caught:
        measured(tmp_path, sight)
    assert any(said in str(each) for each in caught.value.diagnostics)
