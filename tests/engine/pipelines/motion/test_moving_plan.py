"""Plans that move: motions fit together, take the time that the plan says, and what is in the
way is moved or told.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cellwright.engine.formats.report.cells import motion_pictures
from cellwright.engine.model.motion_values import LegKind, MovedStep, Unmoved
from cellwright.engine.model.outcome import Found, Infeasible
from cellwright.engine.pipelines.motion.moving_plan import MovingRun, plan_moving
from cellwright.engine.pipelines.motion.plan_walk import PlanWalk, operation_of, states_of
from cellwright.engine.pipelines.motion.step_film import shots_of_film, takes_of_plan, thin_shots
from cellwright.engine.pipelines.planning import plan_objective
from cellwright.engine.pipelines.planning.plan_files import check_plan
from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.pipelines.planning.restrictions import forbid_unreachable_steps
from cellwright.engine.pipelines.recovery.world_model import Dynamics, WorldState
from cellwright.engine.plugins import geometry_backend
from cellwright.engine.stages.geometry.world.geometric_world import (
    GeometricWorld,
    world_after_facts,
)
from cellwright.engine.stages.planning import SearchLimits
from cellwright.kb.asp import ground_term
from cellwright.kb.loader import load_problem
from cellwright.kb.loader.cell import cell_of, load_cell
from cellwright.kb.model.plan_model import Step, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Function

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


def atom(text: str) -> Function:
    """The ground atom in a text."""
    found = ground_term(text)
    assert isinstance(found, Function)
    return found


def kiln_room(
    folder: Path, lintel_m: float = 1.5, suits: tuple[str, ...] = SUITS
) -> tuple[Problem, Path]:
    """A bolt is to go into a kiln that a brick covers; a lintel hangs above the kiln at a
    height.
    """
    (folder / "problems").mkdir()
    (folder / "domain.yaml").write_text(
        DOMAIN.replace("fits(item, place): {facts: []}", '"suits(item, place)": {}')
    )
    (folder / "cell.yaml").write_text(CELL % lintel_m)
    (folder / "problems" / "fire.yaml").write_text(
        PROBLEM % ", ".join(f'"{each}"' for each in suits)
    )
    return load_problem(str(folder / "problems" / "fire.yaml")), folder / "cell.yaml"


def moving(problem: Problem, cell: Path) -> MovingRun:
    return plan_moving(
        problem,
        load_cell(cell),
        geometry_backend(),
        lambda each: plan_objective.plan_for_objective(each, SearchLimits(20_000)),
    )


@pytest.fixture(scope="module")
def fired(tmp_path_factory: pytest.TempPathFactory) -> MovingRun:
    """The plan in which the brick is out of the way."""
    return moving(*kiln_room(tmp_path_factory.mktemp("kiln")))


@pytest.mark.slow
def test_what_stands_in_the_way_is_moved_first(fired: MovingRun) -> None:
    """The symbols know nothing of the brick on the kiln: it is found when the arm cannot put
    the bolt there.
    """
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


def test_where_the_obstacle_cannot_be_put_anywhere_it_is_proved_that_there_is_no_plan(
    tmp_path: Path,
) -> None:
    problem, cell = kiln_room(tmp_path, suits=SUITS[:2])
    found = moving(problem, cell)
    assert isinstance(found.run.outcome, Infeasible)
    assert "put(bolt, kiln) has no motion" in found.run.outcome.reason
    assert "brick" in found.run.outcome.reason


@pytest.mark.slow
def test_a_place_under_a_low_lintel_is_never_reached_whatever_is_moved(tmp_path: Path) -> None:
    problem, cell = kiln_room(tmp_path, lintel_m=0.22)
    found = moving(problem, cell)
    assert isinstance(found.run.outcome, Infeasible)
    assert {str(each.operator) for each in found.refused} >= {"put(bolt, kiln)"}


def test_motions_fit_together_and_take_the_time_that_the_plan_says(fired: MovingRun) -> None:
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


def test_what_is_gripped_rides_with_the_arm_until_it_is_left(fired: MovingRun) -> None:
    steps = fired.steps
    held = [
        [leg.holding for leg in step.legs if leg.kind in (LegKind.WAY, LegKind.OUT)]
        for step in steps
    ]
    assert held == [[(), ("brick",)], [("brick",), ()], [(), ("bolt",)], [("bolt",), ()]]


@pytest.mark.slow
def test_the_same_problem_has_the_same_motions(fired: MovingRun, tmp_path: Path) -> None:
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
    from cellwright.kb.diagnostics import InvalidInput

    _, cell = kiln_room(tmp_path)
    cell.write_text(cell.read_text().replace("pick(Item, Place): {at: Place, takes: 1 s}", entry))
    with pytest.raises(InvalidInput) as error:
        load_cell(cell)
    assert code in {each.code for each in error.value.diagnostics}


def test_a_place_that_is_out_of_reach_is_out_of_reach_wherever_the_arm_comes_from() -> None:
    """One bar serves for all starts, but only for the station where the arm stands."""
    known = load_problem("bulkhead/three_stations")
    problem = replace(known, statics=(*known.statics, atom("serves(left, c2)")))
    semantics = PlanGate().semantics(problem)
    assert not _refuses(problem, "rack(us_probe)")
    walk = PlanWalk(semantics, cell_of("bulkhead"), geometry_backend())
    step = Step(StepId(1), atom("move_at(t3_746, left, rack(us_probe), meas(c2))"))
    before = (semantics.initial() - {atom("stands(t3_746, middle)")}) | {
        atom("stands(t3_746, left)"),
        atom("holding(t3_746, us_probe)"),
    }
    operation = operation_of(walk.cell, step.operator)
    assert operation is not None
    (refused,) = [walk.step(step, operation, before, before)]
    assert isinstance(refused, Unmoved)
    assert refused.regardless == {0, 1, 2}
    assert atom("stands(t3_746, left)") in refused.while_true
    barred = forbid_unreachable_steps(problem, [refused])
    assert all(_refuses(barred, start) for start in ("rack(us_probe)", "meas(a1)", "meas(b1)"))
    assert not _refuses(barred, "rack(us_probe)", "right")


def _refuses(problem: Problem, start: str, station: str = "left") -> bool:
    """Whether a move to the last point is refused from a start, with the arm at a station."""
    dynamics = Dynamics(problem)
    state = (dynamics.start().facts - {atom("stands(t3_746, middle)")}) | {
        atom(f"stands(t3_746, {station})"),
        atom("holding(t3_746, us_probe)"),
    }
    there = {each for each in state if each.name != "at"} | {
        atom(f"at(t3_746, approach_point({start}))")
    }
    said = dynamics.refusal(
        atom(f"move_at(t3_746, {station}, {start}, meas(c2))"), WorldState(frozenset(there), {})
    )
    return said != ""


def test_a_film_shows_every_body_where_the_plan_puts_it(fired: MovingRun) -> None:
    found = fired
    assert isinstance(found.run.outcome, Found)
    cell = load_cell(Path(str(found.problem.domain.path)).with_name("cell.yaml"))
    semantics = PlanGate().semantics(found.problem)
    shots = list(
        shots_of_film(takes_of_plan(semantics, cell, found.run.outcome.plan, found.steps), 0.2)
    )
    times = [each.at_s for each in shots]
    assert times == sorted(times)
    assert times[-1] == pytest.approx(sum(each.seconds for each in found.steps))
    *_, (_, _, after) = states_of(semantics, found.run.outcome.plan)
    for name in cell.bodies:
        there = world_after_facts(GeometricWorld.of(cell), after).pose("world", name)
        assert np.allclose(shots[-1].world.pose("world", name), there)
    scene = json.loads(motion_pictures.film_gltf(shots))
    moving_nodes = {
        scene["nodes"][each["target"]["node"]]["name"]
        for each in scene["animations"][0]["channels"]
    }
    assert {"bolt", "brick", "carrier 1"} <= moving_nodes
    assert "oven" not in moving_nodes
    assert [each.at_s for each in thin_shots(shots, 5.0)][:3] == pytest.approx([0, 5, 10], abs=0.21)
