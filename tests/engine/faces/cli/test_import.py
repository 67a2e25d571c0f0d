"""From a file of measurements to a plan, with the commands of the documentation."""

import json
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app
from tests.engine.formats.interop.qif_parts import Document, plane, segment
from tests.places import BUNDLED

TABLE = "name,x,y,z,nx,ny,nz,kind\na,0,0,0,0,0,1,profile\nb,10,0,0,0,0,1,thickness\n"


def run(*arguments: str) -> tuple[int, str, str]:
    result = CliRunner().invoke(app, arguments)
    return result.exit_code, result.stdout, result.stderr


@pytest.fixture
def part(tmp_path: Path) -> Path:
    """A square of 50 mm, and a thread."""
    document = Document()
    corners = [(0, 0, 0), (50, 0, 0), (50, 50, 0), (0, 50, 0)]
    edges = [
        document.coedge(segment(a, b), (a, b))[0]
        for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)
    ]
    document.feature("Plane", [document.face(plane(), [document.loop(edges)])])
    document.feature("Threaded", [])
    return document.written(tmp_path)


def test_an_imported_part_is_checked_sequenced_and_planned_from_another_folder(
    part: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, elsewhere = tmp_path / "out" / "inspection.yaml", tmp_path / "elsewhere"
    file.parent.mkdir()
    elsewhere.mkdir()
    monkeypatch.chdir(BUNDLED.parent)
    domain = str((BUNDLED / "bulkhead").relative_to(BUNDLED.parent))
    code, _, told = run(
        "import", "qif", str(part), "--output", str(file), "--unit", "mm", "--domain", domain
    )
    assert code == 0
    assert "has no points: a thread needs a gauge" in " ".join(told.split())
    monkeypatch.chdir(elsewhere)
    assert run("check", str(file))[0] == 0
    assert run("sequence", str(file))[0] == 0
    code, out, _ = run("plan", str(file), "--format", "json")
    assert code == 0
    steps = [each["operator"] for each in json.loads(out)["data"]["plan"]["steps"]]
    assert sum(each.startswith("laser_measure(") for each in steps) == file.read_text().count(
        "- measured("
    )


def test_an_imported_table_is_planned(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("points.txt").write_text(TABLE)
    assert run("import", "csv", "points.txt", "--unit", "in")[0] == 0
    assert "position(b, 254000, 0, 0)" in Path("points.yaml").read_text()
    assert run("plan", "points.yaml")[0] == 0


def test_the_distance_to_edges_is_in_the_unit_that_is_given(part: Path, tmp_path: Path) -> None:
    for unit, distance in (("mm", "20"), ("cm", "2"), ("m", "0.02")):
        file = tmp_path / f"{unit}.yaml"
        arguments = ("--unit", unit, "--edge-distance", distance)
        assert run("import", "qif", str(part), "--output", str(file), *arguments)[0] == 0
        places = [line for line in file.read_text().splitlines() if "position(" in line]
        for each in places:
            x, y = (int(text) for text in each.split(",")[1:3])
            assert 20_000 <= x <= 30_000
            assert 20_000 <= y <= 30_000


def test_a_point_with_the_name_of_a_tool_is_refused(tmp_path: Path) -> None:
    table = tmp_path / "points.csv"
    table.write_text(TABLE.replace("a,0", "slra,0"))
    code, _, told = run("import", "csv", str(table), "--output", str(tmp_path / "x.yaml"))
    assert code == 2
    assert "already has an object 'slra'" in " ".join(told.split())


def test_facts_that_a_domain_does_not_declare_are_left_out_and_told(
    tmp_path: Path, part: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copytree(BUNDLED / "bulkhead", "mine")
    shutil.copytree(BUNDLED / "devices" / "measuring", "mine/devices/measuring")
    for file in (each for each in Path("mine").rglob("*") if each.suffix in (".yaml", ".lp")):
        lines = file.read_text("utf-8").splitlines(keepends=True)
        file.write_text("".join(line for line in lines if "normal(" not in line), "utf-8")
    code, _, told = run("import", "qif", str(part), "--domain", "mine")
    assert code == 0
    assert "declares no 'normal'" in " ".join(told.split())
    assert run("sequence", "part.yaml")[0] == 0
