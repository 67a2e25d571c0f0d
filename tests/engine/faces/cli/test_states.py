"""`cellwright states` as a user types it."""

import json
from pathlib import Path
from xml.etree import ElementTree

import pytest
from click.testing import Result
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app

CELLS = Path(__file__).parents[3] / "domains"
SATELLITE = str(CELLS / "satellite")


def run(*arguments: str) -> Result:
    return CliRunner().invoke(app, ["states", *arguments], env={"COLUMNS": "120"})


def test_the_net_is_printed_as_tables() -> None:
    result = run(SATELLITE)
    assert result.exit_code == 0
    for said in (
        "servicer holds cover",
        "tear_off_cover_bus",
        "P4 -> P6 + P7",
        "covered: the cover is over the bays",
    ):
        assert said in result.stdout
    assert (
        "11 places (6 with a robot, 5 without), 14 transitions, 112 fully specified contact states"
        in result.stdout
    )


def test_the_net_as_data() -> None:
    result = run(SATELLITE, "--format", "json")
    found = json.loads(result.stdout)
    assert found["status"] == "ok"
    assert (len(found["data"]["places"]), found["data"]["states"], found["data"]["exact"]) == (
        11,
        112,
        True,
    )
    assert {each["filter"] for each in found["data"]["removed"]} == {"templates"}
    assert [each["exits"] for each in found["data"]["regions"]] == [1, 1, 1, 0]


def test_only_some_parts() -> None:
    result = run("themse", "--contacts", "--reduced", "MARS_gripper", "drawer")
    assert result.exit_code == 0
    assert (
        result.stdout
        == run("themse", "--reduced", "MARS_gripper", "--reduced", "drawer", "--contacts").stdout
    )
    assert "MARS_gripper:O1.grip_source:grip - THEMSE_drawer:O2.grip_target:grip" in result.stdout
    assert "probe" not in result.stdout


def test_a_part_without_the_option_is_refused() -> None:
    result = run("themse", "drawer")
    assert result.exit_code == 2
    assert "--reduced" in result.stderr


def test_a_part_that_is_not_there_is_refused() -> None:
    result = run("themse", "--reduced", "drawr")
    assert result.exit_code == 2
    assert "did you mean 'drawer'" in result.stderr


@pytest.mark.parametrize("full", [[], ["--full"]])
@pytest.mark.parametrize("form", ["svg", "pnml"])
def test_pictures_and_documents_are_xml(form: str, full: list[str]) -> None:
    result = run(SATELLITE, "--format", form, *full)
    assert result.exit_code == 0
    assert result.stdout == run(SATELLITE, "--format", form, *full).stdout
    ElementTree.fromstring(result.stdout)


def test_the_drawing_distinguishes_robot_places_and_names_operators() -> None:
    drawn = ElementTree.fromstring(run(SATELLITE, "--format", "svg").stdout)
    space = "{http://www.w3.org/2000/svg}"
    kinds = [each.get("class") for each in drawn.iter(f"{space}rect")]
    assert (kinds.count("robot"), kinds.count("device")) == (6, 5)
    texts = [each.text or "" for each in drawn.iter(f"{space}text")]
    assert "snap_in_module_bus" in texts
    assert "grip, release cover_bus" in texts


def test_no_boxes_of_the_drawing_overlap() -> None:
    drawn = ElementTree.fromstring(run("themse", "--format", "svg").stdout)
    boxes = [
        [float(each.get(name, "0")) for name in ("x", "y", "width", "height")]
        for each in drawn.iter("{http://www.w3.org/2000/svg}rect")
        if each.get("class") != "paper"
    ]
    for n, (x, y, width, height) in enumerate(boxes):
        for other_x, other_y, other_width, other_height in boxes[n + 1 :]:
            beside = x + width <= other_x or other_x + other_width <= x
            assert beside or y + height <= other_y or other_y + other_height <= y


def test_the_graph_for_graphviz() -> None:
    drawn = run(SATELLITE, "--format", "dot").stdout
    assert drawn.startswith("digraph states {")
    assert drawn.count("shape=box") == 14


def test_a_sequence_to_a_contact_state() -> None:
    result = run(
        SATELLITE, "--goal", "module:module_2.latch:latch - bus:bus.bay:bay_1", "--format", "json"
    )
    found = json.loads(result.stdout)["data"]["sequence"]
    assert [each.partition(":")[0] for each in found][-1] == "snap_in_module_bus"
    assert len(found) == 6
    none = run(
        SATELLITE,
        "--goal",
        "cover:cover.cover_edge:edge - bus:bus.cover_hinge:hinge",
        "--goal",
        "module:*.latch:* - bus:*.bay:*",
    )
    assert none.exit_code == 10


def test_a_goal_that_is_no_contact_is_refused() -> None:
    result = run(SATELLITE, "--goal", "module - bus")
    assert result.exit_code == 2
    assert "K710" in result.stderr


def test_what_a_part_brings() -> None:
    result = run(SATELLITE, "--brings", "cover")
    assert "cover brings" in result.stdout
    assert "templates removes: covered: the cover is over the bays" in result.stdout


@pytest.mark.slow
def test_the_generated_domain_is_written_and_planned(tmp_path: Path) -> None:
    result = run("themse", "--output", str(tmp_path / "cell"))
    assert result.exit_code == 0
    planned = CliRunner().invoke(
        app, ["plan", str(tmp_path / "cell" / "problems" / "in_furnace.yaml"), "--format", "json"]
    )
    assert planned.exit_code == 0
    assert "grip_probe_themse_furnace" in planned.stdout
    again = run("themse", "--output", str(tmp_path / "cell"))
    assert again.exit_code == 2
    assert "K403" in again.stderr


def test_options_that_would_change_nothing_are_refused(tmp_path: Path) -> None:
    assert run("themse", "--output", str(tmp_path / "cell"), "--full").exit_code == 2
    assert run("themse", "--goal", "x", "--full").exit_code == 2
