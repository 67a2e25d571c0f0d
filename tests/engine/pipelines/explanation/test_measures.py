"""What explanations know of quantities: which values steps can bring about, and which steps
break a goal for good.
"""

from collections.abc import Callable
from pathlib import Path

import pytest

from cellwright.engine.pipelines.explanation import explain_infeasibility
from cellwright.engine.pipelines.explanation.candidate_edits import single_edits
from cellwright.engine.pipelines.explanation.possible_facts import ProblemSpace
from cellwright.engine.stages.grounding import ground
from cellwright.kb.loader import load, load_problem
from cellwright.kb.model.planning_problem import Problem
from tests.engine.pipelines.explanation.test_explain import without_one_fact

DOSING = """
domain: dosing
types: {well: object}
objects: {well: [w1, w2]}
quantities:
  level: 0..20
  tips: 0..3
  foils: 0..9
fluents:
  dosed(well): {}
  sealed(well): {}
operators:
  dose(W):
    preconditions: not dosed(W), tips >= 1
    adds: dosed(W)
    decrease: {level: 5, tips: 1}
  new_tips:
    preconditions: tips < 2
    assign: {tips: 3}
  seal(W):
    preconditions: dosed(W)
    adds: sealed(W)
    decrease: {foils: 1}
"""
Asked = Callable[[str], Problem]
START = "level(20), tips(3), foils(5)"


@pytest.fixture
def asked(tmp_path: Path) -> Asked:
    """The problem with some goals."""

    def made(goals: str) -> Problem:
        (tmp_path / "domain.yaml").write_text(DOSING)
        (tmp_path / "p.yaml").write_text(
            f'problem: p\ndomain: dosing\ninitial: ["{START}"]\ngoals: ["{goals}"]\n'
        )
        found = load(tmp_path / "p.yaml").problem
        assert found is not None
        return found

    return made


def changes(problem: Problem) -> list[str]:
    return [str(each) for each in explain_infeasibility(problem).changes if each.edits]


def space(problem: Problem) -> ProblemSpace:
    task = ground(problem)
    return ProblemSpace.of(problem, task.names(task.initial))


def test_of_two_goals_that_exclude_each_other_over_a_quantity_the_value_at_the_start_is_changed(
    asked: Asked,
) -> None:
    problem = asked("sealed(w1), foils >= 5")
    assert not space(problem).reachable
    assert changes(problem)[:1] == ["change initial foils(6) instead of foils(5)"]


def test_what_only_steps_in_their_turn_put_right_again_is_within_reach(asked: Asked) -> None:
    """New tips are taken where few are left, so a goal that tips are whole is broken first."""
    problem = asked("dosed(w1), dosed(w2), tips = 3")
    assert space(problem).reachable
    assert explain_infeasibility(problem).status == "feasible"


def test_a_value_that_no_step_brings_about_is_told_as_a_value_at_the_start(asked: Asked) -> None:
    problem = asked("tips = 3, level = 17")
    assert changes(problem) == ["change initial level(17) instead of level(20)"]


def test_no_second_value_of_a_quantity_is_tried(asked: Asked) -> None:
    found = [each.edits[0] for each in single_edits(space(asked("foils = 7")))]
    assert {each.verb for each in found if each.fact.name in ("level", "tips", "foils")} <= {
        "change",
        "remove",
    }


def test_no_facts_that_deny_each_other_are_tried_at_the_start() -> None:
    poorer = dict(without_one_fact(load_problem("centrifuge/four")))["weight(tube_1, 12)"]
    edits = [str(each.edits[0]) for each in single_edits(space(poorer))]
    assert "change initial at(tube_1, seat_5) instead of at(tube_1, seat_1)" in edits
    assert "add initial at(tube_1, seat_5)" not in edits
