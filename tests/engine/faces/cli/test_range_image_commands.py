"""`cellwright measurement image` and `dimensions`: an image is made, read and measured; what cannot be is refused with advice."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from engine.faces.cli import app, exits

PATCH = "face=plane:100,100,150,150"


def told(*words: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["measurement", *words], env={"COLUMNS": "200"})
    return result.exit_code, result.output


@pytest.mark.slow
def test_an_image_that_was_written_is_measured(tmp_path: Path) -> None:
    file, picture = str(tmp_path / "m4.npz"), tmp_path / "m4.png"
    code, said = told("image", "bulkhead/twelve_points", "m4", "-o", file, "--format", "json")
    surface = json.loads(said)["data"]
    assert (code, json.loads(said)["status"]) == (0, "found"), said
    left, top, right, bottom = surface["patch"]
    patch = f"face=plane:{left},{top},{right},{bottom}"
    code, said = told("dimensions", file, "--patch", patch, "--picture", str(picture), "--format", "json")
    assert (code, json.loads(said)["status"]) == (0, "ok"), said
    assert list(json.loads(said)["data"]["fits"]) == ["face"]
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("target", "name", "said"),
    [
        ("gauging/wall", "p1", "p1 is taken with probe, which is no laser ranging tool"),
        ("bulkhead/twelve_points", "m99", "twelve_points.yaml: error K101: unknown measurement 'm99'"),
    ],
)
def test_no_image_is_made_of_what_no_ranging_tool_takes(target: str, name: str, said: str) -> None:
    code, output = told("image", target, name)
    assert code == exits.BAD_INPUT
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
    assert code == exits.BAD_INPUT
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
    assert code == exits.BAD_INPUT
    assert "--patch" in output or "--between" in output
