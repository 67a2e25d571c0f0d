"""Objects that are alike come in the order in which the user names them, and nothing else about
the plan changes.
"""

import dataclasses
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app
from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.pipelines.planning.object_order import canonical_object_order
from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.pipelines.planning.plan_objective import plan_for_objective
from cellwright.kb.model.plan_model import Plan
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Number

HEAT = "process {} in the furnace for 15 min"


def found(problem: Problem) -> Plan:
    """The plan of a problem that has one."""
    outcome = plan_for_objective(problem).outcome
    assert isinstance(outcome, Found)
    return outcome.plan


def heated(made: Plan) -> list[str]:
    """The probes in the order in which they are heated."""
    return [str(s.operator.arguments[0]) for s in made.steps if s.operator.name == "heat"]


@pytest.mark.parametrize(
    "said", [("probe_1", "probe_2"), ("probe_2", "probe_1"), ("probe_4", "probe_1")]
)
def test_probes_are_heated_in_the_order_in_which_they_are_said(said: tuple[str, str]) -> None:
    made = found(problem_of("themse", "", HEAT.format(" and ".join(said))))
    assert heated(made) == list(said)
    assert made.cost == 13


@pytest.mark.parametrize("said", [("probe 1", "probe 2"), ("probe 2", "probe 1")])
def test_probes_that_are_heated_for_different_times_come_in_the_order_in_which_they_are_said(
    said: tuple[str, str],
) -> None:
    made = found(problem_of("themse", "", f"heat {said[0]} for 5 min and {said[1]} for 10 min"))
    assert heated(made) == [each.replace(" ", "_") for each in said]
    assert [step.duration for step in made.steps if step.operator.name == "heat"] == [300, 600]


@pytest.mark.parametrize(
    "sentence",
    [
        "store probe 2 and heat probe 1 for 5 min and cool it for 3 min",
        "heat probe 2 for 5 min and probe 1 for 5 min and cool probe 1 for 3 min",
    ],
)
def test_what_differs_in_its_goals_keeps_its_turn(sentence: str) -> None:
    problem = problem_of("themse", "", sentence)
    tried: list[Plan] = []
    canonical_object_order(
        PlanGate().semantics(problem), found(problem), lambda plan: bool(tried.append(plan))
    )
    assert tried == []


def test_numbers_that_a_problem_gives_to_an_object_tell_it_from_others() -> None:
    """Which of two tubes is heavier is no matter of names."""
    problem = problem_of("centrifuge/four")
    chains = {each.subject: each for each in problem.chains}
    one, _, three, _ = chains
    pair = dataclasses.replace(problem, chains=(chains[three], chains[one]))
    tried: list[Plan] = []
    made = found(problem)
    canonical_object_order(
        PlanGate().semantics(pair), made, lambda other: bool(tried.append(other))
    )
    assert [fact.arguments[1] for fact in problem.statics if fact.name == "weight"][::2] == [
        Number(12),
        Number(14),
    ]
    assert tried == []


def test_a_plan_in_another_order_that_the_checker_refuses_is_left() -> None:
    problem = problem_of("themse", "", HEAT.format("probe 2 and probe 1"))
    other = problem_of("themse", "", HEAT.format("probe 1 and probe 2"))
    made, asked = found(problem), list[Plan]()
    kept = canonical_object_order(
        PlanGate().semantics(other), made, lambda each: bool(asked.append(each))
    )
    assert kept == made
    assert [heated(each) for each in asked] == [["probe_1", "probe_2"]]
    assert PlanGate().findings(other, asked[0]) == []


def test_the_stages_of_a_plan_change_places_with_their_objects(tmp_path: Path) -> None:
    """Each link for a stage is about the object that its step handles: `validate` looks at the
    links of a plan that was kept.
    """
    file = tmp_path / "plan.json"
    assert CliRunner().invoke(app, ["plan", "centrifuge/four", "-o", str(file)]).exit_code == 0
    checked = CliRunner().invoke(app, ["validate", str(file)])
    assert checked.exit_code == 0, checked.output
