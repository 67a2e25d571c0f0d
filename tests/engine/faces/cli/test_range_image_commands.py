"""`cellwright measurement image` and `dimensions`: an image is made, read and measured; what
cannot be is refused with advice.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app
from cellwright.engine.faces.cli.process import exit_codes
from cellwright.engine.formats.interop.range_files import read_ranges, write_ranges

PATCH = "face=plane:100,100,150,150"


def told(*words: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["measurement", *words], env={"COLUMNS": "200"})
    return result.exit_code, result.output


@pytest.mark.slow
def test_the_image_that_a_tool_took_is_resolved_and_measured(tmp_path: Path) -> None:
    made, whole = str(tmp_path / "m4.npz"), str(tmp_path / "whole.npz")
    where = ("image", "bulkhead/twelve_points", "m4", "--format", "json")
    code, said = told(*where, "--displaced", "0.4", "0", "0", "-o", made, "--wrapped")
    first = json.loads(said)["data"]
    assert (code, read_ranges(Path(made)).wrapped) == (0, True)
    code, said = told(*where, "--from", made, "--seed", "5", "-o", whole)
    again = json.loads(said)["data"]
    assert (code, again["off"], again["sigma"]) == (0, first["off"], first["sigma"])
    assert abs(abs(again["off"]) - 0.4e-3) < 4 * again["sigma"]
    assert not read_ranges(Path(whole)).wrapped
    code, said = told(
        "image", "bulkhead/twelve_points", "m4", "--from", str(depth_of(whole, tmp_path))
    )
    assert code == 0, said
    assert "strengths are not known" in said
    other = read_ranges(Path(whole))
    write_ranges(Path(made), replace(other, tool=replace(other.tool, noise_m=1e-4)))
    code, said = told("image", "bulkhead/twelve_points", "m4", "--from", made)
    assert code == exit_codes.BAD_INPUT
    assert "another tool than slra of this cell has taken the image" in said


def depth_of(file: str, folder: Path) -> Path:
    """The image in a file as a depth image."""
    image = read_ranges(Path(file))
    np.save(folder / "depth.npy", image.range_m * image.beams[..., 2])
    return folder / "depth.npy"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--from", "a.npz", "--displaced", "1", "2", "3"), "--displaced"),
        (("--wrapped",), "--wrapped"),
    ],
)
def test_options_of_images_that_contradict_each_other_are_a_misuse(
    words: tuple[str, ...], said: str
) -> None:
    code, output = told("image", "bulkhead/twelve_points", "m4", *words)
    assert code == exit_codes.BAD_INPUT
    assert said in output


@pytest.mark.slow
def test_the_parts_that_are_seen_are_told_with_their_places_and_symmetries(tmp_path: Path) -> None:
    picture = tmp_path / "seen.png"
    code, said = told(
        "recognise", "--scene", "handey", "--picture", str(picture), "--format", "json"
    )
    found = json.loads(said)["data"]
    parts = {each["part"]: each for each in found["parts"]}
    assert (code, {name: len(each["equivalent"]) for name, each in parts.items()}) == (
        0,
        {"slab": 24, "brick": 4, "angle": 1},
    )
    assert parts["slab"]["T_eye_part"][2][3] == pytest.approx(0.97, abs=0.002)
    assert (found["unclear"], found["unexplained"], found["missing"]) == ([], [], {})
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_what_is_none_of_the_parts_that_are_looked_for_is_told(tmp_path: Path) -> None:
    code, said = told("recognise", "--scene", "handey", "--part", "slab", "--part", "brick")
    assert code == 0
    assert said.count("of it is seen") == 2
    assert "no part that is looked for, at (" in said
    empty = tmp_path / "empty.npy"
    np.save(empty, np.full((480, 640), 1.0))
    code, said = told("recognise", "--scene", "handey", "--part", "angle", "--image", str(empty))
    assert code == exit_codes.FINDINGS
    assert "angle is not found: nothing that is left in the image" in said


def test_a_part_that_a_scene_has_not_is_not_recognised() -> None:
    code, said = told("recognise", "--scene", "handey", "--part", "slap")
    assert code == exit_codes.BAD_INPUT
    assert "K101: unknown part 'slap'" in said


@pytest.mark.slow
def test_an_image_that_was_written_is_measured(tmp_path: Path) -> None:
    file, picture = str(tmp_path / "m4.npz"), tmp_path / "m4.png"
    code, said = told("image", "bulkhead/twelve_points", "m4", "-o", file, "--format", "json")
    surface = json.loads(said)["data"]
    assert (code, json.loads(said)["status"]) == (0, "found"), said
    left, top, right, bottom = surface["patch"]
    patch = f"face=plane:{left},{top},{right},{bottom}"
    code, said = told(
        "dimensions", file, "--patch", patch, "--picture", str(picture), "--format", "json"
    )
    assert (code, json.loads(said)["status"]) == (0, "ok"), said
    assert list(json.loads(said)["data"]["fits"]) == ["face"]
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("target", "name", "said"),
    [
        ("gauging/wall", "p1", "p1 is taken with probe, which is no laser ranging tool"),
        (
            "bulkhead/twelve_points",
            "m99",
            "twelve_points.yaml: error K101: unknown measurement 'm99'",
        ),
    ],
)
def test_no_image_is_made_of_what_no_ranging_tool_takes(target: str, name: str, said: str) -> None:
    code, output = told("image", target, name)
    assert code == exit_codes.BAD_INPUT
    assert said in output


@pytest.mark.parametrize(
    ("file", "content", "said"),
    [
        ("empty.npz", b"", "write it with `measurement image`"),
        ("empty.json", b"", "give a .npz file that `measurement image` has written"),
        ("missing.npz", None, "no such file"),
    ],
)
def test_a_file_that_is_no_range_image_is_refused(
    tmp_path: Path, file: str, content: bytes | None, said: str
) -> None:
    path = tmp_path / file
    if content is not None:
        path.write_bytes(content)
    code, output = told("dimensions", str(path), "--patch", PATCH)
    assert code == exit_codes.BAD_INPUT
    assert said in output


@pytest.mark.parametrize(
    "words",
    [
        ("--patch", "face=plane:100,100,100,150"),
        ("--patch", "face=torus:1,1,9,9"),
        ("--patch", PATCH, "--patch", PATCH),
        ("--patch", PATCH, "--between", "face,other"),
    ],
)
def test_a_patch_that_means_nothing_is_a_misuse(words: tuple[str, ...]) -> None:
    code, output = told("dimensions", "image.npz", *words)
    assert code == exit_codes.BAD_INPUT
    assert "--patch" in output or "--between" in output
