"""`cellwright motion plan`: paths between named ends, and what is said where there is none."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app

run = CliRunner().invoke


def planned(*words: str) -> tuple[int, dict[str, object]]:
    result = run(app, ["motion", "plan", *words, "--format", "json"])
    return result.exit_code, json.loads(result.stdout)


def test_a_path_from_home_to_a_place_is_proved_and_timed() -> None:
    code, said = planned("bulkhead/one_point", "--from", "home", "--to", "meas(m2)")
    assert (code, said["status"]) == (0, "found")
    data = said["data"]
    assert data["proved"]
    assert len(data["path"]) == len(data["times_s"])
    assert data["times_s"] == sorted(data["times_s"])


def test_a_plan_moves_in_every_step_and_every_path_is_proved() -> None:
    result = run(app, ["plan", "bulkhead/one_point", "--motion"])
    assert result.exit_code == 0
    assert "3 paths of 3 steps, all proved to touch nothing that they may not" in result.stdout


def test_the_same_seed_writes_the_same_bytes() -> None:
    words = ["motion", "plan", "bulkhead", "--from", "home", "--to", "meas(m2)", "--format", "json"]
    assert run(app, words).stdout == run(app, words).stdout


def test_a_point_and_joint_values_are_ends_too() -> None:
    code, said = planned("bulkhead", "--from", "0, 90, 0, 0, 10, 0", "--to", "point 1.2, 0.3, 1.5")
    assert (code, said["status"]) == (0, "found")


def test_a_goal_beyond_a_limit_is_told_with_joint_and_limits() -> None:
    result = run(app, ["motion", "plan", "bulkhead", "--from", "home", "--to", "0, 10, 0, 0, 0, 0"])
    assert result.exit_code == 10
    assert "goal 1: joint_2 is at 10, 20 degrees beyond its limits, 30 and 117" in result.stdout


@pytest.mark.parametrize(
    ("goal", "code"),
    [("meas(m99)", "K101"), ("point 9, 9, 9", "K705"), ("point 1, x", "K406"), ("1, 2", "K707")],
)
def test_what_is_no_end_is_refused(goal: str, code: str) -> None:
    exit_code, said = planned("bulkhead", "--from", "home", "--to", goal)
    assert exit_code == 2
    assert [each["code"] for each in said["diagnostics"]] == [code]


def test_a_picture_shows_each_joint_over_time(tmp_path: Path) -> None:
    words = ["motion", "plan", "bulkhead", "--from", "home", "--to", "meas(m2)", "--format", "svg"]
    drawn = run(app, words).stdout
    assert drawn.startswith("<svg")
    assert drawn.count("<polyline") == 2 * 6  # values and speeds
    file = tmp_path / "motion.svg"
    assert run(app, [*words, "-o", str(file)]).exit_code == 0
    assert file.read_text("utf-8") == drawn


def test_an_output_without_a_picture_is_refused() -> None:
    words = ["motion", "plan", "bulkhead", "--from", "home", "--to", "home", "-o", "x.svg"]
    assert run(app, words).exit_code == 2


def test_a_motion_in_a_cell_imports_no_solver_and_reads_no_domain() -> None:
    words = "motion plan bulkhead --from home --to home"
    code = f"import sys; sys.argv = ['cellwright', *{words.split()}]\n"
    code += "from cellwright.engine.faces.cli.typer_application import app\n"
    code += "try: app()\n"
    code += "except SystemExit: pass\n"
    code += (
        "print([name for name in ('clingo', 'cellwright.kb.loader.domain_file', 'numpy.ma', "
        "'networkx') if name in sys.modules])"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.splitlines()[-1] == "[]"


def test_a_scene_in_which_nothing_moves_has_no_animation() -> None:
    """Times of an animation must increase."""
    scenes = [
        json.loads(
            run(
                app,
                ["motion", "plan", "handey", "--from", "home", "--to", goal, "--format", "gltf"],
            ).stdout
        )
        for goal in ("home", "0, -80, 90, -90, -90, 0")
    ]
    assert ["animations" in each for each in scenes] == [False, True]
