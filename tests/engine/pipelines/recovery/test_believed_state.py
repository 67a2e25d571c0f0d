"""Recovery begins in the state in which causes, tests and repairs have left the cell; each case
as a user types it.
"""

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app
from cellwright.engine.formats.report.runs.recovery_report import given_up_lines
from cellwright.engine.pipelines.planning.goal_selection import NOT_BEGUN

MEASURE = "us_measure(us_probe, t3_746, m2)"
PICK = "pick(probe_1, slot(drawer, 1))"


def run(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, arguments)
    return result.exit_code, result.stdout


@pytest.fixture(scope="module")
def plans(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """A file with a plan for each of some problems."""
    folder, files = tmp_path_factory.mktemp("plans"), {}
    for name in ("bulkhead/one_point", "bulkhead/both_tools", "themse/one"):
        file = folder / f"{name.replace('/', '_')}.json"
        file.write_text(run("plan", name, "--format", "json")[1])
        files[name] = str(file)
    return files


def diagnosed(
    plans: dict[str, str], problem: str, exception: str, step: str, *more: str
) -> dict[str, Any]:
    case = ["diagnose", problem, "--exception", exception, "--step", step, "--plan", plans[problem]]
    code, out = run(*case, "--recover", "--format", "json", *more)
    assert code == 0, out
    found: dict[str, Any] = json.loads(out)["data"]
    return found


def planned(found: dict[str, Any]) -> list[str]:
    return [step["operator"] for step in found["recovery"]["plan"]["steps"]]


@pytest.mark.slow
def test_what_prepared_tests_and_repairs_is_printed_and_undone(plans: dict[str, str]) -> None:
    more = ("--hidden", "part_moved", "--objective", "repair")
    found = diagnosed(plans, "bulkhead/one_point", "implausible_value", MEASURE, *more)
    steps = [step for each in found["observations"] for step in each["steps"]]
    assert "pick_up(t3_746, slra)" in steps
    assert planned(found)[0] == "put_down(t3_746, slra)"
    # nobody knows where on the part the couplant was
    assert "apply_couplant(t3_746, m2)" in planned(found)
    assert planned(found)[-1] == MEASURE


def test_a_probe_picked_up_from_the_floor_is_in_the_gripper(plans: dict[str, str]) -> None:
    more = ("--hidden", "probe_slipped", "--objective", "repair")
    found = diagnosed(plans, "themse/one", "grip_failed", PICK, *more)
    assert "at(probe_1, slot(drawer, 1))" in found["withdrawn"]
    assert planned(found)[0] == "put(probe_1, slot(furnace, 1))"


def test_only_what_held_is_restored(plans: dict[str, str]) -> None:
    more = ("--hidden", "arm_offset", "--objective", "repair")
    found = diagnosed(plans, "themse/one", "grip_failed", PICK, *more)
    assert [atom for atom in found["restored"] if atom.startswith("at(probe_1")] == [
        f"at({PICK[5:]}"
    ]


def test_nothing_is_tried_again_that_nobody_has_put_right(plans: dict[str, str]) -> None:
    more = ("--hidden", "brake_stuck", "--objective", "repair")
    step = "move(t3_746, meas(m1), meas(m2))"
    found = diagnosed(plans, "bulkhead/one_point", "move_timeout", step, *more)
    assert found["recovery"]["status"] == "infeasible"
    (why,) = found["recovery"]["given_up"].values()
    assert "t3_746 is lost" in why
    assert "nobody has put it right" in why


def test_a_sure_repair_comes_first(plans: dict[str, str]) -> None:
    found = diagnosed(plans, "themse/one", "grip_failed", PICK, "--hidden", "arm_offset")
    assert found["recovery"]["repair"] == {"name": "reference_arm", "steps": []}
    assert planned(found)[0] == PICK


def test_a_broken_tool_is_put_away_for_the_goals_that_are_left(plans: dict[str, str]) -> None:
    code, out = run(
        "revise", plans["bulkhead/both_tools"], "--lost", "us_probe", "--format", "json"
    )
    assert code == 0
    data = json.loads(out)["data"]
    steps = [step["operator"] for step in data["plan"]["steps"]]
    assert "put_down(t3_746, us_probe)" in steps
    assert steps[-1].startswith("laser_measure(slra")
    assert data["revision"]["given_up"] == {
        "measured(us_probe, t3_746, meas(m2))": "us_probe is lost"
    }


@pytest.mark.parametrize(
    ("option", "value", "said"),
    [
        ("--holds", "at(t3_746, m1)", "K103"),
        ("--gone", "hand_empty(us_probe)", "K103"),
        ("--holds", "holding(t3_746, us_probe), holding(t3_746, slra)", "K301"),
        ("--holds", "holding(t3_746, us_probe), hand_empty(t3_746)", "K301"),
        ("--done", "3", "K411"),
        ("--lost", "us_prode", "K101"),
    ],
)
def test_observations_that_cannot_be_are_refused(
    plans: dict[str, str], option: str, value: str, said: str
) -> None:
    file = plans["bulkhead/both_tools"]
    code, out = run("revise", file, option, value, "--format", "json")
    assert code == 2
    assert json.loads(out)["diagnostics"][0]["code"] == said
    if option in ("--holds", "--gone"):
        case = [
            "diagnose",
            "bulkhead/both_tools",
            "--exception",
            "no_echo",
            "--step",
            MEASURE,
            "--plan",
            file,
        ]
        code, out = run(*case, "--hidden", "broken_probe", option, value, "--format", "json")
        assert code == 2
        assert json.loads(out)["diagnostics"][0]["code"] == said


def test_what_follows_from_an_observation_is_said(plans: dict[str, str]) -> None:
    given = ("--done", "1..2", "--holds", "hand_empty(t3_746)", "--format", "json")
    data = json.loads(run("revise", plans["bulkhead/both_tools"], *given)[1])["data"]
    assert data["revision"]["follows"] == {"holding(t3_746, us_probe)": False}


def test_work_done_before_a_cause_was_noticed_is_open_again(plans: dict[str, str]) -> None:
    file = json.loads(Path(plans["bulkhead/both_tools"]).read_text())
    order = [step["operator"] for step in file["data"]["plan"]["steps"]]
    last = [step for step in order if step.startswith(("us_measure", "laser_measure"))][-1]
    exception = "implausible_value" if last.startswith("us") else "laser_implausible"
    more = ("--hidden", "part_moved", "--objective", "repair")
    found = diagnosed(plans, "bulkhead/both_tools", exception, last, *more)
    earlier = next(step for step in order if step.startswith(("us_measure", "laser_measure")))
    assert any(atom.startswith("measured(") for atom in found["withdrawn"])
    assert earlier in planned(found)


def test_what_a_repair_has_made_as_it_was_is_not_told(plans: dict[str, str]) -> None:
    more = ("--hidden", "tool_missing", "--objective", "repair")
    found = diagnosed(plans, "bulkhead/both_tools", "tool_not_held", "pick_up(t3_746, slra)", *more)
    assert found["cured"] == "set_rack_right"
    assert not [
        atom for atom in (*found["asserted"], *found["withdrawn"]) if atom.startswith("location")
    ]


def test_what_failed_at_one_place_prepares_a_repair_at_another(plans: dict[str, str]) -> None:
    """Straightening needs an empty hand: the lid in it cannot be put on the stand, but on the
    rim.
    """
    more = ("--hidden", "probe_tilted", "--objective", "repair", "--seed", "5")
    case = ["diagnose", "themse/one", "--exception", "put_blocked", "--step", "put(lid, stand)"]
    code, out = run(*case, "--plan", plans["themse/one"], "--recover", *more)
    assert code == 0
    assert "straighten_probe: put(lid, rim)" in out
    assert "cured by straighten_probe" in out
    assert "given up" not in out


def test_a_jammed_lid_gives_up_what_needs_the_lid_and_nothing_is_begun_in_vain() -> None:
    """The probe is not heated if it can no longer be cooled; the lid may be put elsewhere."""
    case = ["diagnose", "themse/one", "--exception", "put_blocked", "--step", "put(lid, rim)"]
    code, out = run(
        *case, "--hidden", "lid_jammed", "--objective", "isolate", "--recover", "--format", "json"
    )
    found = json.loads(out)["data"]
    assert list(found["blocked"]) == ["put(lid, rim)"]
    assert found["recovery"]["status"] == "infeasible"
    given_up = found["recovery"]["given_up"]
    assert given_up["heated(probe_1, 900) of 1:probe_1"] == NOT_BEGUN
    assert given_up["cooled(probe_1, 300) of 1:probe_1"].startswith("lid_jammed is there still")
    assert code == 0


def test_a_probe_is_looked_for_before_it_is_given_up(plans: dict[str, str]) -> None:
    more = ("--hidden", "probe_slipped", "--objective", "repair")
    found = diagnosed(plans, "themse/one", "grip_failed", PICK, *more)
    assert "do_without_probe" not in [each["action"] for each in found["observations"]]


def test_a_step_that_the_plan_does_not_have_is_named(plans: dict[str, str]) -> None:
    step = "us_measure(us_probe, t3_746, m1)"
    case = ["diagnose", "bulkhead/one_point", "--exception", "implausible_value", "--step", step]
    result = CliRunner().invoke(
        app, [*case, "--plan", plans["bulkhead/one_point"], "--hidden", "part_moved"]
    )
    assert f"the plan has no step {step}" in result.stderr
    assert f"did you mean '{MEASURE}'?" in result.stderr


def test_a_reason_is_told_once_for_all_its_goals() -> None:
    told = given_up_lines([("a", "it is lost"), ("b", "it comes after a"), ("c", "it is lost")])
    assert told == ["given up: a, c: it is lost", "given up: b: it comes after a"]
