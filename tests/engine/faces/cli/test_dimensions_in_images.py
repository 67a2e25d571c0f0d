"""`measurement dimensions` from the command line: what it prints and what it refuses."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app
from cellwright.engine.formats.interop.range_files import read_ranges, write_ranges
from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.rigid import translation
from cellwright.engine.model.vision import RangeImage, picture_of
from cellwright.engine.stages.vision.sensor_images import (
    expected_ranges,
    resolve_ranges,
    scan_solids,
)
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.cell_model import Ranging
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
    found = resolve_ranges(scan_solids(STEPPED, TOOL, 1), expected_ranges(STEPPED, TOOL), 0.002)
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


@pytest.fixture(scope="module")
def wrapped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("ranges") / "wrapped.npz"
    write_ranges(path, scan_solids(STEPPED, TOOL, 1))
    return path


def test_wrapped_ranges_are_refused_if_nothing_is_expected(wrapped: Path) -> None:
    code, said = run(wrapped, *PATCHES)
    assert code == 2
    assert "K702" in said
    assert "modulo half a wavelength" in said
    assert "--about" in said


def distance(said: str) -> dict[str, float]:
    (found,) = (
        each
        for each in json.loads(said)["data"]["between"]["near, far"]
        if each["what"] == "distance"
    )
    return found  # type: ignore[no-any-return]


def step(*command: str | Path) -> dict[str, float]:
    """The height of the step as a command tells it."""
    code, said = run(*command, *PATCHES, "--between", "near,far", "--format", "json")
    assert code == 0, said
    return distance(said)


def test_wrapped_ranges_are_resolved_by_a_distance_or_by_an_image(
    wrapped: Path, image: Path
) -> None:
    by_distance = step(wrapped, "--about", "505", "--expected", "5")
    by_image = step(wrapped, "--about", image, "--expected", "2")
    for found in (by_distance, by_image):
        assert found["value"] == pytest.approx(0.02, abs=4 * found["sigma"])
        assert found["sigma"] < 1e-5


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--about", "505", "--expected", "25"), "ranges repeat every 150 mm"),
        (("--about", "505", "--expected", "nan"), "--expected"),
        (("--about", "nan"), "give a distance"),
        (("--about", "-1"), "give a distance"),
        (("--about", "nowhere.npz"), "no such file"),
        (("--about", "WRAPPED"), "wrapped, too"),
    ],
)
def test_what_cannot_resolve_ranges_is_refused(
    wrapped: Path, words: tuple[str, ...], said: str
) -> None:
    code, output = run(
        wrapped, *(str(wrapped) if each == "WRAPPED" else each for each in words), *PATCHES
    )
    assert code == 2, output
    assert said in output


def test_ranges_that_are_whole_need_no_expectation(image: Path) -> None:
    code, said = run(image, "--about", "505", *PATCHES)
    assert code == 2
    assert "leave --about out" in said


CELL = """cell: bench
fixtures:
  stand: {shapes: [{box: [0.1, 0.1, 0.1]}]}
tools:
  scanner:
    in: stand
    shapes: [{box: [0.1, 0.1, 0.1]}]
    features: {tip: {at: [0, 0, 0.1]}, laser: {at: [0, 0, 0.05]}}
  probe: {in: stand, shapes: [{box: [0.1, 0.1, 0.1]}], features: {tip: {at: [0, 0, 0.1]}}}
measuring:
  scanner:
    ranging: {eye: laser, pixels: [48, 48], view: 8 deg, wavelength: 0.3 m, noise: 0.05 mm, at: 0.5 m, beam: 0.0024 rad,
      pointing: 0.0001 rad}
  probe: {approach: 10 mm}
"""


@pytest.fixture
def cell(tmp_path: Path) -> str:
    (tmp_path / "cell.yaml").write_text(CELL)
    return str(tmp_path / "cell.yaml")


def written(depth: Floats, path: Path) -> Path:
    """A depth image in the form that the ending says; clouds hold the points of all pixels with
    an answer.
    """
    rays = picture_of(TOOL).rays(*np.mgrid[:48, :48].astype(float)[::-1])
    points = (depth[..., None] * rays)[depth > 0]
    match path.suffix:
        case ".npy":
            np.save(path, depth)
        case ".png":
            Image.fromarray(np.rint(1e3 * depth).astype(np.uint16)).save(path)
        case ".pcd":
            head = (
                f"FIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nCOUNT 1 1 1\nPOINTS {len(points)}\nDATA "
                "binary\n"
            )
            path.write_bytes(head.encode() + points.astype("<f8").tobytes())
        case ".ply":
            axes = "".join(f"property double {axis}\n" for axis in "xyz")
            head = (
                "ply\nformat binary_little_endian 1.0\nelement vertex "
                f"{len(points)}\n{axes}end_header\n"
            )
            path.write_bytes(head.encode() + points.astype("<f8").tobytes())
    return path


@pytest.mark.parametrize("ending", [".npy", ".pcd", ".ply", ".png"])
def test_depth_images_of_others_are_measured(
    ending: str, image: Path, cell: str, tmp_path: Path
) -> None:
    own = read_ranges(image)
    depth = own.range_m * own.beams[..., 2]
    found = step(written(depth, tmp_path / f"depth{ending}"), "--tool", cell, "scanner")
    assert found["value"] == pytest.approx(0.02, abs=4 * found["sigma"])
    # Whole millimetres do not average away.
    assert (found["sigma"] > 2.5e-4) == (ending == ".png")


def test_a_depth_image_says_what_it_does_not_tell(image: Path, cell: str, tmp_path: Path) -> None:
    own = read_ranges(image)
    file = written(own.range_m * own.beams[..., 2], tmp_path / "depth.png")
    code, said = run(file, "--tool", cell, "scanner", "--patch", "bore=circle:0,0,48,48")
    assert code == 1
    assert "strengths are not known" in said
    assert "rounded to 1 mm" in said
    assert "a depth image does not tell how strong answers were" in said


@pytest.mark.parametrize("tool", ["scaner", "probe"])
def test_a_tool_that_is_no_ranging_tool_is_named(
    image: Path, cell: str, tmp_path: Path, tool: str
) -> None:
    file = written(read_ranges(image).range_m, tmp_path / "depth.npy")
    code, said = run(file, "--tool", cell, tool, *PATCHES)
    assert code == 2
    assert f"unknown laser ranging tool '{tool}'" in said


def test_a_depth_image_needs_its_tool(image: Path, tmp_path: Path) -> None:
    code, said = run(written(read_ranges(image).range_m, tmp_path / "depth.npy"), *PATCHES)
    assert code == 2
    assert "say it with --tool" in said


def test_a_depth_image_of_another_size_is_refused(cell: str, tmp_path: Path) -> None:
    np.save(tmp_path / "small.npy", np.full((6, 8), 0.5))
    code, said = run(tmp_path / "small.npy", "--tool", cell, "scanner", *PATCHES)
    assert code == 2
    assert "8 x 6 pixels" in said


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
