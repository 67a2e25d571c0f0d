"""What is lost is not used any more, but may be carried out of the way of others."""

from pathlib import Path

import pytest

from cellwright.engine.model.outcome import Found, Infeasible
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.pipelines.planning.restrictions import forbid_steps
from cellwright.kb.loader import load_problem
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import ANYTHING, Function, Number

DOMAIN = """domain: shaking
types: {place: object, arm: object, plate: object, lid: plate}
objects: {place: [hand, shaker, shelf, table, rack], arm: [robot], plate: [one, two], lid: [cover]}
fluents: {"at(plate, place)": {}, "free(place)": {}, "shaken(plate)": {}, "lit": {}, "by(arm, place)": {}}
operators:
  pick(Plate, Place):
    preconditions: at(Plate, Place), free(hand), by(robot, Place)
    adds: at(Plate, hand)
    resources: hand, Plate
  put(Plate, Place):
    where: Place != hand
    preconditions: at(Plate, hand), free(Place), by(robot, Place)
    adds: at(Plate, Place)
    resources: hand, Plate
  shake(Plate):
    preconditions: at(Plate, shaker)
    adds: shaken(Plate)
    resources: shaker, Plate
  go(Arm, From, To):
    where: From != To
    preconditions: by(Arm, From)
    adds: by(Arm, To)
    resources: Arm
deductive_operators:
  - {when: "at(Plate, Place)", denies: "at(Plate, Other), Other != Place; free(Place)"}
  - {when: "not at(Plate, Place)", implies: free(Place)}
  - {when: "at(cover, Place)", where: Place != shelf, implies: lit}
  - {when: "by(Arm, Place)", denies: "by(Arm, Other), Other != Place"}
defaults: ["by(robot, table)", free(Place)]
"""
PROBLEM = """problem: two
domain: shaking
initial: ["at(one, shaker), at(two, table), at(cover, shelf)"]
goals: GOALS
"""


def problem(folder: Path, goals: str) -> Problem:
    (folder / "domain.yaml").write_text(DOMAIN, "utf-8")
    (folder / "two.yaml").write_text(PROBLEM.replace("GOALS", goals), "utf-8")
    return load_problem(folder / "two.yaml")


def steps(asked: Problem, *lost: str) -> list[str]:
    found = checked_plan.plan_problem(forbid_steps(asked, lost))
    return [each.operator.name for each in found.plan.steps] if isinstance(found, Found) else []


def test_a_lost_plate_is_carried_out_of_the_only_place(tmp_path: Path) -> None:
    found = steps(problem(tmp_path, "[shaken(two)]"), "one")
    assert sorted(found) == sorted(["go", "pick", "go", "put", "go", "pick", "go", "put", "shake"])


def test_a_lost_plate_is_not_worked_on(tmp_path: Path) -> None:
    assert steps(problem(tmp_path, "[shaken(one)]"))
    assert not steps(problem(tmp_path, "[shaken(one)]"), "one")


@pytest.mark.parametrize("lost", ["hand", "robot"])
def test_a_lost_hand_carries_nothing_and_a_lost_arm_goes_nowhere(tmp_path: Path, lost: str) -> None:
    assert not steps(problem(tmp_path, "[shaken(two)]"), lost)


def test_what_is_said_of_another_thing_does_not_keep_a_plate_where_it_is(tmp_path: Path) -> None:
    """That the cover lights a lamp is said of the cover alone: a plate can be carried, a lost
    cover cannot.
    """
    asked = problem(tmp_path, '["free(shelf)"]')
    assert steps(asked)
    assert not steps(asked, "cover")
    assert steps(problem(tmp_path, "[free(shaker)]"), "one")


def test_a_pattern_may_leave_a_part_of_a_term_open() -> None:
    """Nothing can be put into the furnace: the probe cannot be heated there.

    The drawer has other slots than one.
    """
    problem = checked_plan.problem_of("themse/one")
    furnace = Function("slot", (Function("furnace"), ANYTHING))
    without = forbid_steps(problem, blocked=[Function("put", (ANYTHING, furnace))])
    assert isinstance(checked_plan.plan_problem(without), Infeasible)
    other = Function("slot", (Function("drawer"), Number(2)))
    assert isinstance(
        checked_plan.plan_problem(
            forbid_steps(problem, blocked=[Function("put", (ANYTHING, other))])
        ),
        Found,
    )
