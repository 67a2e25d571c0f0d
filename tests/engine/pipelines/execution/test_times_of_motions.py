"""How long steps last in a run with motion: as long as their motions, which a plan rounds up to
whole units of time.
"""

import math
from pathlib import Path

import pytest

pytest.importorskip("numpy")

from cellwright.engine.model.run_protocol import RecordKind
from cellwright.engine.pipelines.execution.run_motions import RunPaths
from cellwright.engine.pipelines.motion.moving_plan import plan_moving
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.plugins import geometry_backend
from cellwright.kb.loader.cell import cell_of
from cellwright.kb.terms import Function
from tests.engine.pipelines.execution.test_obstacles import executed, planned, room, wanted


def test_a_step_lasts_as_long_as_its_motion_and_no_longer_than_was_forecast(tmp_path: Path) -> None:
    target = room(tmp_path / "room")
    moving = plan_moving(problem_of(target), cell_of(target), geometry_backend(), planned)
    ending, records = executed(wanted(tmp_path, target))
    lasted = [each.content["lasts_ms"] for each in records if each.kind is RecordKind.COMMAND]
    assert lasted == [math.ceil(each.seconds * 1000 - 1e-6) for each in moving.steps]
    assert ending.makespan_ms == sum(lasted)
    assert ending.forecast_ms == sum(1000 * math.ceil(each / 1000) for each in lasted)
    assert ending.makespan_ms < ending.forecast_ms


def test_what_the_carriage_does_lasts_as_long_as_the_plan_says() -> None:
    target = "bulkhead/three_stations"
    problem = problem_of(target)
    arm, middle, left = Function("t3_746"), Function("middle"), Function("left")
    before = PlanGate().semantics(problem).initial()
    after = before - {Function("stands", (arm, middle))} | {Function("stands", (arm, left))}
    paths = RunPaths(problem, cell_of(target))
    assert not paths.refusal(
        1, Function("drive", (arm, Function("us_probe"), middle, left)), before, after
    )
    assert paths.lasts_ms(1) is None
