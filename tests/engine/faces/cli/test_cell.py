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


@pytest.mark.parametrize(
    ("form", "begins"), [("png", b"\x89PNG"), ("svg", b"<svg"), ("gltf", b'{"asset"')]
)
def test_a_hollow_mesh_has_a_picture_without_a_package_that_divides_it(
    tmp_path: Path, form: str, begins: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "cellwright.engine.stages.geometry.shapes.meshes.has_decomposer", lambda: False
    )
    outline = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]
    corners = [(x / 10, y / 10, z / 10) for z in (0, 1) for x, y in outline]
    faces = [(0, 2, 1), (0, 3, 2), (0, 4, 3), (0, 5, 4)]
    faces += [tuple(6 + each for each in reversed(face)) for face in faces]
    faces += [
        t for a in range(6) for b in [(a + 1) % 6] for t in [(a, b, b + 6), (a, b + 6, a + 6)]
    ]
    lines = [f"v {x} {y} {z}" for x, y, z in corners] + [
        f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces
    ]
    (tmp_path / "l.obj").write_text("\n".join(lines) + "\n")
    (tmp_path / "domain.yaml").write_text(
        "domain: flat\ntypes: {thing: object}\nobjects: {thing: [a]}\nfluents:\n  moved(thing): "
        "{}\noperators:\n"
        "  go(Thing): {preconditions: not moved(Thing), adds: moved(Thing), duration: 1}\n"
    )
    (tmp_path / "cell.yaml").write_text(
        "cell: flat\nfixtures:\n  angle: {shapes: [{mesh: {file: l.obj}}]}\n"
    )
    output = tmp_path / f"a.{form}"
    assert run(app, ["cell", "show", str(tmp_path), "-o", str(output)]).exit_code == 0
    assert output.read_bytes().startswith(begins)
