"""What ranges of quantities rule out: it is known without a search, and told."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwright.engine.model.ground_axioms import COMPARED_WITH_ZERO, COMPARISON_SIGNS, never_holds
from cellwright.engine.model.outcome import Infeasible
from cellwright.engine.pipelines.explanation import explain_infeasibility
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.stages.planning import SearchLimits
from cellwright.kb.loader import load_problem, with_goals
from cellwright.kb.model.planning_problem import Problem

DOMAIN = """
domain: doses
types: {tube: object}
quantities:
  level: 0..200
events:
  dosed(tube, int): {}
operators:
  dose(Tube, Amount):
    preconditions: level >= Amount
    adds: dosed(Tube, Amount)
    decrease: {level: Amount}
    resources: pipettor
  fill_up:
    preconditions: level < 200
    assign: {level: 200}
    resources: pipettor
"""
PROBLEM = """
problem: one
domain: doses
objects: {tube: [a, b]}
initial: [level(90)]
workflow:
  - for: {T: [a, b]}
    stages: dosed(T, AMOUNT)
"""
LITTLE = SearchLimits(expansions=200)


def problem_of(folder: Path, amount: int) -> Problem:
    (folder / "problems").mkdir()
    (folder / "domain.yaml").write_text(DOMAIN, "utf-8")
    (folder / "problems" / "one.yaml").write_text(PROBLEM.replace("AMOUNT", str(amount)), "utf-8")
    return load_problem(folder / "problems" / "one.yaml")


def test_more_than_a_quantity_can_be_is_infeasible_and_told_with_its_range(tmp_path: Path) -> None:
    problem = problem_of(tmp_path, 260)
    assert isinstance(checked_plan.plan_problem(problem, LITTLE), Infeasible)
    found = explain_infeasibility(problem, LITTLE)
    assert found.goals == ("dosed(a, 260) (workflow 1:a)",)
    assert found.exclusions == ("dose(a, 260) needs level >= 260, and level is within 0..200",)
    assert not found.untried


def test_as_much_as_a_quantity_can_be_has_a_plan(tmp_path: Path) -> None:
    assert explain_infeasibility(problem_of(tmp_path, 200), LITTLE).status == "feasible"


@pytest.mark.parametrize("goal", ["level > 200", "level < 0", "2 * level = 402"])
def test_a_goal_outside_of_the_range_is_told(tmp_path: Path, goal: str) -> None:
    problem = problem_of(tmp_path, 1)
    found = explain_infeasibility(with_goals(problem.domain, goal, problem), LITTLE)
    assert [each.endswith("cannot be: level is within 0..200") for each in found.exclusions] == [
        True
    ]


@given(st.sampled_from(COMPARISON_SIGNS), st.integers(-4, 4), st.integers(0, 5))
def test_a_relation_is_ruled_out_just_when_no_number_of_the_range_has_it(
    relation: str, low: int, more: int
) -> None:
    values = range(low, low + more + 1)
    assert never_holds(relation, low, low + more) == (
        not any(map(COMPARED_WITH_ZERO[relation], values))
    )
