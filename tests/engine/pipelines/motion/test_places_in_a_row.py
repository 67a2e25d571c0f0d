"""Steps with several places in a row: what is carried, where it is between, and what a plan says of
steps that have no motion.
"""

from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.formats.report.plans.plan_motions import plan_motions_entry, unproved_lines
from cellwright.engine.model.motion_values import MovedStep, Unmoved
from cellwright.engine.pipelines.execution.journal_motions import (
    RestingCell,
    TakenStep,
    world_during,
)
from cellwright.engine.pipelines.execution.plan_records import read_ground_atom
from cellwright.engine.pipelines.execution.run_motions import step_moment
from cellwright.engine.pipelines.motion.arm_conflicts import passages_of
from cellwright.engine.pipelines.motion.moving_plan import MovingRun, plan_moving
from cellwright.engine.pipelines.motion.places_in_a_row import step_parts
from cellwright.engine.pipelines.motion.plan_walk import PlanWalk, operation_of, states_of
from cellwright.engine.pipelines.motion.step_film import shots_of_film, takes_of_plan
from cellwright.engine.pipelines.planning import plan_objective
from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.plugins import geometry_backend
from cellwright.engine.stages.planning import SearchLimits
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import load_problem
from cellwright.kb.loader.cell import load_cell
from cellwright.kb.model.plan_model import Plan, Step, StepId

DOMAIN = """
domain: carrying
types: {item: object, place: object}
objects: {item: [bolt, nut], place: [bench, shelf, scanner, gripper]}
fluents: {"at(item, place)": {}, "seen(item)": {}, "rested": {}}
operators:
  carry(Item, From, To):
    where: From != To, From != gripper, To != gripper
    preconditions: at(Item, From)
    adds: at(Item, To)
    deletes: at(Item, From)
    duration: 20 s
  pick(Item, From):
    where: From != gripper
    preconditions: at(Item, From)
    adds: at(Item, gripper)
    deletes: at(Item, From)
    duration: 8 s
  put(Item, To):
    where: To != gripper
    preconditions: at(Item, gripper)
    adds: at(Item, To)
    deletes: at(Item, gripper)
    duration: 8 s
  wait:
    adds: rested
    duration: 5 s
"""
CELL = """
cell: carrying
arms: {ur5: {model: ur5, tool: {at: [0, 0, 0.15]}, home: [0, -90, 90, -90, -90, 0]}}
fixtures:
  post: {at: [0.45, 0.02, 0.2], shapes: [{box: [0.03, 0.03, 0.4]}]}
parts:
  bolt: {at: [0.45, -0.2, 0.032], shapes: [{cylinder: {radius: 0.015, length: 0.06}}], features: {grip: {at: [0, 0, 0.03], rpy: [180, 0, 0]}}}
  nut: {at: [-0.5, 0.3, 0.032], shapes: [{cylinder: {radius: 0.015, length: 0.06}}], features: {grip: {at: [0, 0, 0.03], rpy: [180, 0, 0]}}}
places:
  bench: {at: [0.45, -0.2, 0.062], rpy: [180, 0, 0], approach: 0.12, touches: [bolt]}
  shelf: {at: [%s, %s, 0.062], rpy: [180, 0, 0], approach: 0.12, touches: [bolt]}
  scanner: {at: [0.35, 0.35, 0.35], rpy: [180, 0, 0], approach: 0.05, touches: [bolt]}
locations:
  at(Item, gripper): {body: Item, in: ur5.tool}
  at(Item, Place): {body: Item, place: Place}
operations:
  carry(Item, From, To): {at: %s, takes: 1 s}
  pick(Item, From): {at: From, takes: 1 s}
  put(Item, To): {at: To, takes: 1 s}
"""
PROBLEM = """
problem: one
domain: carrying
initial: ["at(bolt, bench)"]
goals: ["at(bolt, shelf)", rested]
"""
ROW = "[From, To]"


def carrying_room(
    folder: Path, at: str = ROW, shelf: tuple[float, float] = (0.45, 0.25)
) -> tuple[PlanWalk, Path]:
    (folder / "problems").mkdir(parents=True)
    (folder / "domain.yaml").write_text(DOMAIN)
    (folder / "cell.yaml").write_text(CELL % (*shelf, at))
    (folder / "problems" / "one.yaml").write_text(PROBLEM)
    problem = load_problem(str(folder / "problems" / "one.yaml"))
    semantics = PlanGate().semantics(problem)
    cell = load_cell(folder / "cell.yaml")
    return PlanWalk(semantics, cell, geometry_backend()), folder


