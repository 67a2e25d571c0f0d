"""From files to tours: tables, the partition by tool, and the commands."""

import json
import shutil
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app
from cellwright.engine.formats.interop.inspection_files import import_file
from cellwright.engine.formats.interop.measurement_tables import read_table
from cellwright.engine.pipelines.inspection.tool_tours import partition_by_tool, tour_problem
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import load
from tests.places import BUNDLED

BULKHEAD = BUNDLED / "bulkhead"
TABLE = """name,x,y,z,nx,ny,nz,kind,tolerance,bore
a,0,0,0,0,0,1,profile,0.5,
b,10,0,0,0,0,2,profile,,
c,20,0,0,0,0,1,thickness,0.5,
d,30,0,0,0,0,1,profile,0.001,
e,40,0,0,0,0,1,profile,,1
g,50,0,0,0,0,1,thickness,,
"""


@pytest.fixture
def table(tmp_path: Path) -> Path:
    file = tmp_path / "points.csv"
    file.write_text(TABLE)
    return file


def run(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, arguments)
    return result.exit_code, result.stdout


def imported(table: Path) -> Path:
    file = table.with_suffix(".yaml")
    assert run("import", "qif", str(table), "--output", str(file))[0] == 0
    return file


def test_rules_say_which_tool_measures_what_and_why_the_rest_cannot_be_measured(
    table: Path,
) -> None:
    _, parts, _ = import_file(table, "bulkhead")
    assert dict(parts.groups) == {"slra": ("a", "b"), "us_probe": ("c", "g")}
    assert dict(parts.impossible) == {
        "d": "slra is too coarse for the tolerance",
        "e": "slra is too broad for the bore",
    }


def test_what_is_imported_is_read_again_as_it_was_parted(table: Path) -> None:
    _, parts, _ = import_file(table, "bulkhead")
    problem = load(imported(table)).problem
    assert problem is not None
    assert partition_by_tool(problem) == parts


def test_a_tool_that_is_not_available_and_what_is_done_stand_apart(table: Path) -> None:
    file = imported(table)
    text = file.read_text().replace("statics:\n", "statics:\n  - unavailable(us_probe)\n")
    file.write_text(text + "initial:\n  - measured(slra, t3_746, meas(a))\n")
    problem = load(file).problem
    assert problem is not None
    parts = partition_by_tool(problem)
    assert (dict(parts.groups), parts.done) == ({"slra": ("b",)}, ("a",))
    assert parts.impossible["c"] == "us_probe is not available"


def test_changes_of_tools_cost_what_the_domain_says(table: Path) -> None:
    problem = load(imported(table)).problem
    assert problem is not None
    tours = tour_problem(problem, partition_by_tool(problem))
    names = [visit.name for visit in tours.visits]
    assert tours.travel[names.index("a"), names.index("b")] == 10_000
    assert tours.arcs[names.index("a"), names.index("c")] == 20_000 + 2_000_000


def test_a_problem_is_sequenced_tool_by_tool(table: Path) -> None:
    code, out = run("sequence", str(imported(table)), "--format", "json")
    answer = json.loads(out)["data"]
    assert (code, answer["cost"]) == (0, 2_000_000 + 30_000 + 30_000 - 10_000)
    assert sorted(answer["tools"]) in (answer["tools"], answer["tools"][::-1])
    assert set(answer["partition"]["impossible"]) == {"d", "e"}


def test_inches_of_a_table_are_inches(table: Path) -> None:
    assert read_table(table, "in").points[1].position[0] == pytest.approx(0.254)
    assert read_table(table, "mm").points[1].normal == (0, 0, 1)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("b,10", "b,ten", "'ten' is not a number"),
        ("b,10", "a,10", "the name 'a' is used twice"),
        ("b,10", "B 1,10", "is not a name"),
        ("b,10", "b,nan", "is not a number"),
        ("0,0,2,profile", "0,0,0,profile", "no length"),
        ("name,x", "name,u", "no column 'x'"),
    ],
)
def test_what_is_wrong_in_a_table_is_said(table: Path, old: str, new: str, said: str) -> None:
    table.write_text(TABLE.replace(old, new))
    with pytest.raises(InvalidInput) as caught:
        read_table(table)
    assert said in str(caught.value)


