import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app

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
    found = json.loads(run(app, ["revise", plan, "--done", "1, 2", "--format", "json"]).stdout)[
        "data"
    ]["revision"]
    assert (found["way"], found["added"], found["dropped"], len(found["kept"])) == (
        "continued",
        [],
        [],
        3,
    )


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


SENTENCE = "heat probe 2 for 10 min, then cool it for 5 min"


@pytest.fixture
def said_plan(tmp_path: Path) -> str:
    """A plan of a sentence, which belongs to no problem file."""
    file = tmp_path / "said.json"
    file.write_text(run(app, ["plan", "themse", "--command", SENTENCE, "--format", "json"]).stdout)
    return str(file)


@pytest.mark.slow
@pytest.mark.parametrize("lost", ["slot(freezer, 1)", "freezer", "slot(freezer,1), lid"])
def test_a_place_can_be_lost_by_its_term(said_plan: str, lost: str) -> None:
    # what cannot be cooled any more is not heated either: nothing is left to do
    assert run(app, ["revise", said_plan, "--lost", lost]).exit_code == 10
    for wrong in ("slot(freezr, 1)", "5"):
        assert run(app, ["revise", said_plan, "--lost", wrong]).exit_code == 2


@pytest.mark.slow
def test_a_plan_of_a_sentence_is_diagnosed_beside_its_domain(said_plan: str) -> None:
    case = ["--exception", "grip_failed", "--step", "pick(lid, rim)", "--hidden", "gripper_worn"]
    result = run(
        app,
        ["diagnose", "themse", "--plan", said_plan, *case, "--recover", "--objective", "repair"],
    )
    assert result.exit_code == 0, result.output
    assert "the failed plan is continued" in result.stdout
    other = run(app, ["diagnose", "themse/one", "--plan", said_plan, *case])
    assert other.exit_code == 2
