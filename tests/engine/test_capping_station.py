"""A third cell, written only in YAML and ASP: it checks, plans, validates and recovers without a line of Python of its own."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from engine.faces.cli import app
from engine.model.outcome import Found
from engine.pipelines import checking, planning
from kb.loader import load
from kb.loader.faults import load_faults

CELL = Path(__file__).parents[1] / "domains" / "capping"
PROBLEMS = sorted(path.stem for path in (CELL / "problems").glob("*.yaml"))
MODEL, _ = load_faults(CELL / "domain.yaml")
CASES = [(name, cause) for name, each in MODEL.exceptions.items() for cause in each.counts]
STEPS = {
    "no_bottle": "pick(b1, in_1)",
    "put_refused": "put(b1, filler)",
    "underfilled": "fill(b1, 250)",
    "cap_loose": "cap(b1)",
    "scales_silent": "weigh(b1)",
}


def test_it_has_no_findings() -> None:
    assert checking.check(str(CELL)).diagnostics == ()


@pytest.mark.parametrize("name", PROBLEMS)
def test_its_problems_have_plans(name: str) -> None:
    problem = load(CELL / "problems" / f"{name}.yaml").problem
    assert problem is not None
    found = planning.plan(problem)
    assert isinstance(found, Found)
    assert planning.check_plan(problem, found.plan) == []


def test_it_understands_commands() -> None:
    command = "fill b1 and b2, cap them, weigh them and pack them"
    target = str(CELL / "problems" / "three.yaml")
    answer = CliRunner().invoke(app, ["plan", target, "--command", command, "--format", "json"])
    assert answer.exit_code == 0, answer.output


@pytest.mark.parametrize(("exception", "cause"), CASES)
def test_every_cause_is_found_and_recovered_from(exception: str, cause: str, tmp_path: Path) -> None:
    target = str(CELL / "problems" / "three.yaml")
    plan = tmp_path / "plan.json"
    plan.write_text(CliRunner().invoke(app, ["plan", target, "--format", "json"]).stdout, "utf-8")
    line = ["diagnose", target, "--exception", exception, "--step", STEPS[exception], "--hidden", cause]
    answer = CliRunner().invoke(app, [*line, "--recover", "--plan", str(plan), "--format", "json"])
    assert answer.exit_code == 0, answer.output
    assert json.loads(answer.stdout)["data"]
