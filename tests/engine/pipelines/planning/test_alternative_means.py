"""A plan of two hands is never later than one that does with one of them: that one is tried,
too.
"""

from pathlib import Path

import pytest

from cellwright.engine.model.ground_task import GroundTask
from cellwright.engine.model.outcome import Found
from cellwright.engine.model.shop_scheduling import Timetable
from cellwright.engine.pipelines.planning.checked_plan import plan_and_ground, problem_of
from cellwright.engine.pipelines.planning.makespan_plans import search_least_makespan
from cellwright.engine.pipelines.planning.timetable import time_plan
from cellwright.engine.pipelines.planning.timetable.alternative_means import (
    spare_means,
    with_one_of_each,
)
from cellwright.engine.stages.planning import SearchLimits
from cellwright.kb.model.plan_model import Plan
from cellwright.kb.model.planning_problem import Problem

DOMAIN = """
domain: swap
units: {time: s}
types: {hand: object, part: object, spot: object}
objects: {hand: [left, right], part: [bolt, nut], spot: SPOTS}
fluents:
  at(part, spot): {}
  holding(hand, part): {}
  empty(hand): {}
  free(spot): {}
defaults: ["at(bolt, tray)", "at(nut, jig)", empty(Hand), free(Spot)]
operators:
  pick(Hand, Part, Spot):
    preconditions: at(Part, Spot), empty(Hand)
    adds: holding(Hand, Part)
    resources: Hand, Part
    duration: 5 s
  put(Hand, Part, Spot):
    preconditions: holding(Hand, Part), free(Spot)
    adds: at(Part, Spot)
    resources: Hand, Part
    duration: 5 s
deductive_operators:
  - when: holding(Hand, Part)
    denies: at(Part, _); empty(Hand)
  - when: at(Part, Spot)
    denies: holding(_, Part); free(Spot)
  - when: not holding(Hand, Part)
    implies: empty(Hand)
  - when: not at(Part, Spot)
    implies: free(Spot)
"""
PROBLEM = 'problem: swapped\ndomain: swap\ngoals: ["at(bolt, jig)", "at(nut, tray)"]\n'


def swapped(folder: Path, spots: str) -> tuple[Problem, Found, GroundTask]:
    """Two parts change places, which takes both hands, or one hand and a third spot."""
    (folder / "domain.yaml").write_text(DOMAIN.replace("SPOTS", spots))
    (folder / "problem.yaml").write_text(PROBLEM)
    problem = problem_of(str(folder / "problem.yaml"))
    outcome, task = plan_and_ground(problem, SearchLimits())
    assert isinstance(outcome, Found)
    return problem, outcome, task


def hands(plan: Plan) -> set[str]:
    return {str(step.operator.arguments[0]) for step in plan.steps}


def test_of_two_hands_one_is_spare_and_the_other_does_it_alone(tmp_path: Path) -> None:
    problem, outcome, task = swapped(tmp_path, "[tray, jig, shelf]")
    assert hands(outcome.plan) == {"left", "right"}
    (spare,) = spare_means(task, outcome.plan)
    fewer = with_one_of_each(problem, task, outcome, SearchLimits())
    assert fewer is not None
    assert hands(fewer) == {"left", "right"} - {str(spare)}


def test_where_both_hands_are_needed_there_is_no_other_plan(tmp_path: Path) -> None:
    problem, outcome, task = swapped(tmp_path, "[tray, jig]")
    assert spare_means(task, outcome.plan)
    assert with_one_of_each(problem, task, outcome, SearchLimits()) is None


@pytest.mark.parametrize("spots", ["[tray, jig]", "[tray, jig, shelf]"])
def test_the_answer_is_never_later_than_the_plan_of_one_hand(tmp_path: Path, spots: str) -> None:
    problem, outcome, task = swapped(tmp_path, spots)
    best, _ = search_least_makespan(problem, task, outcome, SearchLimits())
    fewer = with_one_of_each(problem, task, outcome, SearchLimits())
    if fewer is not None:
        alone = time_plan(problem, task, fewer)
        assert isinstance(alone, Timetable)
        assert best.schedule.makespan <= alone.schedule.makespan
    # each carries one part: sooner than one after the other
    assert hands(best.plan) == {"left", "right"}
