"""Plans that move: motions fit together, take the time that the plan says, and what is in the way is moved or told."""

from pathlib import Path

import numpy as np
import pytest

from engine.model.moves import LegKind, MovedStep
from engine.model.outcome import Found, Infeasible
from engine.pipelines import objective
from engine.pipelines.moves.planning import Moving, plan_moving
from engine.pipelines.planning import check_plan
from engine.plugins import geometry_backend
from engine.stages.planning import Limits
from kb.loader import load_problem
from kb.loader.cell import load_cell
from kb.model.problem import Problem

DOMAIN = """
domain: kiln_room
types: {item: object, place: object, hand: place}
objects: {item: [bolt, brick], place: [bench, kiln, top, shelf], hand: [gripper]}
statics: {fits(item, place): {facts: []}}
fluents: {"at(item, place)": {}, "free(place)": {}}
operators:
  pick(Item, Place):
    where: Place != gripper
    preconditions: at(Item, Place), free(gripper)
    adds: at(Item, gripper)
    resources: gripper
    duration: 8 s
  put(Item, Place):
    where: Place != gripper, suits(Item, Place)
    preconditions: at(Item, gripper), free(Place)
    adds: at(Item, Place)
    resources: gripper
    duration: 8 s
deductive_operators:
  - when: at(Item, Place)
    denies: at(Item, Other), Other != Place; free(Place)
  - when: not at(Item, Place)
    implies: free(Place)
defaults: [free(Place)]
"""
CELL = """
cell: kiln_room
arms: {ur5: {model: ur5, tool: {at: [0, 0, 0.15]}, home: [0, -90, 90, -90, -90, 0]}}
fixtures:
  oven: {at: [0.45, 0.2, 0.05], shapes: [{ring: {radius: 0.07, inner: 0.045, length: 0.1}}]}
  lintel: {at: [0.45, 0.2, %s], shapes: [{box: [0.3, 0.3, 0.02]}]}
parts:
  bolt: {at: [0.45, -0.2, 0.032], shapes: [{cylinder: {radius: 0.015, length: 0.06}}], features: {grip: {at: [0, 0, 0.03], rpy: [180, 0, 0]}}}
  brick: {at: [0.45, 0.2, 0.122], shapes: [{box: [0.16, 0.16, 0.04]}], features: {grip: {at: [0, 0, 0.02], rpy: [180, 0, 0]}}}
places:
  bench: {at: [0.45, -0.2, 0.062], rpy: [180, 0, 0], approach: 0.12, turns: true}
  shelf: {at: [0.3, -0.4, 0.062], rpy: [180, 0, 0], approach: 0.12, turns: true}
  kiln: {at: [0.45, 0.2, 0.063], rpy: [180, 0, 0], approach: 0.15, turns: true}
  top: {at: [0.45, 0.2, 0.142], rpy: [180, 0, 0], approach: 0.12, turns: true}
locations:
  at(Item, gripper): {body: Item, in: ur5.tool}
  at(Item, Place): {body: Item, place: Place}
operations:
  pick(Item, Place): {at: Place, takes: 1 s}
  put(Item, Place): {at: Place, takes: 500 ms}
"""
PROBLEM = """
problem: fire
domain: kiln_room
statics: [%s]
initial: ["at(bolt, bench)", "at(brick, top)"]
goals: ["at(bolt, kiln)"]
"""
SUITS = ("suits(bolt, kiln)", "suits(bolt, bench)", "suits(brick, shelf)", "suits(brick, top)")


def kiln_room(folder: Path, lintel_m: float = 1.5, suits: tuple[str, ...] = SUITS) -> tuple[Problem, Path]:
    """A bolt is to go into a kiln that a brick covers; a lintel hangs above the kiln at a height."""
    (folder / "problems").mkdir()
    (folder / "domain.yaml").write_text(
        DOMAIN.replace("fits(item, place): {facts: []}", '"suits(item, place)": {}')
    )
    (folder / "cell.yaml").write_text(CELL % lintel_m)
    (folder / "problems" / "fire.yaml").write_text(PROBLEM % ", ".join(f'"{each}"' for each in suits))
    return load_problem(str(folder / "problems" / "fire.yaml")), folder / "cell.yaml"