def steps_of(walk: PlanWalk, *operators: str) -> list[MovedStep | Unmoved]:
    names = [read_ground_atom(name) for name in operators]
    steps = tuple(
        Step(StepId(n), name, after=(StepId(n - 1),) if n > 1 else ())
        for n, name in enumerate(names, 1)
    )
    return list(walk.steps(Plan(steps)))


def moving(folder: Path) -> MovingRun:
    return plan_moving(
        load_problem(str(folder / "problems" / "one.yaml")),
        load_cell(folder / "cell.yaml"),
        geometry_backend(),
        lambda each: plan_objective.plan_for_objective(each, SearchLimits(20_000)),
    )


CARRY = "carry(bolt, bench, shelf)"


@lru_cache
def carried(folder: Path) -> tuple[PlanWalk, MovedStep]:
    walk, _ = carrying_room(folder / "carried")
    (moved,) = steps_of(walk, CARRY)
    assert isinstance(moved, MovedStep)
    return walk, moved


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> tuple[PlanWalk, MovedStep]:
    return carried(tmp_path_factory.mktemp("rooms"))


def test_the_arm_goes_to_both_places_and_holds_the_body_between(
    room: tuple[PlanWalk, MovedStep],
) -> None:
    _, moved = room
    assert [stop.place for stop in moved.stops] == ["bench", "shelf"]
    kinds = [leg.kind.value for leg in moved.legs]
    assert kinds == ["way", "in", "out", "way", "in", "out"]
    held = [leg.holding for leg in moved.legs]
    assert held == [(), (), ("bolt",), ("bolt",), ("bolt",), ()]
    assert moved.proved
    assert moved.takes_s == 2.0  # a second at each place


@settings(max_examples=6, deadline=None)
@given(x=st.floats(0.3, 0.55), y=st.floats(0.15, 0.35))
def test_a_step_with_two_places_moves_as_two_steps_with_one(
    tmp_path_factory: pytest.TempPathFactory, x: float, y: float
) -> None:
    walk, _ = carrying_room(tmp_path_factory.mktemp("law"), shelf=(x, y))
    one = steps_of(walk, CARRY)
    two = steps_of(walk, "pick(bolt, bench)", "put(bolt, shelf)")
    if any(isinstance(step, Unmoved) for step in (*one, *two)):
        assert isinstance(one[-1], Unmoved)
        assert isinstance(two[-1], Unmoved)
        return
    moved = ([step for step in steps if isinstance(step, MovedStep)] for steps in (one, two))
    legs = [[leg for step in steps for leg in step.legs] for steps in moved]
    assert [leg.kind for leg in legs[0]] == [leg.kind for leg in legs[1]]
    assert [leg.holding for leg in legs[0]] == [leg.holding for leg in legs[1]]
    for first, second in zip(*legs, strict=True):
        assert np.allclose(first.path[-1], second.path[-1], atol=1e-6)


def test_a_post_between_the_places_is_gone_round_with_the_body_in_hand(
    room: tuple[PlanWalk, MovedStep],
) -> None:
    """The way across is proved with the bolt in hand: no shot of it has the bolt in the post."""
    walk, moved = room
    plan = Plan((Step(StepId(1), read_ground_atom(CARRY)),))
    takes = list(takes_of_plan(walk.semantics, walk.cell, plan, [moved]))
    for shot in shots_of_film(takes, 0.1):
        bolt = shot.world.pose("world", "bolt")[:3, 3]
        assert not (abs(bolt[0] - 0.45) < 0.03 and abs(bolt[1] - 0.02) < 0.03 and bolt[2] < 0.42)
    heights = [shot.world.pose("world", "bolt")[2, 3] for shot in shots_of_film(takes, 0.1)]
    assert max(heights) > 0.1
    assert heights[-1] == pytest.approx(0.032)


