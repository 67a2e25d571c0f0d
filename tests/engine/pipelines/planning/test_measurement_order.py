"""Measurements that a command puts in order are made in this order, whatever else is done
between them, in recovery too.
"""

import itertools
import json
import random
from collections.abc import Iterable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app
from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.planning import checked_plan

TARGET = "bulkhead/twelve_points"
ACTS = ("put down the ultrasonic probe", "pick up the laser", "go to m6", "put down the laser")


def measured(steps: Iterable[str]) -> list[str]:
    """The measurements among some steps, in their order."""
    return [step.rstrip(")").split(", ")[2] for step in steps if "_measure(" in step]


def sentence(seed: int) -> tuple[str, list[str]]:
    """Three measurements with something else between two of them, and their order."""
    draw = random.Random(seed)
    points = [f"m{n}" for n in draw.sample(range(1, 13), 3)]
    said = [f"measure {each}" for each in points]
    said.insert(draw.randint(1, 2), draw.choice(ACTS))
    return ", then ".join(said), points


@pytest.mark.parametrize("seed", range(6))
def test_measurements_among_other_acts_keep_the_order_of_their_sentence(seed: int) -> None:
    command, points = sentence(seed)
    outcome = checked_plan.plan_problem(checked_plan.problem_of(TARGET, "", command))
    assert isinstance(outcome, Found)
    assert measured(str(each.operator) for each in outcome.plan.steps) == points
    assert all(one.id in other.after for one, other in itertools.pairwise(outcome.plan.steps))


@pytest.mark.slow
def test_what_is_measured_anew_in_a_recovery_is_measured_in_this_order_as_well(
    tmp_path: Path,
) -> None:
    made = tmp_path / "plan.json"
    invoke = CliRunner().invoke
    command = ("--command", "measure m9, then m1, then m2", "--format", "json")
    made.write_text(invoke(app, ["plan", TARGET, *command]).stdout)
    case = ("--exception", "implausible_value", "--step", "us_measure(us_probe, t3_746, m2)")
    how = ("--hidden", "part_moved", "--recover", "--objective", "repair", "--format", "json")
    answer = json.loads(
        invoke(app, ["diagnose", "bulkhead", "--plan", str(made), *case, *how]).stdout
    )
    steps = answer["data"]["recovery"]["plan"]["steps"]
    assert measured(each["operator"] for each in steps) == ["m9", "m1", "m2"]
