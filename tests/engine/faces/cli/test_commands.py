import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from cellwright.engine.authoring.starter import create_domain
from cellwright.engine.faces.cli import app

run = CliRunner().invoke


def answer(*arguments: str) -> tuple[int, dict[str, Any]]:
    """The exit code and the envelope of a command asked for JSON."""
    result = run(app, [*arguments, "--format", "json"])
    envelope = json.loads(result.stdout)
    assert list(envelope) == ["version", "status", "data", "diagnostics"]
    return result.exit_code, envelope


def test_a_plan_passes_through_a_file_to_the_checker(tmp_path: Path) -> None:
    code, envelope = answer("plan", "bulkhead/one_point")
    assert (code, envelope["status"]) == (0, "optimal")
    file = tmp_path / "plan.json"
    file.write_text(json.dumps(envelope))
    assert answer("validate", str(file)) == (
        0,
        {
            "version": 1,
            "status": "valid",
            "data": {"steps": 5, "cost": 5, "links": 8},
            "diagnostics": [],
        },
    )


def test_a_plan_without_a_needed_step_is_refused(tmp_path: Path) -> None:
    _, envelope = answer("plan", "bulkhead/one_point")
    plan = envelope["data"]["plan"]
    plan["steps"] = [step for step in plan["steps"] if "apply_couplant" not in step["operator"]]
    plan["steps"][2]["after"] = [2]
    plan["links"] = []
    file = tmp_path / "plan.json"
    file.write_text(json.dumps(envelope))
    code, refused = answer("validate", str(file))
    assert (code, refused["status"]) == (1, "invalid")
    assert "couplant_applied(goal_point(meas(m2)))" in refused["diagnostics"][0]["message"]


def test_infeasible_exits_with_10() -> None:
    code, envelope = answer("plan", "bulkhead/tool_missing")
    assert (code, envelope["status"]) == (10, "infeasible")
    assert envelope["data"]["reason"]


def test_too_little_work_exits_with_12() -> None:
    code, envelope = answer("plan", "bulkhead/twelve_points", "--expansions", "1")
    assert (code, envelope["status"]) == (12, "gave up")


def test_no_time_exits_with_23() -> None:
    code, envelope = answer("plan", "bulkhead/twelve_points", "--time-limit", "0")
    assert (code, envelope["status"]) == (23, "stopped")


@pytest.mark.parametrize("command", ["plan", "check", "test"])
def test_a_target_that_does_not_exist_is_bad_input(command: str) -> None:
    code, envelope = answer(command, "bulkhaed/one_point")
    assert (code, envelope["status"]) == (2, "bad input")
    assert envelope["diagnostics"][0]["code"] == "K401"


def test_a_broken_file_is_reported_on_standard_error_with_its_place(tmp_path: Path) -> None:
    create_domain(tmp_path / "cell")
    domain = tmp_path / "cell" / "domain.yaml"
    domain.write_text(domain.read_text().replace("position(Bin, open)", "positoin(Bin, open)"))
    result = run(app, ["check", str(tmp_path / "cell")])
    assert result.exit_code == 2
    assert "K101: unknown predicate 'positoin'" in result.stderr
    assert "did you mean 'position'?" in result.stderr
    assert "1 error in 2 files" in result.stdout


def test_the_same_input_gives_the_same_bytes() -> None:
    first, second = (
        run(app, ["plan", "bulkhead/both_tools", "--format", "json"]).stdout_bytes for _ in range(2)
    )
    assert first == second


def test_internal_errors_exit_with_70_and_no_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise RuntimeError("a bug")

    monkeypatch.setattr("cellwright.engine.pipelines.planning.target_files.problem_of", broken)
    result = run(app, ["plan", "bulkhead/one_point"])
    assert result.exit_code == 70, result.output
    assert "internal error: RuntimeError: a bug" in result.stderr
    assert "Traceback" not in result.stderr


def test_a_place_where_nothing_can_be_written_is_bad_input(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    code, envelope = answer("init", str(tmp_path / "file" / "cell"))
    assert (code, envelope["status"]) == (2, "bad input")
    assert "the operating system reports: Not a directory" in envelope["diagnostics"][0]["message"]


def test_a_reader_that_goes_away_is_no_error() -> None:
    command = f"{sys.executable} -m cellwright.engine.faces.cli schema domain | head -1"
    result = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)
    assert (result.stdout, result.stderr) == ("{\n", "")


def test_help_names_every_command_and_loads_nothing_heavy() -> None:
    code = (
        "import sys; from cellwright.engine.faces.cli import app; heavy = {'clingo', 'ortools', "
        "'pydantic', 'networkx', 'numpy'}"
    )
    code += "; print(sorted(heavy & set(sys.modules)))"
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert result.stdout == "[]\n"
    said = run(app, ["--help"]).stdout
    assert all(verb in said for verb in ("check", "init", "plan", "schema", "test", "validate"))


def test_a_command_in_words_is_planned_and_checked(tmp_path: Path) -> None:
    sentence = (
        "process probe 1 in the furnace for 15 min, cool it down in the freezer for 5 min and "
        "store it again"
    )
    code, envelope = answer("plan", "themse", "--command", sentence)
    assert (code, envelope["status"]) == (0, "optimal")
    assert envelope["data"]["plan"]["problem"]["workflow"]
    file = tmp_path / "plan.json"
    file.write_text(json.dumps(envelope))
    assert answer("validate", str(file))[0] == 0


def test_words_that_are_not_understood_are_pointed_at() -> None:
    result = run(app, ["plan", "themse", "--command", "process probe 1 in the oven for 15 min"])
    assert result.exit_code == 2
    assert "'oven' is not understood here" in result.stderr
