"""`measurement dimensions` from the command line: what it prints and what it refuses."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from engine.faces.cli import app
from engine.formats.interop.range_files import read_ranges, write_ranges
from engine.kernels.rigid import translation
from engine.model.ranging import RangeImage
from engine.stages.vision.ranging import expected, resolved, scanned
from kb.diagnostics import InvalidInput
from kb.model.ranging import Ranging
from tests.engine.stages.solids import block

TOOL = Ranging("laser", 48, 48, float(np.radians(8)), 0.3, 5e-5, 0.5, 0.0024, 0.0001)
STEPPED = [
    (block(0.1, 0.2, 0.01), translation(-0.05, 0, 0.5)),
    (block(0.3, 0.3, 0.01), translation(0, 0, 0.52)),
]
PATCHES = ("--patch", "near=plane:0,0,20,48", "--patch", "far=plane:30,0,48,48")


def run(*command: str | Path) -> tuple[int, str]:
    found = CliRunner().invoke(app, ["measurement", "dimensions", *map(str, command)])
    return found.exit_code, found.output


@pytest.fixture(scope="module")
def image(tmp_path_factory: pytest.TempPathFactory) -> Path:
    found = resolved(scanned(STEPPED, TOOL, 1), expected(STEPPED, TOOL), 0.002)
    assert isinstance(found, RangeImage)
    path = tmp_path_factory.mktemp("ranges") / "step.npz"
    write_ranges(path, found)
    return path


def test_a_step_is_as_high_as_it_is(image: Path) -> None:
    code, said = run(image, *PATCHES, "--between", "near,far", "--format", "json")
    assert code == 0
    assert '"distance"' in said
    json.loads(said)


def test_an_image_is_read_as_it_was_written(image: Path, tmp_path: Path) -> None:
    one = read_ranges(image)
    write_ranges(tmp_path / "again.npz", one)
    other = read_ranges(tmp_path / "again.npz")
    assert one.tool == other.tool == TOOL
    assert (one.range_m == other.range_m).all()
    assert (one.strength == other.strength).all()


def test_wrapped_ranges_are_refused(image: Path, tmp_path: Path) -> None:
    write_ranges(tmp_path / "wrapped.npz", replace(read_ranges(image), wrapped=True))
    code, said = run(tmp_path / "wrapped.npz", *PATCHES)
    assert code == 2
    assert "K702" in said
    assert "modulo half a wavelength" in said


@pytest.mark.parametrize(
    "patch", ["p=plane", "p=plane:1,2,3", "p=ball:0,0,9,9", "p=plane:9,9,9,9", "p=plane:-1,0,9,9"]
)
def test_strange_patches_are_refused(image: Path, patch: str) -> None:
    assert run(image, "--patch", patch)[0] == 2


def test_a_patch_beyond_the_picture_is_refused(image: Path) -> None:
    code, said = run(image, "--patch", "p=plane:0,0,49,48")
    assert code == 2
    assert "beyond the picture" in said


@pytest.mark.parametrize("content", [b"", b"PK", b"\x00" * 100, b"range_m"])
def test_files_without_ranges_are_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "bad.npz").write_bytes(content)
    with pytest.raises(InvalidInput) as found:
        read_ranges(tmp_path / "bad.npz")
    assert found.value.diagnostics[0].code == "K702"
    code, said = run(tmp_path / "bad.npz", *PATCHES)
    assert code == 2
    assert "Traceback" not in said
