"""The witness and the driver `mujoco`: plans that move are confirmed by physics, and what
physics hinders is found and mended.
"""

import math
import shutil
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco")

from benchmarks.program_replay import replay_program
from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.motion.moving_plan import plan_with_poses
from cellwright.engine.pipelines.planning import plan_objective
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.pipelines.simulators import HiddenCell
from cellwright.engine.pipelines.simulators.mujoco_replay.mujoco_driver import (
    PhysicalCell,
    mujoco_simulator,
)
from cellwright.engine.plugins import geometry_backend
from cellwright.engine.ports import DriverSetup
from cellwright.engine.stages.diagnosis.fault_problems import CURED
from cellwright.engine.stages.planning import SearchLimits
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import load_problem
from cellwright.kb.loader.cell import cell_of
from cellwright.kb.targets import BUNDLED_DOMAINS

CARRY = """
operators:
  carry(Probe, From, To):
    types: {Probe: probe, From: depot, To: depot, One: unit, Two: unit}
    where: part_of(From, One), part_of(To, Two), One != Two
    preconditions: at(Probe, From), free(mars_gripper), free(To), accessible(From), accessible(To)
    adds: at(Probe, To)
    resources: mars_gripper, Probe
    duration: 12 s
    command: {stream: "arm(carry(Probe, From, To))", reply: done}
"""
OVER = """
problem: over
domain: themse
initial: ["at(lid, stand)", "position(drawer, open)"]
goals: ["at(probe_1, slot(freezer, 1))"]
"""
PICK = ("open_drawer", "press_switch(closed, open)", "pick(probe_1, slot(drawer, 1))")


@pytest.mark.slow
def test_physics_confirms_a_plan_with_one_probe() -> None:
    cell = cell_of("themse/one")
    made = plan_with_poses(
        load_problem("themse/one"),
        cell,
        geometry_backend(),
        lambda each: plan_objective.plan_for_objective(each, SearchLimits()),
    ).moving
    assert isinstance(made.run.outcome, Found)
    seen = replay_program(
        PlanGate().semantics(made.problem), cell, made.run.outcome.plan, made.steps
    )
    assert seen.touched == ()
    assert max(seen.off_m.values()) < 0.005
    assert seen.off_place < 0.005


@pytest.mark.slow
def test_physics_confirms_a_step_with_two_places_in_a_row(tmp_path: Path) -> None:
    """The hand closes at the first place, and holds the probe until the second."""
    for name in ("domain.yaml", "rules.lp", "cell.yaml"):
        shutil.copy(BUNDLED_DOMAINS / "themse" / name, tmp_path)
    with (tmp_path / "domain.yaml").open("a") as domain:
        domain.write(CARRY)
    with (tmp_path / "cell.yaml").open("a") as cell_file:
        cell_file.write("operations:\n  carry(Probe, From, To): {at: [From, To], takes: 1 s}\n")
    (tmp_path / "over.yaml").write_text(OVER)
    problem = load_problem(str(tmp_path / "over.yaml"))
    cell = cell_of(str(tmp_path))
    moving = plan_with_poses(
        problem,
        cell,
        geometry_backend(),
        lambda each: plan_objective.plan_for_objective(each, SearchLimits()),
    ).moving
    assert isinstance(moving.run.outcome, Found)
    assert [step.operator.name for step in moving.steps] == ["carry"]
    replay = replay_program(
        PlanGate().semantics(moving.problem), cell, moving.run.outcome.plan, moving.steps
    )
    assert replay.touched == ()
    assert max(replay.off_m.values()) < 0.005


@pytest.mark.slow
def test_physics_confirms_an_inspection_with_both_tools_from_three_stations() -> None:
    cell = cell_of("bulkhead/three_stations")
    made = plan_with_poses(
        problem_of("bulkhead/three_stations"),
        cell,
        geometry_backend(),
        lambda each: plan_objective.plan_for_objective(each, SearchLimits()),
    ).moving
    assert isinstance(made.run.outcome, Found)
    seen = replay_program(
        PlanGate().semantics(made.problem), cell, made.run.outcome.plan, made.steps
    )
    assert seen.touched == ()
    assert seen.off_tip_m < 0.002
    assert seen.off_place < 0.002
    assert seen.off_m["us_probe"] < 0.001  # it hangs in the rack again, the laser is in the hand


def cell_with(problem: str = "themse/one", **options: str) -> HiddenCell:
    return mujoco_simulator(DriverSetup(load_problem(problem), options=options)).cell


def test_a_tool_that_sticks_in_the_hand_is_not_put_down_until_that_is_mended() -> None:
    cell = cell_with("bulkhead/both_tools", stick="us_probe")
    there = ["move_retract(t3_746, m1)", "move(t3_746, meas(m1), rack(us_probe))"]
    assert [cell.take(step, "done") for step in there] == ["done", "done"]
    assert cell.take("put_down(t3_746, us_probe)", "done") == "held"
    assert "holding(t3_746, us_probe)" in set(map(str, cell.world.facts))
    assert cell.answer("wait_for_pressure") == CURED
    assert cell.take("put_down(t3_746, us_probe)", "done") == "done"
    assert "location(us_probe, t3_746, in_rack)" in set(map(str, cell.world.facts))


EMPTY = {
    "wrist_force": "unloaded",
    "distance": "clear",
    "grip_width": "wide_open",
    "grip_force": "slack",
    "slippage": "still",
}
FULL = {
    "wrist_force": "loaded",
    "distance": "obstructed",
    "grip_width": "on_probe",
    "grip_force": "tight",
    "slippage": "still",
}


