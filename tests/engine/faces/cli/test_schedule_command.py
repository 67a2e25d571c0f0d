"""`cellwright schedule`: what it prints, and its exit codes."""

import json
from pathlib import Path

import pytest
from click.testing import Result
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app
from tests.engine.formats.interop.test_shop_files import JSON, written


def run(*words: str) -> Result:
    return CliRunner().invoke(app, ["schedule", *words], env={"COLUMNS": "100"})


def test_a_problem_is_answered_with_a_chart() -> None:
    result = run("themse/two")
    assert result.exit_code == 0
    assert "probe_1" in result.stdout
    assert "makespan 2243 s, shortest for these steps" in result.stdout


def test_the_answer_in_data_is_a_plan_too(tmp_path: Path) -> None:
    result = run("themse/one", "--format", "json", "--stats")
    answer = json.loads(result.stdout)
    assert answer["status"] == "optimal"
    assert answer["data"]["schedule"]["makespan"] == 1305
    assert "first schedule" in answer["data"]["statistics"]["seconds"]
    file = tmp_path / "timetable.json"
    file.write_text(result.stdout)
    assert CliRunner().invoke(app, ["validate", str(file)]).exit_code == 0
    again = json.loads(run(str(file), "--format", "json").stdout)
    assert again["data"]["schedule"] == answer["data"]["schedule"]


@pytest.mark.parametrize(
    "target", ["bulkhead/one_point", pytest.param("themse/one", marks=pytest.mark.slow)]
)
def test_the_same_call_gives_the_same_bytes(target: str) -> None:
    one, other = (run(target, "--format", "json").stdout for _ in range(2))
    assert one == other


def test_words_are_scheduled_as_well() -> None:
    result = run(
        "themse", "--command", "heat probe 1 for 15 min and store it again", "--format", "json"
    )
    assert json.loads(result.stdout)["status"] == "optimal"


def test_protocols_and_job_shops_are_read(tmp_path: Path) -> None:
    shops = tmp_path / "shops.json"
    shops.write_text(JSON)
    assert "makespan 5, the shortest possible" in run(str(shops), "--instance", "small").stdout
    assert "makespan 11, the shortest possible" in run(str(written(tmp_path))).stdout


def test_a_picture_is_svg(tmp_path: Path) -> None:
    assert run(str(written(tmp_path)), "--format", "svg").stdout.startswith("<svg")


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["themse/unsolvable"], 10),
        (["themse/nothing"], 2),
        (["themse/one", "--expansions", "0"], 12),
    ],
)
def test_no_schedule_has_its_exit_code(words: list[str], code: int) -> None:
    assert run(*words).exit_code == code


def test_windows_that_cannot_be_kept_are_infeasible(tmp_path: Path) -> None:
    impossible = "Job\tA\tPoint\tB\tPoint\tTime\n1\t1\tstart\t2\tend\t3\n"
    assert run(str(written(tmp_path, tcmb=impossible))).exit_code == 10
