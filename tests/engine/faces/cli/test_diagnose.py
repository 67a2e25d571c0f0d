"""`cellwright diagnose`: whole trees, scripted and simulated cases, questions, recovery, and
what is learned.
"""

import json
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app

STEP = "us_measure(us_probe, t3_746, m1)"


def run(*arguments: str, typed: str = "") -> Result:
    return CliRunner().invoke(app, ["diagnose", *arguments], input=typed, env={"COLUMNS": "120"})


def data(*arguments: str, code: int = 0) -> Any:
    result = run(*arguments, "--format", "json")
    assert result.exit_code == code, result.output
    return json.loads(result.stdout)["data"]


def test_the_whole_tree_has_its_expected_cost() -> None:
    found = data("bulkhead", "--exception", "no_echo", "--tree")
    assert found["expected cost"] == found["bound"]
    assert _expected(found["tree"]) == pytest.approx(found["expected cost"], abs=1e-6)


def _expected(part: Any) -> float:
    following = part.get("outcomes", {}).values()
    return float(part["probability"] * part.get("cost", 0.0) + sum(map(_expected, following)))


def test_the_picture_of_a_tree_is_svg_with_every_cause() -> None:
    drawn = run("bulkhead", "--exception", "no_echo", "--tree", "--format", "svg").stdout
    texts = {each.text for each in ET.fromstring(drawn).iter("{http://www.w3.org/2000/svg}text")}
    assert {
        "missing_couplant",
        "broken_probe",
        "loose_cable",
        "tilted_contact",
        "wet",
        "dry",
    } <= texts


def test_scripted_outcomes_lead_to_the_cause() -> None:
    found = data(
        "bulkhead",
        "--exception",
        "no_echo",
        "--outcomes",
        "look_at_spot=wet, tool_self_test=failed",
    )
    assert found["isolated"]
    assert found["hypotheses"][0]["causes"] == ["broken_probe"]
    assert found["repairs"] == ["mend_tool"]


def test_a_case_that_stays_open_says_so() -> None:
    found = data(
        "themse",
        "--exception",
        "bayonet_stuck",
        "--outcomes",
        "look_into_drawer=as_modelled",
        code=12,
    )
    assert not found["isolated"]
    assert len(found["hypotheses"]) == 5


def test_outcomes_are_asked_for_by_number_or_name() -> None:
    result = run("bulkhead", "--exception", "no_echo", typed="1\nwhat\nfailed\n")
    assert result.exit_code == 0
    assert "cause: broken_probe" in result.stdout
    assert "look_at_spot" in result.stderr


def test_an_explanation_compares_with_the_runner_up() -> None:
    found = data("bulkhead", "--exception", "no_echo", "--explain")
    assert found["action"] == "look_at_spot"
    assert min(found["alternatives"].values()) >= found["expected cost"]


def test_set_up_makes_tests_dearer() -> None:
    alone = data("bulkhead", "--exception", "implausible_value", "--tree")
    placed = data(
        "bulkhead/one_point", "--exception", "implausible_value", "--step", STEP, "--tree"
    )
    assert placed["expected cost"] > alone["expected cost"]


def test_the_planner_goes_on_from_what_was_found() -> None:
    arguments = ("bulkhead/one_point", "--exception", "implausible_value", "--step", STEP)
    found = data(*arguments, "--hidden", "missing_couplant", "--recover")
    assert "couplant_applied(goal_point(meas(m1)))" in found["withdrawn"]
    assert found["recovery"]["status"] in ("found", "optimal")


def test_closed_cases_change_the_next_belief(tmp_path: Path) -> None:
    store = str(tmp_path / "cases.db")
    case = ("bulkhead", "--exception", "no_echo", "--store", store)
    before = data(*case, "--tree")["expected cost"]
    for _ in range(3):
        data(*case, "--hidden", "broken_probe")
    assert data(*case, "--tree")["expected cost"] != before
    assert len(data("bulkhead", "--history", "--store", store)["cases"]) == 3
    aged = data("bulkhead", "--age", "0.5", "--history", "--store", store)["cases"]
    assert [each["weight"] for each in aged] == [0.5] * 3
    assert data("bulkhead", "--reset", "--store", store)["cases"] == []
    assert data(*case, "--tree")["expected cost"] == before


def test_counts_are_imported(tmp_path: Path) -> None:
    store, counts = str(tmp_path / "cases.db"), tmp_path / "counts.json"
    counts.write_text('{"no_echo": {"broken_probe": 40}}')
    found = data("bulkhead", "--import", str(counts), "--store", store)["cases"]
    assert found == [
        {"exception": "no_echo", "causes": ["broken_probe"], "weight": 40.0, "cost": 0.0}
    ]


@pytest.mark.parametrize(
    "arguments",
    [
        ("bulkhead", "--exception", "no_ecko"),
        ("bulkhead", "--exception", "no_echo", "--outcomes", "look_at_spot=damp"),
        ("bulkhead", "--exception", "no_echo", "--outcomes", "look=wet"),
        ("bulkhead", "--exception", "no_echo", "--hidden", "gremlins"),
        ("bulkhead", "--exception", "no_echo", "--step", "us_measure("),
        ("bulkhead", "--exception", "no_echo", "--step", "us_measure(us_probe, t3_746)"),
        ("bulkhead", "--exception", "no_echo", "--step", "move(t3_746, meas(m1), meas(m2))"),
        (
            "bulkhead/one_point",
            "--exception",
            "no_echo",
            "--step",
            "us_measure(us_probe, t3_746, m99)",
        ),
        ("bulkhead", "--exception", "no_echo", "--hidden", "loose_cable", "--recover"),
        ("bulkhead", "--history"),
    ],
)
def test_what_is_not_there_is_named(arguments: tuple[str, ...]) -> None:
    result = run(*arguments)
    assert result.exit_code == 2
    assert "try:" in result.stderr


def test_the_same_seed_gives_the_same_case() -> None:
    arguments = (
        "themse",
        "--exception",
        "lost_on_the_way",
        "--hidden",
        "low_voltage",
        "--seed",
        "4",
    )
    assert run(*arguments).stdout == run(*arguments).stdout


def test_the_interrupted_step_may_be_a_number_of_the_plan(tmp_path: Path) -> None:
    plan = tmp_path / "plan.json"
    made = CliRunner().invoke(app, ["plan", "bulkhead/one_point", "--format", "json"]).stdout
    plan.write_text(made)
    steps = json.loads(made)["data"]["plan"]["steps"]
    number, step = next(
        (e["id"], e["operator"]) for e in steps if e["operator"].startswith("us_measure")
    )
    asked = ("bulkhead/one_point", "--exception", "implausible_value", "--plan", str(plan))
    case = ("--hidden", "missing_couplant", "--recover")
    assert data(*asked, "--step", str(number), *case) == data(*asked, "--step", step, *case)
    refused = run(*asked, "--step", "99")
    assert refused.exit_code == 2
    assert f"its steps are 1 to {len(steps)}" in refused.output


def test_what_is_lost_is_told_in_words_where_no_step_is_named() -> None:
    told = run("halves", "--exception", "drive_fails", "--hidden", "drive_defective").output
    assert "lost: the Arm of the step that failed" in " ".join(told.split())
