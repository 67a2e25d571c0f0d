"""A domain whose operators are generated from its contact model serves every command that reads
a plan.
"""

import json
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app

SATELLITE = Path(__file__).parents[3] / "domains" / "satellite"
GOALS = "contact(module_latch(module_1), bus_bay(bus, bay_1))"


@pytest.fixture(scope="module")
def plan_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = CliRunner().invoke(app, ["plan", str(SATELLITE), "--goals", GOALS, "--format", "json"])
    assert made.exit_code == 0, made.output
    file = tmp_path_factory.mktemp("plans") / "satellite.json"
    file.write_text(made.stdout, encoding="utf-8")
    return file


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["validate"], "valid: 6 steps"),
        (["schedule"], "snap_in_module_bus(module_1, bay_1)"),
        (["revise", "--done", "1"], "5 steps kept, 0 dropped"),
    ],
)
def test_a_plan_is_read_back(plan_file: Path, words: list[str], said: str) -> None:
    answer = CliRunner().invoke(app, [words[0], str(plan_file), *words[1:]])
    assert answer.exit_code == 0, answer.output
    assert said in answer.stdout


def test_a_step_is_explained(plan_file: Path) -> None:
    operators = [
        step["operator"] for step in json.loads(plan_file.read_text())["data"]["plan"]["steps"]
    ]
    answer = CliRunner().invoke(app, ["explain", str(plan_file), "2"])
    assert answer.exit_code == 0, answer.output
    assert operators[1].split("(")[0] in answer.stdout


@pytest.fixture
def problem_file(tmp_path: Path) -> Path:
    """A problem of a copy of the domain, with a cell beside it."""
    folder = Path(shutil.copytree(SATELLITE, tmp_path / "satellite"))
    (folder / "cell.yaml").write_text("cell: satellite\n")
    (folder / "problems").mkdir()
    file = folder / "problems" / "one.yaml"
    file.write_text(f"problem: one\ndomain: satellite\ngoals: ['{GOALS}']\n")
    return file


def test_a_problem_stands_for_its_domain_where_pictures_and_states_are_asked_for(
    problem_file: Path,
) -> None:
    for words in (["cell", "show"], ["states"]):
        answer = CliRunner().invoke(app, [*words, str(problem_file)])
        assert answer.exit_code == 0, answer.output


def test_the_table_of_states_counts_without_a_wrong_plural() -> None:
    table = CliRunner().invoke(app, ["states", str(SATELLITE)]).stdout
    assert "module (up to 2)" in " ".join(table.split())
