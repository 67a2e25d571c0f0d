"""Readings for a calibration: files that say something strange are told as bad input."""

from pathlib import Path

import pytest

from cellwright.engine.formats.interop.calibration_files import read_held, read_plates
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader.scene_file import load_scene
from tests.places import BUNDLED

SCENE = load_scene(BUNDLED / "handey" / "scene.yaml")
ENDLESS = "1" + "0" * 400
HELD = '{"empty": "e.npy", "held": [{"joints": [%s, 0, 0, 0, 0, 0], "image": "b.npy"}]}'


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[" * 100_000, "nested too deeply"),
        ("[]", "no mapping"),
        ("{}", "has to be a list"),
        ('{"plates": [{"image": "a.npy"}]}', "`distance` and `image`"),
        ('{"plates": [{"distance": -1, "image": "a.npy"}]}', "positive number of millimetres"),
        ('{"plates": [{"distance": NaN, "image": "a.npy"}]}', "positive number of millimetres"),
        (
            f'{{"plates": [{{"distance": {ENDLESS}, "image": "a.npy"}}]}}',
            "positive number of millimetres",
        ),
        ('{"plates": [{"distance": 600, "image": "a.npy"}]}', "no such file"),
    ],
)
def test_strange_plates_are_told(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "plates.json").write_text(text)
    with pytest.raises(InvalidInput, match=said):
        read_plates(tmp_path / "plates.json", SCENE)


@pytest.mark.parametrize("number", [ENDLESS, "Infinity", "true", '"0"'])
def test_joint_values_that_are_no_numbers_are_told(number: str, tmp_path: Path) -> None:
    (tmp_path / "held.json").write_text(HELD % number)
    with pytest.raises(InvalidInput, match="has to be 6 numbers"):
        read_held(tmp_path / "held.json", SCENE)