def test_film_journal_and_conflicts_have_the_body_at_the_same_places(
    room: tuple[PlanWalk, MovedStep],
) -> None:
    walk, moved = room
    ((_, before, after),) = states_of(
        walk.semantics, Plan((Step(StepId(1), read_ground_atom(CARRY)),))
    )
    taken = TakenStep(1, 1, moved, frozenset(before), frozenset(after))
    resting, seconds = RestingCell(walk.cell), 0.0
    parts = step_parts(moved, walk.room(before).world, walk.room(after).world)
    for part, _, world in parts:
        seconds += part.seconds
        now = world_during(resting, taken, (seconds - 1e-6) / moved.seconds)
        arm = part.legs[-1].arm
        there = world.moved(arm, part.legs[-1].path[-1]).pose("world", "bolt")
        assert np.allclose(now.pose("world", "bolt"), there, atol=1e-4)
    riders = [
        "bolt" in passage.rider.bodies
        for passage in passages_of(
            step_moment(walk, moved, before, after), "ur5", moved.legs[0].path[0]
        )
    ]
    assert any(riders)
    assert not riders[0]
    assert not riders[-1]


def test_what_is_shown_to_a_scanner_on_the_way_stays_in_hand(tmp_path: Path) -> None:
    walk, _ = carrying_room(tmp_path / "r", "[From, scanner, To]")
    (moved,) = steps_of(walk, CARRY)
    assert isinstance(moved, MovedStep)
    assert [sorted(stop.in_hand) for stop in moved.stops] == [["bolt"], ["bolt"], []]
    assert [stop.put for stop in moved.stops] == [(), (), ("bolt",)]


def test_a_row_in_which_a_place_is_out_of_reach_has_no_motion_and_leaves_the_arm(
    tmp_path: Path,
) -> None:
    walk, _ = carrying_room(tmp_path / "r", shelf=(2.0, 2.0))
    stood = walk.hands.now("ur5").copy()
    (moved,) = steps_of(walk, CARRY)
    assert isinstance(moved, Unmoved)
    assert moved.place == "shelf"
    assert np.array_equal(walk.hands.now("ur5"), stood)


@pytest.mark.parametrize(("at", "unproved"), [(ROW, []), ("From", ["bolt"]), ("To", ["bolt"])])
def test_a_carry_with_one_place_is_told_and_one_with_both_is_proved(
    at: str, unproved: list[str], tmp_path: Path
) -> None:
    _, folder = carrying_room(tmp_path / "r", at)
    (folder / "domain.yaml").write_text(  # only carry can do it
        DOMAIN.replace("    where: To != gripper\n", "    where: To = gripper\n")
    )
    run = moving(folder)
    jumps = [body for step in run.unproved for body in step.bodies]
    assert jumps == unproved
    lines = unproved_lines(run.unproved)
    assert any("without a motion: 1 step (" in line and "wait)" in line for line in lines)
    assert any("moves bolt without a motion" in line for line in lines) == bool(unproved)
    assert len(plan_motions_entry(run)["unproved"]) == 1 + len(unproved)


def test_a_step_without_an_operation_that_moves_a_body_is_told(tmp_path: Path) -> None:
    _, folder = carrying_room(tmp_path / "r")
    cell = folder / "cell.yaml"
    cell.write_text(
        cell.read_text().replace("  carry(Item, From, To): {at: [From, To], takes: 1 s}\n", "")
    )
    (folder / "domain.yaml").write_text(
        DOMAIN.replace("    where: To != gripper\n", "    where: To = gripper\n")
    )
    run = moving(folder)
    assert [(str(step.operator), step.bodies) for step in run.unproved if step.bodies] == [
        (CARRY, ("bolt",))
    ]
    assert any(
        "no operation says what an arm does in it" in line for line in unproved_lines(run.unproved)
    )


@pytest.mark.parametrize(
    ("entry", "code"),
    [
        ("[From, To], with: bench", "K005"),
        ("[From, To], drags: bolt", "K005"),
        ("[From, Somewhere]", "K105"),
        ("[From, attic]", "K101"),
        ("[]", "K005"),
    ],
)
def test_a_row_that_means_nothing_is_told(entry: str, code: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput) as error:
        carrying_room(tmp_path / "r", entry)
    assert code in {each.code for each in error.value.diagnostics}


def test_the_places_of_a_row_are_those_of_the_step(room: tuple[PlanWalk, MovedStep]) -> None:
    walk, _ = room
    operation = operation_of(walk.cell, read_ground_atom(CARRY))
    assert operation is not None
    assert list(map(str, operation.stops)) == ["bench", "shelf"]
