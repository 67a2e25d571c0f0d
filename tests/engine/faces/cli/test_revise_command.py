import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from engine.faces.cli import app

run = CliRunner().invoke


@pytest.fixture
def plan(tmp_path: Path) -> str:
    file = tmp_path / "plan.json"
    file.write_text(run(app, ["plan", "bulkhead/one_point", "--format", "json"]).stdout)
    return str(file)


def test_the_answer_says_what_was_kept_and_added(plan: str, tmp_path: Path) -> None:
    lost = [
        "--done",
        "1..2",
        "--gone",
        "holding(t3_746, us_probe)",
        "--holds",
        "location(us_probe, t3_746, in_rack)",
    ]
    result = run(app, ["revise", plan, *lost, "--format", "json"])
    found = json.loads(result.stdout)["data"]
    assert result.exit_code == 0
    assert found["revision"]["way"] == "repaired"
    assert "pick_up(t3_746, us_probe)" in found["revision"]["added"]
    revised = tmp_path / "revised.json"
    revised.write_text(result.stdout)
    assert run(app, ["validate", str(revised)]).exit_code == 0
    said = run(app, ["revise", plan, *lost]).stdout
    assert "repaired: " in said
    assert "+ pick_up(t3_746, us_probe)" in said


def test_as_expected_the_rest_goes_on(plan: str) -> None:
    found = json.loads(run(app, ["revise", plan, "--done", "1, 2", "--format", "json"]).stdout)["data"][
        "revision"
    ]
    assert (found["way"], found["added"], found["dropped"], len(found["kept"])) == ("continued", [], [], 3)


@pytest.mark.parametrize(
    "options",
    [
        ("--done", "9"),
        ("--done", "x"),
        ("--holds", "att(t3_746)"),
        ("--holds", "at(t3_746)"),
        ("--gone", "at("),
    ],
)
def test_what_is_no_step_or_fact_is_bad_input(plan: str, options: tuple[str, str]) -> None:
    assert run(app, ["revise", plan, *options]).exit_code == 2
