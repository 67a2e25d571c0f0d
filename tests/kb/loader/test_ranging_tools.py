"""What a cell says of a laser ranging tool is read, and what cannot be is refused with its
place and with advice.
"""

import math
from pathlib import Path

import pytest

from cellwright.kb.diagnostics import Diagnostic, InvalidInput
from cellwright.kb.loader.cell import load_cell
from cellwright.kb.model.cell_model import Ranging

SAID = {
    "eye": "laser", "pixels": "[64, "
    "48]", "view": "34 deg", "wavelength": "0.3 m", "noise": "0.05 mm", "at": "0.5 m",
    "beam": "0.0024 rad", "pointing": "0.0001 rad", "grazing": "75 deg", "dropouts": "0.002",
}  # fmt: skip


def cell_with(said: dict[str, str], folder: Path) -> Path:
    told = "".join(f"      {key}: {value}\n" for key, value in said.items())
    path = folder / "cell.yaml"
    path.write_text(
        "cell: bench\nfixtures:\n  stand: {shapes: [{box: [0.1, 0.1, 0.1]}]}\ntools:\n  "
        "scanner:\n    in: stand\n"
        "    shapes: [{box: [0.1, 0.1, 0.1]}]\n    features: {tip: {at: [0, 0, 0.1]}, laser: "
        "{at: [0, 0, 0.05]}}\n"
        f"measuring:\n  scanner:\n    ranging:\n{told}"
    )
    return path


def refusal(said: dict[str, str], folder: Path) -> list[Diagnostic]:
    with pytest.raises(InvalidInput) as found:
        load_cell(cell_with(said, folder))
    return list(found.value.diagnostics)


def test_a_tool_is_as_its_cell_says(tmp_path: Path) -> None:
    found = load_cell(cell_with(SAID, tmp_path)).measuring["scanner"].ranging
    assert found == Ranging(
        "laser", 64, 48, pytest.approx(math.radians(34)), 0.3, pytest.approx(5e-5), 0.5, 0.0024, 0.0001,
        pytest.approx(math.radians(75)), 0.002,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("key", "value", "hint"),
    [
        ("view", "0", "above 0, up to 149 degrees"),
        ("view", "180 deg", "above 0, up to 149 degrees"),
        ("wavelength", "0", "above 0, up to 1 km"),
        ("wavelength", "-0.3 m", "above 0, up to 1 km"),
        ("noise", "0", "above 0, up to 1 m"),
        ("noise", "2 m", "above 0, up to 1 m"),
        ("at", "0", "above 0, up to 1 km"),
        ("beam", "0", "above 0, up to 0.1 rad"),
        ("beam", "20 deg", "above 0, up to 0.1 rad"),
        ("pointing", "-0.1 rad", "from 0 to 0.1 rad"),
        ("grazing", "90 deg", "above 0, below 90 degrees"),
        ("dropouts", "1", "from 0 to 0.9"),
    ],
)
def test_what_no_laser_is_like_is_refused(key: str, value: str, hint: str, tmp_path: Path) -> None:
    (found,) = refusal({**SAID, key: value}, tmp_path)
    assert found.code == "K005"
    assert found.message == f"this is no {key} of a laser"
    assert hint in found.hint
    assert found.where.line == 12 + list(SAID).index(key)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("eye", "camera"), ("pixels", "[64]"), ("pixels", "[2, "
        "48]"), ("pixels", "[64, 48, 3]"), ("pixels", "[64, 5000]"),
        ("pixels", "[64.5, "
        "48]"), ("view", "34 mm"), ("wavelength", "0.3 deg"), ("noise", "much"), ("noise", ".nan"),
        ("noise", "1e400"), ("dropouts", "2 mm"), ("colour", "red"), ("at", "null"),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_refused_at_its_line(key: str, value: str, tmp_path: Path) -> None:
    found = refusal({**SAID, key: value}, tmp_path)
    line = 12 + list(SAID).index(key) if key in SAID else 12 + len(SAID)
    assert found[0].where.line == line, found
    assert all(each.message for each in found)


@pytest.mark.parametrize("key", ["eye", "pixels", "view", "wavelength", "noise", "at", "beam"])
def test_what_is_missing_is_named(key: str, tmp_path: Path) -> None:
    found = refusal({name: value for name, value in SAID.items() if name != key}, tmp_path)
    assert any(key in each.message for each in found), found
