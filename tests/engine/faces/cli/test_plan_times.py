"""The verbs `plan` and `validate` on PDDL tasks with times."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app
from tests.timed_examples import CELLAR, FUSES

FEW = ("--expansions", "2000")


@pytest.fixture
def files(tmp_path: Path) -> list[str]:
    (tmp_path / "domain.pddl").write_text(CELLAR, "utf-8")
    (tmp_path / "problem.pddl").write_text(FUSES, "utf-8")
    return [str(tmp_path / "domain.pddl"), str(tmp_path / "problem.pddl")]


@pytest.fixture
def plan(files: list[str], tmp_path: Path) -> Path:
    answer = CliRunner().invoke(app, ["plan", "--pddl", *files, "--format", "ipc", *FEW])
    assert answer.exit_code == 0
    path = tmp_path / "plan.txt"
    path.write_text(answer.stdout, "utf-8")
    return path


def test_a_plan_is_written_with_times_and_is_valid(files: list[str], plan: Path) -> None:
    assert "0.000: (strike m" in plan.read_text("utf-8")
    answer = CliRunner().invoke(app, ["validate", "--pddl", *files, str(plan)])
    assert (answer.exit_code, answer.stdout.split(":")[0]) == (0, "valid")


def test_a_broken_condition_is_told_with_its_amount(files: list[str], plan: Path) -> None:
    plan.write_text(plan.read_text("utf-8").replace("[2.000]", "[2.500]", 1), "utf-8")
    answer = CliRunner().invoke(app, ["validate", "--pddl", *files, str(plan)])
    assert answer.exit_code == 1
    assert "lasts 2.5, not = 2: 0.5 off" in answer.stderr


def test_a_plan_is_data_and_is_read_back(files: list[str], tmp_path: Path) -> None:
    answer = CliRunner().invoke(app, ["plan", "--pddl", *files, "--format", "json", *FEW])
    path = tmp_path / "plan.json"
    path.write_text(answer.stdout, "utf-8")
    result = json.loads(answer.stdout)["data"]
    assert {"makespan", "bound", "optimal", "steps"} <= set(result)
    assert CliRunner().invoke(app, ["validate", "--pddl", *files, str(path)]).exit_code == 0


def test_a_line_without_a_duration_is_told(files: list[str], plan: Path) -> None:
    plan.write_text("0.000: (strike m1)\n", "utf-8")
    answer = CliRunner().invoke(app, ["validate", "--pddl", *files, str(plan)])
    assert answer.exit_code == 2
    assert "strike lacks its duration" in answer.stderr


def test_options_that_change_nothing_are_refused(files: list[str]) -> None:
    answer = CliRunner().invoke(app, ["plan", "--pddl", *files, "--objective", "cost"])
    assert "--objective cost has no effect on a PDDL task with times" in " ".join(
        answer.stderr.split()
    )


@pytest.mark.parametrize("verb", ["schedule", "validate", "revise"])
def test_a_plan_with_times_is_refused_by_name_where_only_domains_have_plans(
    verb: str, files: list[str], tmp_path: Path
) -> None:
    answer = CliRunner().invoke(app, ["plan", "--pddl", *files, "--format", "json", *FEW])
    path = tmp_path / "plan.json"
    path.write_text(answer.stdout, "utf-8")
    told = CliRunner().invoke(app, [verb, str(path)])
    assert told.exit_code == 2
    assert "this is a plan of a PDDL task with times" in told.stderr