def moving(problem: Problem, cell: Path) -> Moving:
    return plan_moving(
        problem, load_cell(cell), geometry_backend(), lambda each: objective.plan(each, Limits(20_000))
    )


@pytest.fixture(scope="module")
def fired(tmp_path_factory: pytest.TempPathFactory) -> Moving:
    """The plan in which the brick is out of the way."""
    return moving(*kiln_room(tmp_path_factory.mktemp("kiln")))


def test_what_stands_in_the_way_is_moved_first(fired: Moving) -> None:
    """The symbols know nothing of the brick on the kiln: it is found when the arm cannot put the bolt there."""
    found = fired
    assert isinstance(found.run.outcome, Found)
    said = [str(step.operator) for step in found.run.outcome.plan.steps]
    assert said == ["pick(brick, top)", "put(brick, shelf)", "pick(bolt, bench)", "put(bolt, kiln)"]
    (refused,) = found.refused
    assert str(refused.operator) == "put(bolt, kiln)"
    assert refused.level == "approach"
    assert refused.sure
    assert "brick" in refused.culprits
    assert "at(brick, top)" in map(str, refused.while_true)


def test_where_the_obstacle_cannot_be_put_anywhere_it_is_proved_that_there_is_no_plan(tmp_path: Path) -> None:
    problem, cell = kiln_room(tmp_path, suits=SUITS[:2])
    found = moving(problem, cell)
    assert isinstance(found.run.outcome, Infeasible)
    assert "put(bolt, kiln) has no motion" in found.run.outcome.reason
    assert "brick" in found.run.outcome.reason


def test_a_place_under_a_low_lintel_is_never_reached_whatever_is_moved(tmp_path: Path) -> None:
    problem, cell = kiln_room(tmp_path, lintel_m=0.22)
    found = moving(problem, cell)
    assert isinstance(found.run.outcome, Infeasible)
    assert {str(each.operator) for each in found.refused} >= {"put(bolt, kiln)"}


def test_motions_fit_together_and_take_the_time_that_the_plan_says(fired: Moving) -> None:
    found = fired
    assert isinstance(found.run.outcome, Found)
    at = np.radians([0, -90, 90, -90, -90, 0])
    for step in found.steps:
        for leg in step.legs:
            assert np.abs(leg.path[0] - at).max() < 1e-9
            at = leg.path[-1]
    lasts = {step.operator: step.duration for step in found.run.outcome.plan.steps}
    for step in found.steps:
        assert isinstance(step, MovedStep)
        assert lasts[step.operator] - 1 < step.seconds <= lasts[step.operator]
        assert step.proved
    assert check_plan(found.problem, found.run.outcome.plan) == []


def test_what_is_gripped_rides_with_the_arm_until_it_is_left(fired: Moving) -> None:
    steps = fired.steps
    held = [[leg.holding for leg in step.legs if leg.kind in (LegKind.WAY, LegKind.OUT)] for step in steps]
    assert held == [[(), ("brick",)], [("brick",), ()], [(), ("bolt",)], [("bolt",), ()]]


def test_the_same_problem_has_the_same_motions(fired: Moving, tmp_path: Path) -> None:
    one, other = fired, moving(*kiln_room(tmp_path))
    for first, second in zip(one.steps, other.steps, strict=True):
        for a, b in zip(first.legs, second.legs, strict=True):
            assert np.array_equal(a.path, b.path)


@pytest.mark.parametrize(
    ("entry", "code"),
    [
        ("pick(Item, Place): {at: Spot}", "K105"),
        ("pick(Item, Place): {at: atic}", "K101"),
        ("pick(Item, Place): {drags: brick}", "K101"),
        ("pick(Item, Place): {at: Place, takes: 3 h}", "K005"),
    ],
)
def test_an_operation_that_means_nothing_is_told(entry: str, code: str, tmp_path: Path) -> None:
    from kb.diagnostics import InvalidInput

    _, cell = kiln_room(tmp_path)
    cell.write_text(cell.read_text().replace("pick(Item, Place): {at: Place, takes: 1 s}", entry))
    with pytest.raises(InvalidInput) as error:
        load_cell(cell)
    assert code in {each.code for each in error.value.diagnostics}
