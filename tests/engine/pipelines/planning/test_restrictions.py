"""What is lost or refused is not used any more; what is lost may be carried out of the way."""

import itertools
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.model.motion_values import Unmoved
from cellwright.engine.model.outcome import Found, Infeasible
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.pipelines.planning.restrictions import forbid_steps, forbid_unreachable_steps
from cellwright.kb.loader import load_problem
from cellwright.kb.model.conditions import And, Comparison, Condition, Or
from cellwright.kb.model.plan_model import StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import ANYTHING, Function, Number, match_term

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


PLATES = st.sampled_from([Function("one"), Function("two"), Function("cover"), ANYTHING])
PLACES = st.sampled_from([*map(Function, ("hand", "shaker", "shelf")), ANYTHING])


@pytest.fixture(scope="module")
def asked(tmp_path_factory: pytest.TempPathFactory) -> Problem:
    return problem(tmp_path_factory.mktemp("shaking"), "[shaken(two)]")


@given(blocked=st.lists(st.builds(lambda *two: Function("pick", two), PLATES, PLACES), max_size=4))
@settings(deadline=None, derandomize=True, max_examples=30)
def test_no_step_that_fits_a_pattern_is_left_and_every_one_besides(
    asked: Problem, blocked: list[Function]
) -> None:
    without = forbid_steps(asked, blocked=blocked)
    assert forbid_unreachable_steps(asked, map(unmoved, blocked)) == without
    picks = [operator for operator in without.domain.operators if operator.name == "pick"]
    for pair in itertools.product(("one", "two", "cover"), ("hand", "shaker", "shelf", "rack")):
        step = Function("pick", tuple(map(Function, pair)))
        fits = any(match_term(pattern, step, {}) is not None for pattern in blocked)
        left = [pick for pick in picks if allows(pick.precondition, pick.header, step)]
        assert bool(left) == (not fits)


def allows(condition: Condition, header: Function, step: Function) -> bool:
    """Whether the comparisons of a condition let a step be taken in some state."""
    values = dict(zip(header.arguments, step.arguments, strict=True))
    match condition:
        case And(parts):
            return all(allows(part, header, step) for part in parts)
        case Or(parts):
            return any(allows(part, header, step) for part in parts)
        case Comparison(left, "!=", right):
            return values[left] != right
    return True


def test_a_refused_step_is_forbidden_only_while_the_facts_hold_that_its_motion_failed_under(
    tmp_path: Path,
) -> None:
    asked = problem(tmp_path, "[shaken(one)]")
    shake = Function("shake", (Function("one"),))
    assert steps(asked) == ["shake"]
    for fact, left in (("shaker", False), ("rack", True)):
        at_place = Function("at", (Function("one"), Function(fact)))
        refused = replace(unmoved(shake), while_true=(at_place,))
        assert bool(steps(forbid_unreachable_steps(asked, [refused]))) == left
    assert not steps(forbid_unreachable_steps(asked, [unmoved(shake)]))


def unmoved(pattern: Function) -> Unmoved:
    """A refused step: whatever the arguments are for which the pattern has variables."""
    places = [n for n, argument in enumerate(pattern.arguments) if argument == ANYTHING]
    return Unmoved(StepId(1), pattern, "there", "way", "no way", regardless=frozenset(places))
