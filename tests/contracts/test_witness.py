"""The witness and the driver `mujoco`: plans that move are confirmed by physics, and what physics hinders is found and mended."""

import pytest

pytest.importorskip("mujoco")

from engine.model.outcome import Found
from engine.pipelines import objective
from engine.pipelines.gate import PlanGate
from engine.pipelines.planning import problem_of
from engine.pipelines.poses.planning import plan_with_poses
from engine.pipelines.simulator import HiddenCell
from engine.pipelines.witness.driver import physical
from engine.pipelines.witness.playing import played
from engine.plugins import geometry_backend
from engine.ports import DriverSetup
from engine.stages.diagnosis.knowledge import CURED
from engine.stages.planning import Limits
from kb.diagnostics import InvalidInput
from kb.loader import load_problem
from kb.loader.cell import cell_of

PICK = ("open_drawer", "press_switch(closed, open)", "pick(probe_1, slot(drawer, 1))")


@pytest.mark.slow
def test_physics_confirms_a_plan_with_one_probe() -> None:
    cell = cell_of("themse/one")
    made = plan_with_poses(
        load_problem("themse/one"), cell, geometry_backend(), lambda each: objective.plan(each, Limits())
    ).moving
    assert isinstance(made.run.outcome, Found)
    seen = played(PlanGate().semantics(made.problem), cell, made.run.outcome.plan, made.steps)
    assert seen.touched == ()
    assert max(seen.off_m.values()) < 0.005
    assert seen.off_place < 0.005


@pytest.mark.slow
def test_physics_confirms_an_inspection_with_both_tools_from_three_stations() -> None:
    cell = cell_of("bulkhead/three_stations")
    made = plan_with_poses(
        problem_of("bulkhead/three_stations"),
        cell,
        geometry_backend(),
        lambda each: objective.plan(each, Limits()),
    ).moving
    assert isinstance(made.run.outcome, Found)
    seen = played(PlanGate().semantics(made.problem), cell, made.run.outcome.plan, made.steps)
    assert seen.touched == ()
    assert seen.off_tip_m < 0.002
    assert seen.off_place < 0.002
    assert seen.off_m["slra"] < 0.001


def cell_with(problem: str = "themse/one", **options: str) -> HiddenCell:
    return physical(DriverSetup(load_problem(problem), options=options)).cell


def test_a_tool_that_sticks_in_the_hand_is_not_put_down_until_that_is_mended() -> None:
    cell = cell_with("bulkhead/both_tools", stick="us_probe")
    there = ["move_retract(t3_746, m1)", "move(t3_746, meas(m1), rack(us_probe))"]
    assert [cell.take(step, "done") for step in there] == ["done", "done"]
    assert cell.take("put_down(t3_746, us_probe)", "done") == "held"
    assert "holding(t3_746, us_probe)" in set(map(str, cell.world.facts))
    assert cell.answer("wait_for_pressure") == CURED
    assert cell.take("put_down(t3_746, us_probe)", "done") == "done"
    assert "location(us_probe, t3_746, in_rack)" in set(map(str, cell.world.facts))


@pytest.mark.slow
def test_what_is_as_the_model_says_works() -> None:
    cell = cell_with()
    assert [cell.take(step, "done") for step in PICK] == ["done"] * 3
    assert cell.faults == []


@pytest.mark.slow
def test_a_part_that_slips_out_of_the_hand_is_not_gripped() -> None:
    cell = cell_with(friction="0.05")
    assert [cell.take(step, "done") for step in PICK] == ["done", "done", "not_gripped"]
    assert [fault.causes for fault in cell.faults] == [("not_gripped",)]
    assert "at(probe_1, slot(drawer, 1))" in set(map(str, cell.world.facts))
    assert cell.answer("sense_grip_width") == "closed_wholly"


def test_a_drawer_that_is_blocked_does_not_open_until_somebody_has_cleared_it() -> None:
    cell = cell_with(block="drawer")
    assert cell.take("open_drawer", "done") == "stuck"
    assert [fault.causes for fault in cell.faults] == [("drawer_blocked",)]
    assert cell.take("open_drawer", "done") == "stuck"
    assert cell.answer("clear_rack") == CURED
    assert cell.take("open_drawer", "done") == "done"


@pytest.mark.parametrize(
    "options", [{"friction": "-1"}, {"block": "lid"}, {"stick": "drawer"}, {"jam": "lid"}]
)
def test_options_that_the_cell_does_not_know_are_refused(options: dict[str, str]) -> None:
    with pytest.raises(InvalidInput):
        cell_with(**options)
