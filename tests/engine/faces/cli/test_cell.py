import json
from importlib.metadata import version
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app

run = CliRunner().invoke


def test_a_cell_is_told_with_what_is_in_collision() -> None:
    result = run(
        app,
        ["cell", "show", "themse", "--configuration", "0, 45, -20, 0, 60, 0", "--format", "json"],
    )
    envelope = json.loads(result.stdout)
    assert (result.exit_code, envelope["status"]) == (0, "ok")
    contact = envelope["data"]["contacts"][0]
    assert contact["depth_m"] > 0
    assert len(contact["between"]) == len(contact["points"]) == 2


def test_a_place_is_shown_with_the_tool_that_it_needs() -> None:
    result = run(app, ["cell", "show", "bulkhead/one_point", "--place", "meas(m2)"])
    assert result.exit_code == 0
    assert "nothing is in collision" in result.stdout


@pytest.mark.parametrize(
    "targets",
    [
        ("themse", "themse/one"),
        pytest.param(("themse", "themse/lid_on_stand", "themse/one"), marks=pytest.mark.slow),
    ],
)
def test_a_problem_is_shown_as_it_begins(targets: tuple[str, ...]) -> None:
    """The file has everything open and the lid on its stand; in one of the problems the lid is
    on the freezer.
    """
    seen = {run(app, ["cell", "show", target, "--format", "svg"]).stdout for target in targets}
    assert len(seen) == len(targets)


@pytest.mark.parametrize(
    ("form", "begins"), [("png", b"\x89PNG"), ("svg", b"<svg"), ("gltf", b'{"asset"')]
)
def test_pictures_are_written_to_files(form: str, begins: bytes, tmp_path: Path) -> None:
    file = tmp_path / f"cell.{form}"
    result = run(app, ["cell", "show", "handey", "-o", str(file)])
    assert result.exit_code == 0, result.output
    assert file.read_bytes().startswith(begins)
    other = tmp_path / "cell.bin"
    assert run(app, ["cell", "show", "handey", "--format", form, "-o", str(other)]).exit_code == 0
    assert other.read_bytes() == file.read_bytes()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--configuration", "0, 0"], "manutec_r3 has 6 joints"),
        (["--configuration", "0, 0, x, 0, 0, 0"], "not a number"),
        (["--configuration", "left: 0, 0, 0, 0, 0, 0"], "unknown arm 'left'"),
        (["--place", "slot(drawer, 9)"], "unknown place"),
        (["--format", "png"], "give --output"),
        (["--output", "cell.bin"], "--output has no effect"),
    ],
)
def test_what_cannot_be_shown_is_told(options: list[str], said: str) -> None:
    result = run(app, ["cell", "show", "themse", *options])
    assert result.exit_code == 2
    assert said in result.stderr


def test_a_domain_without_a_cell_has_no_picture(tmp_path: Path) -> None:
    (tmp_path / "domain.yaml").write_text("domain: bare\ntypes: {thing: object}\n")
    result = run(app, ["cell", "show", str(tmp_path)])
    assert result.exit_code == 2
    assert "there is no cell.yaml" in result.stderr


def test_the_version_is_told() -> None:
    result = run(app, ["--version"])
    assert result.exit_code == 0
    assert result.stdout == f"cellwright {version('cellwright')}\n"