def sensed(cell: HiddenCell) -> dict[str, str | None]:
    """What each sensor of the gripper replies."""
    return {name: cell.take(f"sense({name})", "value(Reading)") for name in EMPTY}


@pytest.mark.slow
def test_what_is_as_the_model_says_works_and_sensors_read_it_from_the_physics() -> None:
    cell = cell_with()
    assert [cell.take(step, "done") for step in PICK[:2]] == ["done"] * 2
    assert sensed(cell) == {name: f"value({shown})" for name, shown in EMPTY.items()}
    assert cell.missing(["shows(grip_width, on_probe)"]) == "shows(grip_width, on_probe)"
    assert cell.take(PICK[2], "done") == "done"
    assert sensed(cell) == {name: f"value({shown})" for name, shown in FULL.items()}
    assert cell.missing([f"shows({name}, {shown})" for name, shown in FULL.items()]) == ""
    assert cell.faults == []


@pytest.mark.slow
def test_a_part_that_slips_out_of_the_hand_is_not_gripped() -> None:
    cell = cell_with(friction="0.05")
    assert [cell.take(step, "done") for step in PICK] == ["done", "done", "not_gripped"]
    assert [fault.causes for fault in cell.faults] == [("not_gripped",)]
    assert "at(probe_1, slot(drawer, 1))" in set(map(str, cell.world.facts))
    assert cell.answer("sense_grip_width") == "closed_wholly"
    assert cell.answer("sense_grip_force") == "slack"
    assert cell.answer("sense_wrist_force") == "plausible"
    assert cell.take("sense(grip_width)", "value(Reading)") == "value(wide_open)"


@pytest.mark.slow
def test_an_arm_that_touches_what_nobody_knows_of_goes_back_and_then_around(tmp_path: Path) -> None:
    file = tmp_path / "crate.yaml"
    file.write_text(
        "cell: surprise\nfixtures:\n  crate: {at: [0.62, -0.1, 1.0], shapes: [{box: [0.08, "
        "0.08, 0.5]}]}\n"
    )
    cell = cell_with(obstacles=str(file))
    assert isinstance(cell.body, PhysicalCell)
    stage, world = cell.body.stage, cell.body.stage.world
    assert cell.take("press_switch(closed, open)", "done") == "done"
    before = stage.actual(world).configuration
    assert cell.take("turn_bayonet(locked, unlocked)", "done") == "obstructed"
    assert cell.told() == {
        "seen": {
            "crate": {"at": [0.62, -0.1, 1.0], "rpy": [0.0, 0.0, 0.0], "box": [0.08, 0.08, 0.5]}
        }
    }
    assert abs(stage.actual(world).configuration - before).max() < 0.01
    assert "position(bayonet, locked)" in set(map(str, cell.world.facts))
    known = len(stage.touches.found)
    assert cell.take("turn_bayonet(locked, unlocked)", "done") == "done"
    assert stage.touches.found[known:] == ()
    assert cell.told() == {}


@pytest.mark.slow
def test_a_drawer_that_is_blocked_does_not_open_until_somebody_has_cleared_it() -> None:
    cell = cell_with(block="drawer")
    assert cell.take("open_drawer", "done") == "stuck"
    assert [fault.causes for fault in cell.faults] == [("drawer_blocked",)]
    assert cell.take("open_drawer", "done") == "stuck"
    assert cell.answer("clear_rack") == CURED
    assert cell.take("open_drawer", "done") == "done"


@pytest.mark.slow
def test_a_hand_still_holds_the_lid_that_does_not_turn_while_its_sensors_are_read() -> None:
    cell = cell_with(block="bayonet")
    assert cell.take("turn_bayonet(locked, unlocked)", "done") == "torque"
    assert [fault.causes for fault in cell.faults] == [("lid_jammed",)]
    assert cell.answer("sense_grip_width") == "as_expected"
    assert cell.answer("sense_grip_force") == "tight"
    assert cell.answer("clear_rack") == CURED
    assert cell.take("turn_bayonet(locked, unlocked)", "done") == "done"


@pytest.mark.slow
def test_a_joint_that_stopped_halfway_is_where_the_facts_have_it_after_a_repair() -> None:
    cell = cell_with(block="bayonet")
    body = cell.body
    assert isinstance(body, PhysicalCell)
    assert cell.take("turn_bayonet(locked, unlocked)", "done") == "torque"
    body.stage.put("bayonet", body.stage.world.guided("bayonet", 0.3))
    assert cell.answer("clear_rack") == CURED
    assert body.stage.value("bayonet") == pytest.approx(math.radians(40), abs=0.02)
    seated = body.stage.actual(body.stage.world).pose("world", "lid")
    assert np.abs(body.stage.pose("lid")[:3, 3] - seated[:3, 3]).max() < 0.005
    assert cell.take("turn_bayonet(locked, unlocked)", "done") == "done"


@pytest.mark.parametrize(
    "options", [{"friction": "-1"}, {"block": "lid"}, {"stick": "drawer"}, {"jam": "lid"}]
)
def test_options_that_the_cell_does_not_know_are_refused(options: dict[str, str]) -> None:
    with pytest.raises(InvalidInput):
        cell_with(**options)


@pytest.mark.slow
def test_an_arm_that_rests_in_the_way_of_another_goes_home_first() -> None:
    cell = cell_with("dual/crossing")
    steps = (
        "pick(left, rod_2, middle_2)",
        "pick(right, rod_1, middle_1)",
        "put(left, rod_2, tray_1)",
    )
    assert [cell.take(step, "done") for step in steps] == ["done"] * 3
    body = cell.body
    assert isinstance(body, PhysicalCell)
    assert body.stage.touches.found == ()
