"""A third cell, written only in YAML and ASP: it checks, plans, validates and recovers without
a line of Python of its own.
"""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cellwright.engine.authoring import domain_check
from cellwright.engine.faces.cli import app
from cellwright.engine.model.outcome import Found
from cellwright.engine.model.run_protocol import RecordKind
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.pipelines.simulators import Injection
from cellwright.kb.loader import load
from cellwright.kb.loader.fault_base import load_faults
from tests.engine.pipelines.execution.executed_cells import executed

CELL = Path(__file__).parents[1] / "domains" / "capping"
PROBLEMS = sorted(path.stem for path in (CELL / "problems").glob("*.yaml"))
TWO, THREE = (str(CELL / "problems" / f"{name}.yaml") for name in ("two", "three"))
FEW_AND_MORE = [
    pytest.param(TWO, 2, id="two"),
    pytest.param(THREE, 3, id="three", marks=pytest.mark.slow),
]
MODEL, _ = load_faults(CELL / "domain.yaml")
CASES = [(name, cause) for name, each in MODEL.exceptions.items() for cause in each.counts]
STEPS = {
    "no_bottle": "pick(b1, in_1)",
    "put_refused": "put(b1, filler)",
    "underfilled": "fill(b1, 250)",
    "cap_loose": "cap(b1)",
    "scales_silent": "weigh(b1)",
}


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file with a plan for three bottles, made by the command that people type."""
    file = tmp_path_factory.mktemp("plans") / "plan.json"
    file.write_text(
        CliRunner().invoke(app, ["plan", THREE, "--objective", "cost", "--format", "json"]).stdout,
        "utf-8",
    )
    return file


def test_it_has_no_findings() -> None:
    assert domain_check.check_domain_files(str(CELL)).diagnostics == ()


@pytest.mark.parametrize("name", PROBLEMS)
def test_its_problems_have_plans(name: str) -> None:
    problem = load(CELL / "problems" / f"{name}.yaml").problem
    assert problem is not None
    found = checked_plan.plan_problem(problem)
    assert isinstance(found, Found)
    assert checked_plan.check_plan(problem, found.plan) == []


def test_it_understands_commands() -> None:
    command = "fill b1 and b2, cap them, weigh them and pack them"
    answer = CliRunner().invoke(app, ["plan", THREE, "--command", command, "--objective", "cost"])
    assert answer.exit_code == 0, answer.output


@pytest.mark.parametrize(("exception", "cause"), CASES)
def test_every_cause_is_found_and_recovered_from(exception: str, cause: str, plan: Path) -> None:
    line = [
        "diagnose",
        THREE,
        "--exception",
        exception,
        "--step",
        STEPS[exception],
        "--hidden",
        cause,
    ]
    answer = CliRunner().invoke(app, [*line, "--recover", "--plan", str(plan), "--format", "json"])
    assert answer.exit_code == 0, answer.output
    assert json.loads(answer.stdout)["data"]


@pytest.mark.slow
@pytest.mark.parametrize(("target", "bottles"), FEW_AND_MORE)
def test_it_runs_to_the_end_and_what_it_measures_is_in_the_journal(
    target: str, bottles: int
) -> None:
    ending, records, _ = executed(target)
    assert ending.outcome == "reached"
    assert ending.makespan_ms == ending.forecast_ms
    replies = [each.content["text"] for each in records if each.kind is RecordKind.REPLY]
    assert sum(each.startswith("torque(") for each in replies) == bottles
    assert sum(each.startswith("mass(") for each in replies) == bottles
    results = [each.content for each in records if each.kind is RecordKind.RESULT]
    assert [each["quantity"] for each in results].count("excess") == bottles
    assert all(
        each["passed"] is (each["lower"] <= each["value"] <= each["upper"]) for each in results
    )


@pytest.mark.parametrize(
    "target", [TWO, pytest.param(THREE, marks=pytest.mark.slow)], ids=["two", "three"]
)
@pytest.mark.parametrize(("exception", "cause"), CASES)
def test_a_run_with_any_cause_recovers_or_gives_up_what_is_lost(
    exception: str, cause: str, target: str
) -> None:
    step = STEPS[exception]
    ending, records, _ = executed(target, [Injection(step, cause, exception=exception)])
    told = [each.content["exception"] for each in records if each.kind is RecordKind.EXCEPTION]
    assert exception in told
    lost = cause == "bottle_fallen" or MODEL.causes[cause].stops
    assert ending.outcome in (("partly", "stopped") if lost else ("reached",))
    assert all("b1" in goal for goal in ending.open_goals) or MODEL.causes[cause].stops