def test_a_domain_that_chooses_no_tools_is_refused(table: Path) -> None:
    assert run("import", "qif", str(table), "--domain", "themse")[0] == 2


def test_measurements_are_added_changed_and_removed_and_the_rest_of_the_file_stays(
    table: Path,
) -> None:
    file = imported(table)
    before = file.read_text()
    file.write_text(before.replace("statics:\n", "statics:  # kept\n  # kept, too\n"))
    assert (
        run("measurement", "add", str(file), "h", "--at", "60", "0", "0", "--tolerance", "0.2")[0]
        == 0
    )
    groups = json.loads(run("measurement", "list", str(file), "--format", "json")[1])["data"][
        "groups"
    ]
    assert groups["slra"] == ["a", "b", "h"]
    assert (
        run("measurement", "edit", str(file), "h", "--at", "60", "0", "0", "--kind", "thickness")[0]
        == 0
    )
    groups = json.loads(run("measurement", "list", str(file), "--format", "json")[1])["data"][
        "groups"
    ]
    assert groups["us_probe"] == ["c", "g", "h"]
    assert run("measurement", "remove", str(file), "h")[0] == 0
    assert file.read_text().replace("  # kept\n", "\n").replace("  # kept, too\n", "") == before


@pytest.mark.parametrize("wrong", [("add", "a"), ("edit", "z"), ("add", "Z z"), ("remove", "z")])
def test_a_change_that_does_not_fit_changes_nothing(table: Path, wrong: tuple[str, str]) -> None:
    file = imported(table)
    before = file.read_text()
    place = () if wrong[0] == "remove" else ("--at", "1", "2", "3")
    assert run("measurement", wrong[0], str(file), wrong[1], *place)[0] == 2
    assert file.read_text() == before
    assert list(file.parent.glob(".*")) == []


def test_measurements_whose_places_a_cell_describes_are_toured_by_the_time_of_the_arm() -> None:
    code, out = run(
        "sequence", "bulkhead/twelve_points", "--cost", "joints", "--work", "50", "--format", "json"
    )
    answer = json.loads(out)["data"]
    assert code == 0
    assert answer["partition"]["impossible"] == {}
    tours = {each["tool"]: each for each in answer["tours"]}
    assert {tool: len(each["visits"]) for tool, each in tours.items()} == {
        "slra": 4,
        "us_probe": 10,
    }
    for each in tours.values():
        ring = [*each["configurations"], each["configurations"][0]]
        moves = (max(abs(a - b) for a, b in zip(*pair, strict=True)) for pair in pairwise(ring))
        assert each["cost"] == pytest.approx(1e6 * sum(moves), abs=100)
        assert sorted(each["visits"]) == sorted({*each["visits"]})


def test_straight_lines_go_between_the_places_of_the_cell() -> None:
    data = json.loads(run("sequence", "bulkhead/twelve_points", "--format", "json")[1])["data"]
    cell = yaml.safe_load((BULKHEAD / "cell.yaml").read_text())
    at = [np.array(cell["places"][f"meas({name})"]["at"]) for name in data["visits"]]
    assert data["partition"]["impossible"] == {}
    change = 2_000_000 * sum(a != b for a, b in pairwise(data["tools"]))
    way = 1e6 * sum(float(np.linalg.norm(b - a)) for a, b in pairwise(at))
    assert data["cost"] == pytest.approx(way + change, abs=12)


def test_what_has_no_position_anywhere_is_impossible(tmp_path: Path) -> None:
    shutil.copytree(BULKHEAD, tmp_path / "bulkhead", ignore=shutil.ignore_patterns("cell.yaml"))
    file = tmp_path / "bulkhead" / "problems" / "twelve_points.yaml"
    data = json.loads(run("sequence", str(file), "--format", "json")[1])["data"]
    assert data["visits"] == []
    assert set(data["partition"]["impossible"].values()) == {"its position is not known"}


def test_joint_times_go_without_ends() -> None:
    assert run("sequence", "bulkhead/twelve_points", "--cost", "joints", "--closed")[0] == 2
