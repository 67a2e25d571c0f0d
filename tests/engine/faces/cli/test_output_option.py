"""`--output` of plan, schedule and sequence: the answer in a file, its text in the terminal."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app

run = CliRunner().invoke
ASKED = [
    ("plan", "bulkhead/one_point", ".json"),
    ("plan", "bulkhead/one_point", ".svg"),
    ("plan", "bulkhead/one_point", ".dot"),
    ("schedule", "bulkhead/one_point", ".json"),
    ("schedule", "bulkhead/one_point", ".svg"),
    ("sequence", "bulkhead/twelve_points", ".json"),
    ("sequence", "bulkhead/twelve_points", ".svg"),
]


@pytest.mark.parametrize(("verb", "target", "ending"), ASKED)
def test_the_file_has_what_the_format_prints_and_the_terminal_the_text(
    tmp_path: Path, verb: str, target: str, ending: str
) -> None:
    file = tmp_path / f"answer{ending}"
    both = run(app, [verb, target, "-o", str(file)])
    printed = run(app, [verb, target, "--format", ending[1:]])
    assert (both.exit_code, printed.exit_code) == (0, 0)
    assert file.read_text("utf-8") == printed.stdout
    assert both.stdout == run(app, [verb, target]).stdout + f"\nWritten to {file}.\n"
    assert [each.name for each in tmp_path.iterdir()] == [file.name]


def test_a_format_wins_over_the_ending(tmp_path: Path) -> None:
    file = tmp_path / "plan.txt"
    assert (
        run(app, ["plan", "bulkhead/one_point", "-o", str(file), "--format", "json"]).exit_code == 0
    )
    assert json.loads(file.read_text("utf-8"))["status"] == "optimal"


@pytest.mark.parametrize("more", [["-o", "plan.txt"], ["-o", "plan.json", "--format", "text"]])
def test_a_file_without_a_form_is_refused(more: list[str]) -> None:
    result = run(app, ["plan", "bulkhead/one_point", *more])
    assert result.exit_code == 2
    assert "--output" in result.output


def test_where_there_is_no_plan_the_old_file_stays(tmp_path: Path) -> None:
    file = tmp_path / "plan.json"
    file.write_text("old")
    assert run(
        app, ["plan", "bulkhead/one_point", "--expansions", "0", "--order", "free", "-o", str(file)]
    ).exit_code
    assert file.read_text() == "old"


def test_a_file_that_cannot_be_written_does_not_take_the_answer_with_it(tmp_path: Path) -> None:
    result = run(app, ["plan", "bulkhead/one_point", "-o", str(tmp_path / "nowhere" / "plan.json")])
    assert result.exit_code == 2
    assert "us_measure" in result.stdout
    assert "cannot write" in result.stderr


def test_a_link_stays_a_link(tmp_path: Path) -> None:
    file, link = tmp_path / "real.json", tmp_path / "plan.json"
    file.write_text("old")
    link.symlink_to(file)
    assert run(app, ["plan", "bulkhead/one_point", "-o", str(link)]).exit_code == 0
    assert link.is_symlink()
    assert json.loads(file.read_text("utf-8"))


def test_a_plan_file_of_a_pddl_task_says_how_to_check_it(tmp_path: Path) -> None:
    domain, task, file = (tmp_path / name for name in ("domain.pddl", "task.pddl", "plan.json"))
    domain.write_text(
        "(define (domain d) (:predicates (p)) (:action a :parameters () :effect (p)))", "utf-8"
    )
    task.write_text("(define (problem t) (:domain d) (:init) (:goal (p)))", "utf-8")
    assert run(app, ["plan", "--pddl", str(domain), str(task), "-o", str(file)]).exit_code == 0
    result = run(app, ["validate", str(file)])
    assert (result.exit_code, "PDDL: here a domain in YAML is wanted" in result.output) == (2, True)
    assert "validate --pddl DOMAIN PROBLEM PLAN" in " ".join(result.output.split())
