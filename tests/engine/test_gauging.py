"""The gauging cell: the probe is calibrated before it is due, by count and by use, and couplant
is refilled before it runs out.
"""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app
from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.planning.plan_objective import plan_for_objective
from cellwright.kb.loader import bundled_domains, load_problem
from cellwright.kb.loader.fault_base import load_faults
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Function, Number

LIMITS = {"values_since": 25, "seconds_since": 400}


def begun(problem: Problem, **levels: int) -> Problem:
    """The problem with other amounts at the start."""
    initial = (
        Function(
            atom.name,
            (*atom.arguments[:-1], Number(levels.get(atom.name, int(str(atom.arguments[-1]))))),
        )
        if atom.name in ("couplant", *LIMITS)
        else atom
        for atom in problem.initial
    )
    return replace(problem, initial=tuple(initial))


@pytest.mark.parametrize(
    ("levels", "calibrations", "refills"),
    [
        pytest.param({}, 2, 1, marks=pytest.mark.slow),  # the golden plan of the wall is the same
        pytest.param(
            {"couplant": 40, "values_since": 0, "seconds_since": 0}, 1, 0, marks=pytest.mark.slow
        ),
        pytest.param(
            {"couplant": 40, "values_since": 0, "seconds_since": 398}, 2, 0, marks=pytest.mark.slow
        ),
        ({"couplant": 0, "values_since": 25, "seconds_since": 100}, 2, 1),
    ],
)
def test_what_is_due_is_planned_before_the_measurements_that_need_it(
    levels: dict[str, int], calibrations: int, refills: int
) -> None:
    problem = begun(load_problem("gauging/wall"), **levels)
    found = plan_for_objective(problem).outcome
    assert isinstance(found, Found)
    amounts = {
        atom.name: int(str(atom.arguments[-1])) for atom in problem.initial if atom.name != "at"
    }
    done = [step.operator.name for step in found.plan.steps]
    for name in done:
        if name == "calibrate":
            amounts |= {"values_since": 0, "seconds_since": 0}
        elif name == "refill":
            amounts["couplant"] = 40
        elif name == "wet":
            amounts["couplant"] -= 1
        elif name == "gauge":
            amounts["values_since"] += 1
            amounts["seconds_since"] += 4
        assert amounts["couplant"] >= 0
        assert all(amounts[each] <= most for each, most in LIMITS.items())
    assert (done.count("gauge"), done.count("calibrate"), done.count("refill")) == (
        30,
        calibrations,
        refills,
    )


FAULTS = load_faults(bundled_domains()["gauging"] / "domain.yaml")[0]
CASES = [(name, cause) for name in FAULTS.exceptions for cause in FAULTS.priors(name)]


@pytest.mark.parametrize(("exception", "cause"), CASES)
def test_every_cause_of_a_failed_step_is_found(exception: str, cause: str) -> None:
    words = [
        "diagnose",
        "gauging",
        "--exception",
        exception,
        "--hidden",
        cause,
        "--objective",
        "isolate",
    ]
    result = CliRunner().invoke(app, [*words, "--format", "json"])
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)["data"]
    assert [[cause]] == [each["causes"] for each in found["hypotheses"]]


@pytest.mark.slow
@pytest.mark.parametrize(
    "fault",
    [
        "gauge(probe, robot, p3)=probe_worn",
        "gauge(probe, robot, p3)=no_couplant_film",
        "wet(robot, p3)=bottle_empty",
    ],
)
def test_a_run_goes_on_after_a_fault(tmp_path: Path, fault: str) -> None:
    words = ["run", "gauging/wall", "--fault", fault, "--store", str(tmp_path / "store")]
    result = CliRunner().invoke(app, words, env={"COLUMNS": "200", "XDG_STATE_HOME": str(tmp_path)})
    assert result.exit_code == 0, result.output
    assert "all goals are reached" in result.output
    assert "1 exception" in result.output
    assert fault.partition("=")[2] in result.output
